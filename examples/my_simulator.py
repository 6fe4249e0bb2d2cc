"""A model of your own in plain numpy is told what it lacks: its regulator lags.

    python examples/my_simulator.py     about ten seconds

A rod bends in arcs, its curvature in proportion to the pressure. The data are made here by the same arcs
under a pressure that follows the log 0.3 s late, and with noise.
"""

import numpy as np
import pandas

import twin

PLACES = {"a": (35, 0, 0), "b": (70, 0, 2), "tip": (100, 0, -4)}  # mm, along x from the clamp


def predict(values: dict[str, float], pressure: np.ndarray) -> np.ndarray:
    """Displacements (steps, points, 3) mm at pressures (steps,) MPa."""
    x, _, z = np.array(list(PLACES.values()), float).T
    k = np.maximum(values["bending"] * pressure, 1e-9)[:, None]  # curvature, 1/mm
    along, up = np.sin(k * x) / k + z * np.sin(k * x), (np.cos(k * x) - 1) / k + z * np.cos(k * x)
    return np.stack([along - x, 0 * along, up - z], axis=2)


def course(t: np.ndarray) -> np.ndarray:
    """Pressure in MPa over time in s: up, held, half down, held, up and down."""
    return np.interp(t, [0, 3, 8, 14, 16, 20, 24, 28, 33], [0, 0, 0.03, 0.03, 0.01, 0.01, 0.03, 0.03, 0.0])

steps, fine = np.arange(0.0, 33.0, 0.5), np.arange(0.0, 33.0, 0.01)
late = np.zeros(len(fine))
for k in range(1, len(fine)):
    late[k] = late[k - 1] + 0.01 / 0.3 * (course(fine)[k - 1] - late[k - 1])
u = predict({"bending": 0.5}, np.interp(steps, fine, late))
u += 0.05 * np.random.default_rng(1).standard_normal(u.shape)
table = {"time_s": steps, "pressure_kPa": 1e3 * course(steps)}
table |= {f"{n}_{c}_mm": u[:, k, i] for k, n in enumerate(PLACES) for i, c in ((0, "x"), (2, "z"))}
log = pandas.DataFrame({"time_s": fine, "pressure_kPa": 1e3 * course(fine)})
data = twin.read_table(pandas.DataFrame(table), points=PLACES, sd_mm=0.05, log=log)
mine = twin.simulator(predict, [twin.Parameter("bending", 0.05, 2.0, "1/(mm MPa)", start=0.4)])
print(twin.diagnose(mine, data))
