"""A program that is not ours: a rod that bends in arcs, in plain numpy, and data of it."""

import numpy as np
import pandas

import twin
from calibrate import Parameter
from twin.foreign.programs import Values
from twin.targets import Array, Targets

PLACES = {"a": (35.0, 0.0, 0.0), "b": (70.0, 0.0, 2.0), "tip": (100.0, 0.0, -4.0)}
TIME = np.arange(0.0, 40.0, 0.5)
LOG = np.arange(0.0, 39.6, 0.02)
STIFF = Parameter("curvature", 0.05, 2.0, "1/(mm MPa)", start=0.5, typical=0.05)
BEND = Parameter("bend", -20.0, 20.0, "1/(mm MPa2)", start=0.0, typical=1.0)
TRUE = {"curvature": 0.4, "bend": 3.0}
SD = 0.05


def course(t: Array) -> Array:
    """Two rises with holds, MPa."""
    return np.interp(t, [0, 3, 8, 18, 22, 26, 30, 36, 40], [0, 0, 0.03, 0.03, 0.01, 0.01, 0.03, 0.03, 0.0])


def arcs(values: Values, pressure: Array) -> Array:
    """Displacements (s, 3, 3) mm of a rod whose curvature is a parabola of the pressure, less near the tip by
    `taper`."""
    s, places = np.linspace(0.0, 100.0, 101), np.array(list(PLACES.values()))
    k = (values["curvature"] * pressure + values["bend"] * pressure**2)[:, None]
    turn = k * (s - values.get("taper", 0.0) * s**2 / 200)
    middle = (turn[:, 1:] + turn[:, :-1]) / 2
    ends = [np.cumsum(f(middle), axis=1)[:, places[:, 0].astype(int) - 1] for f in (np.cos, np.sin)]  # of 1 mm each
    at, z = turn[:, places[:, 0].astype(int)], places[:, 2]
    u = np.zeros((len(pressure), 3, 3))
    u[..., 0] = ends[0] + z * np.sin(at) - places[:, 0]
    u[..., 2] = -ends[1] + z * (np.cos(at) - 1)
    return u


def data_of(u: Array, *, seed: int = 0) -> Targets:
    seen = u + SD * np.random.default_rng(seed).standard_normal(u.shape)
    rows = {"time_s": TIME, "pressure_kPa": 1e3 * course(TIME)}
    rows |= {f"{n}_{a}_mm": seen[:, k, i] for k, n in enumerate(PLACES) for i, a in ((0, "x"), (2, "z"))}
    log = pandas.DataFrame({"time_s": LOG, "pressure_kPa": 1e3 * course(LOG)})
    return twin.read_table(pandas.DataFrame(rows), points=PLACES, sd_mm=SD, log=log)
