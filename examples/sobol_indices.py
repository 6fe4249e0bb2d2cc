"""What does a film see of each parameter, and which other test would see more? Sobol indices, with SALib."""

import numpy as np
from SALib.analyze.sobol import analyze
from SALib.sample.sobol import sample

import fe
from twin import Test
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.model.keptmodel import KeptModel
from twin.model.rangedresponse import RangedResponse

finger = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
case = fe.finger_case(fe.Material(), finger=finger, lattice=fe.Lattice(per_bellow=2, ring=False))
time, shown = np.array([0, 1, 3, 6, 8, 20, 21, 30, 32, 40.0]), np.array([1, 2, 6, 7, 29, 40.0])  # s
gauge = 0.03 * np.array([0, 0, 1, 1, 0, 0, 0, 0, 1, 1])  # MPa
gravity = np.where(time > 20.5, 9810.0, -9810.0)[:, None] * [0.0, 0.0, 1.0]  # mm/s2, turned over
path, points = fe.Path(time, gauge, shown, gravity=gravity), np.array([finger.tip_node, finger.middle_node])
model = KeptModel(Test(case, path, points, np.array([True, True])), (Elasticity(),), reference=np.array([0]))
model = model.with_effect(effect("pressure_lag")).with_effect(effect("gravity"))
low, high = np.array([[0.15, 0.28], [0.06, 0.11], [0.9e-9, 1.3e-9], [0.0, 0.5]]).T  # MPa, MPa, tonne/mm3, s
names = [p.name for p in model.parameters]
response = RangedResponse.of(model, (low + high) / 2, within=dict(zip(names, zip(low, high))), solves=8)
FILM = ("tip U1, top", "tip U3, top", "middle U3, top", "tip U3, fall less rise")
FURTHER = ("turned over: tip U3, rest", "turned over: tip U3, top")
problem = {"num_vars": len(names), "names": names, "bounds": np.stack([low, high], axis=1).tolist()}
thetas = sample(problem, 512, calc_second_order=False, seed=0)
u = np.array([response.answer(theta).u for theta in thetas])  # (thetas, steps, points, 3) mm
y = [u[:, 2, 0, 0], u[:, 2, 0, 2], u[:, 2, 1, 2], u[:, 3, 0, 2] - u[:, 1, 0, 2], u[:, 4, 0, 2], u[:, 5, 0, 2]]
rows = [analyze(problem, target, calc_second_order=False, seed=0) for target in y]
first, total = (np.array([row[key] for row in rows]) for key in ("S1", "ST"))
for target, alone, all_ in zip(FILM + FURTHER, first, total):
    told = (f"{n} {round(a, 2) + 0:.2f} (total {b:.2f})" for n, a, b in zip(names, alone, all_))
    print(f"{target:26}", *told, sep="  ")
k = total[: len(FILM)].max(axis=0).argmin()  # what no target of the film sees much of
print(f"The film sees least of {names[k]}, total {total[: len(FILM), k].max():.2f}.")
best = total[:, k].argmax()
print(f"{(FILM + FURTHER)[best]} sees most of it, total {total[best, k]:.2f}.")
