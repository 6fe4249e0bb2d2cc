"""An effect of one's own: the line leaks. Which promises of an effect does it break, and what does it do?"""

from dataclasses import replace

import numpy as np

import fe
from twin import Effect, Model, Order, Parameter, Test, check_effect
from twin.effects.material import Elasticity


class Leak(Effect):
    """The chamber gets less than the gauge reads, by `leak.loss` times the square of the pressure."""

    name, order, sentence = "leak", Order.LINE, "the line leaks, the more the higher the pressure"
    parameters = (Parameter("leak.loss", 0.0, 10.0, "1/MPa", null=0.0, typical=0.1),)

    def before(self, test, theta):
        gauge = test.path.pressure
        return replace(test, path=replace(test.path, pressure=gauge - theta["leak.loss"] * gauge**2))


broken = check_effect(Leak())
print("\n".join(broken) or "The effect keeps every promise.")

finger = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
lattice = fe.Lattice(per_bellow=2, ring=False, centred=False)  # coarse, and so quick
case = fe.finger_case(fe.Material(0.2, 0.1), finger=finger, lattice=lattice)
time, pressure = np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.015, 0.03])  # s, MPa
test = Test(case, fe.Path(time, pressure, time), np.array([finger.tip_node]), np.array([True]))
model = Model(test, (Elasticity(), Leak()), reference=np.array([0]))
for loss in (0.0, 2.0):
    theta = model.theta({"C10": 0.214, "C01": 0.083, "leak.loss": loss})
    u = model.predict(theta)[2, 0, 2]  # mm: at the third time, of the first point, along z
    print(f"loss {loss}: the tip moves by U3 = {u:.3f} mm at 30 kPa")
slope = model.jacobian(theta)[2, 2, 0, 2]  # of the third parameter: nobody wrote this derivative
print(f"U3 changes by {slope:.3f} mm for each 1/MPa")
