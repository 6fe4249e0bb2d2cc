"""A bellows finger is inflated to 30 kPa: how far do its tip and its middle move? With `fe` alone."""

import numpy as np

import fe

silicone = fe.Material(0.214, 0.083)  # Mooney-Rivlin: C10, C01 in MPa
finger = fe.Finger()  # 110 mm long, nine bellows; fe.Finger(length=80, bellows=6) is another one
case = fe.finger_case(silicone, finger=finger)  # a mesh: units are mm, N, MPa; x from the clamp, z up

time = np.array([0.0, 1.0, 2.0, 3.0])  # s
pressure = np.array([0.0, 0.01, 0.02, 0.03])  # MPa: 0.03 MPa are 30 kPa
path = fe.Path(time, pressure, time[1:])  # the log, and the times at which displacements are wanted

solution = fe.solve(case, path)
if not solution.converged:
    raise SystemExit(f"no equilibrium: {solution.reason}")

points = np.array([finger.tip_node, finger.middle_node])  # any places of the undeformed finger, mm
u = solution.at(points)  # (times, points, 3) mm
for p, (tip, middle) in zip(pressure[1:], u):
    print(f"{1e3 * p:2.0f} kPa: tip U1 {tip[0]:7.2f}, U3 {tip[2]:7.2f} mm; middle U3 {middle[2]:7.2f} mm")

# How much farther does the tip go for each kPa more? The derivative comes with the solve.
print(f"tip U3 changes by {1e-3 * solution.per_pressure(points)[-1, 0, 2]:.3f} mm per kPa at 30 kPa")
