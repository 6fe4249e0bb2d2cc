"""A table of displacements is diagnosed without a project folder: which effect does the model lack?

The table is made here, on another mesh than the model's: the pressure inside lags behind the gauge by 1 s.
"""

import numpy as np

import fe
from twin import Noise, Targets, diagnose
from twin.effects.library import effect
from twin.model.keptmodel import base_model
from twin.targets import at_node

SD, LAG = 0.02, 1.0  # mm, of one value; s
finger = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
coarse, other = fe.Lattice(per_bellow=2, ring=False, centred=False), fe.Lattice(per_bellow=2, centred=False)
log, time = np.arange(0.0, 20.05, 0.1), np.arange(0.0, 20.5, 1.0)  # s
gauge = 0.03 * np.interp(log, [0, 2, 6, 12, 16], [0, 0, 1, 1, 0])  # MPa
inside, keep = np.zeros_like(gauge), np.exp(-0.1 / LAG)
for k in range(1, len(log)):
    inside[k] = keep * inside[k - 1] + (1 - keep) * (gauge[k - 1] + gauge[k]) / 2

hidden = fe.finger_case(fe.Material(0.214, 0.083), finger=finger, lattice=other)
u = fe.solve(hidden, fe.Path(log, inside, time)).at(np.array([finger.tip_node, finger.middle_node]))
u += SD * np.random.default_rng(1).standard_normal(u.shape)  # (steps, points, 3) mm: yours comes from a file
u[..., 1] = np.nan  # one camera does not see y
(s, p, _), one, steps = u.shape, np.ones((2, 3)), np.arange(len(u))
noise = Noise(sd=SD * one, rho=0 * one, correlation=np.eye(6), frames=300, codec_sd=0 * one,
              gauge_sd_MPa=0.0, gauge_frames=0)  # fmt: skip
table = Targets(time=time, pressure=np.interp(time, log, gauge), block=0 * steps, noise=noise, log_time=log,
                points=(at_node("tip", 4401), at_node("middle", 5848)), value=u - u[:2].mean(axis=0),
                covariance=np.tile(SD**2 * np.eye(3), (s, p, 1, 1)), valid=np.isfinite(u), held_out=steps < 0,
                modes=np.zeros((0, s, p, 3)), mode_names=(), log_pressure=gauge, reference=steps[:2],
                gravity=None, pressure_sd=np.zeros(s))  # fmt: skip
model = base_model(table, fe.finger_case(fe.Material(), finger=finger, lattice=coarse))
tried = [effect(name) for name in ("pressure_lag", "pressure_offset", "camera_scale")]
found = diagnose(model, tried, table, seed=0, start=np.array([0.2, 0.1]), beside=())  # no stand-ins: quick
print(found.sentence)
for q, x, sd in zip(found.kept.fit.parameters, found.kept.fit.theta, found.kept.fit.sd):
    print(f"{q.name} = {x:.3f} {q.unit}, sd {sd:.3f}")
