"""A table of displacements is diagnosed without a project folder: which effect does the model lack?

The table is made here, on another mesh than the model's: the pressure inside lags behind the gauge by 1 s.
"""

import numpy as np
import pandas

import fe
import twin

SD, LAG = 0.02, 1.0  # mm, of one value; s
shape = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
coarse, other = fe.Lattice(per_bellow=2, ring=False, centred=False), fe.Lattice(per_bellow=2, centred=False)
log, time = np.arange(0.0, 20.05, 0.1), np.arange(0.0, 20.5, 1.0)  # s
gauge = 0.03 * np.interp(log, [0, 2, 6, 12, 16], [0, 0, 1, 1, 0])  # MPa
inside, keep = np.zeros_like(gauge), np.exp(-0.1 / LAG)
for k in range(1, len(log)):
    inside[k] = keep * inside[k - 1] + (1 - keep) * (gauge[k - 1] + gauge[k]) / 2
hidden = fe.finger_case(fe.Material(0.214, 0.083), finger=shape, lattice=other)
places = {"tip": shape.tip_node, "middle": shape.middle_node}
u = fe.solve(hidden, fe.Path(log, inside, time)).at(np.array([*places.values()]))
u += SD * np.random.default_rng(1).standard_normal(u.shape)  # (steps, points, 3) mm
frame = pandas.DataFrame({"time_s": time} | {f"{name}_{axis}_mm": u[:, p, i]  # one camera does not see y
                          for p, name in enumerate(places) for i, axis in ((0, "x"), (2, "z"))})  # fmt: skip

# From here on with your own table: a file or a DataFrame
data = twin.read_table(frame, points=places, sd_mm=SD, rest_steps=2,
                       log=pandas.DataFrame({"time_s": log, "pressure_MPa": gauge}))  # fmt: skip
model = twin.finger(length_mm=43.3, pleats=3, lattice=coarse, mesh_error=False)  # quick
fit = twin.calibrate(model, data)
found = twin.diagnose(fit, data, effects=["pressure_lag", "pressure_offset", "camera_scale"], stand_ins=False)
print(found)
print(fit.add(found))
