"""Programs that are not ours, diagnosed from outside: is the mechanism right, the hidden effect in the set?
And the calibrated finger given back to other simulators: does its tip follow?

    python benchmarks/foreign.py [--quick] [--json] [--only models targets] [--programs arcs rod calculix]
        [--project FOLDER]   some minutes

models: `arcs`, a rod of constant curvature; `rod`, an elastic line that stretches, bends and weighs; if it is
installed, `mujoco`, a chain of hinges and slides there; and, if `ccx` is, `calculix`, a PneuNet of two
chambers in its 20-node elements, and `roof`, the same beside our own model of a like body, with neo-Hooke
silicone: the roof of the truth's last chamber is thinner or thicker. Data come from the same
physics in finer steps or on a finer mesh, with an effect that is hidden by code of its own
(lag and creep step by step, the picture through a pinhole) and noise. `taper`, a stiffness that falls along
the body, is hidden twice: where the program can have it by a parameter, and where it cannot.

By program n, mechanism (share whose first mechanism is that of the hidden effect) and in_set (share
whose nearest names hold it, of those that can be named); sure_wrong: share with a wrong name and a grade
above `like`. --quick: every fourth trial.

targets: of a project with a fit (--project, by default none: this part is left out), by simulator that is
installed here: tip_error (largest distance of its tip from ours at five pressures, over the displacement),
film_error (the same from the film), cover, load_error (of what a force at the tip adds). `pip install mujoco
pyelastica` for all of them. The project is copied first.
"""

import importlib.util
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import ccxfinger, mujocofinger
from benchmarks.commandline import options

import numpy as np
import pandas
from numpy.typing import NDArray

import twin
from twin.assets.simulators import SIMULATORS
from twin.diagnosis.grades import Grade
from twin.effects.mechanism import Mechanism

Array = NDArray[np.float64]
Values = Mapping[str, float]
PLACES = mujocofinger.PLACES
X, _, Z = np.array(list(PLACES.values())).T
SD, SMALL = 0.05, 0.02  # mm; of a finger that moves by 3 mm, not by 60
STEPS, LOG = np.arange(0.0, 40.0, 0.5), np.arange(0.0, 39.6, 0.02)
FINE = np.arange(0.0, 40.0, 2e-3)
ROOF = "thin_roof"  # of the last chamber in CalculiX, mm; ours of a like body has the shape of a wall_taper
SIZES: dict[str, tuple[tuple[float, ...], Mechanism]] = {
    "pressure_lag": ((0.1, 0.3, 0.6), Mechanism.COURSE), "creep": ((0.02, 0.06, 0.12), Mechanism.HISTORY),
    "time_shift": ((0.05, -0.1, 0.2), Mechanism.COURSE),
    "pressure_offset": ((3e-4, -6e-4, 1e-3), Mechanism.COURSE),
    "camera_scale": ((0.01, -0.02, 0.04), Mechanism.PICTURE),
    "camera_rotation": ((0.01, -0.02, 0.04), Mechanism.PICTURE),
    "thermal": ((5e-4, -1e-3, 2e-3), Mechanism.HISTORY), "taper": ((0.03, -0.06, 0.12), Mechanism.BODY),
    ROOF: ((0.1, -0.1, 0.2, -0.2, 0.4, -0.4), Mechanism.BODY),
}  # fmt: skip
# of `calculix`, which moves so little
MORE = {"camera_scale": 4.0, "camera_rotation": 4.0, "pressure_offset": 4.0}


def sizes(model: str, kind: str) -> list[float]:
    """The sizes at which a kind is hidden in a model."""
    more = MORE.get(kind, 1.0) if model == "calculix" else 1.0
    return [more * size for size in SIZES[kind][0]]


def course(t: Array) -> Array:
    """Two rises with holds, MPa."""
    return np.interp(t, [0, 3, 8, 18, 22, 26, 30, 36, 40], [0, 0, 0.03, 0.03, 0.01, 0.01, 0.03, 0.03, 0.0])


def line(stretch: Array, curvature: Array) -> Array:
    """Displacements (s, 4, 3) mm of points of a rod whose stretch and curvature (s, n) hold in n equal parts
    of its length."""
    n = curvature.shape[1]
    h = X.max() / n
    turn = np.concatenate([np.zeros((len(curvature), 1)), np.cumsum(h * curvature, axis=1)], axis=1)
    middle = (turn[:, 1:] + turn[:, :-1]) / 2
    nothing = np.zeros((len(turn), 1))
    ends = [np.hstack([nothing, np.cumsum(h * stretch * f(middle), axis=1)]) for f in (np.cos, np.sin)]
    at = (X / h).round().astype(int)
    u = np.zeros((len(curvature), len(X), 3))
    u[..., 0] = ends[0][:, at] + Z * np.sin(turn[:, at]) - X
    u[..., 2] = -ends[1][:, at] + Z * (np.cos(turn[:, at]) - 1)
    return u


def softer(values: Values, n: int) -> Array:
    """The bend (n,) of the parts over that of an even rod."""
    return 1 - values.get("taper", 0.0) * (2 * (np.arange(n) + 0.5) / n - 1)


def arcs(values: Values, pressure: Array, *, parts: int = 100) -> Array:
    """A rod whose curvature is a parabola of the pressure."""
    k = (values["bending"] * pressure + values["more"] * pressure**2)[:, None]
    return line(np.ones((len(k), parts)), k * softer(values, parts))


def rod(values: Values, pressure: Array, *, parts: int = 100) -> Array:
    """A rod of stiffness E that the pressure of a chamber off its axis stretches and bends, and its weight:
    sections 300 mm2 and 9000 mm4, a chamber of 60 mm2 at 7 mm; fixed-point sweeps of the moment."""
    p, E, h = pressure[:, None], values["E"], X.max() / parts
    weight = 1.07e-9 * 9810 * 300 * h  # N of a part
    stretch, turn = 1 + 60 * p / (300 * E) * np.ones(parts), np.zeros((len(p), parts))
    for _ in range(6):
        x = np.cumsum(h * stretch * np.cos(turn), axis=1)
        beyond = np.arange(parts, 0, -1) - 1
        moment = weight * (np.cumsum(x[:, ::-1], axis=1)[:, ::-1] - x - beyond * x)
        bend = (60 * 7 * p + moment) / (9000 * E) * softer(values, parts)
        turn = np.cumsum(h * bend, axis=1) - h * bend / 2
    return line(stretch, bend)


Places = Mapping[str, tuple[float, float, float]]
MODELS: dict[str, tuple[Callable[..., Array], list[twin.Parameter], Values, Places]] = {
    "arcs": (arcs, [twin.Parameter("bending", 0.05, 2.0, "1/(mm MPa)", start=0.5, typical=0.05),
                    twin.Parameter("more", -20.0, 20.0, "1/(mm MPa2)", start=0.0, typical=1.0)],
             {"bending": 0.4, "more": 3.0}, PLACES),
    "rod": (rod, [twin.Parameter("E", 0.02, 0.6, "MPa", start=0.12, typical=0.02)], {"E": 0.09}, PLACES),
    "calculix": (ccxfinger.displaced, [twin.Parameter("E", 1.3, 4.0, "MPa", start=2.2, typical=0.1)],
                 {"E": 1.7}, ccxfinger.PLACES),
    "mujoco": (mujocofinger.displaced, [twin.Parameter("E", 0.05, 0.6, "MPa", start=0.12, typical=0.02)],
               {"E": 0.09}, PLACES),
}  # fmt: skip
MODELS["roof"] = MODELS["calculix"]  # diagnosed beside a fit of our model of a like body


def hidden(model: str, kind: str, size: float) -> Array:
    """Displacements (s, 4, 3) mm with a hidden effect."""
    program, _, true, places = MODELS[model]
    values, p = dict(true), course(FINE)
    if kind == "pressure_lag":
        for k in range(1, len(p)):
            p[k] = p[k - 1] + 2e-3 / size * (course(FINE[k - 1 : k])[0] - p[k - 1])
    elif kind == "time_shift":
        p = course(FINE - size)
    elif kind == "pressure_offset":
        p = p + size
    elif kind == "creep":  # a Kelvin element of 4 s in series: its strain, step by step
        given = 0 * p
        for k in range(1, len(p)):
            given[k] = given[k - 1] + 2e-3 / 4.0 * (size * p[k - 1] - given[k - 1])
        p = p + given
    elif kind == "thermal":
        p = p / (1 + size * FINE)
    elif kind == "taper":
        values["taper"] = size
    more = {"thinner": size} if kind == ROOF else {}
    u = program(values, np.interp(STEPS, FINE, p), parts=400, **more)
    at = u + np.array(list(places.values()))
    if kind == "camera_rotation":
        c, s = np.cos(size), np.sin(size)
        u = at @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T - at + u
    if kind == "camera_scale":  # a pinhole whose distance was measured wrong
        u = at * (500.0 / (500.0 * (1 - size / (1 + size)))) - at + u
    return np.asarray(u - u[0])


def data_of(u: Array, seed: int, places: Places) -> twin.Targets:
    """What would be measured of points at places (x, y, z) mm."""
    sd = SD if places is PLACES else SMALL
    seen = u + sd * np.random.default_rng(seed).standard_normal(u.shape)
    rows = {"time_s": STEPS, "pressure_kPa": 1e3 * course(STEPS)}
    rows |= {f"{n}_{a}_mm": seen[:, k, i] for k, n in enumerate(places) for i, a in ((0, "x"), (2, "z"))}
    log = pandas.DataFrame({"time_s": LOG, "pressure_kPa": 1e3 * course(LOG)})
    return twin.read_table(pandas.DataFrame(rows), points=places, sd_mm=sd, log=log)


def trial(model: str, kind: str, size: float, seed: int, *, variant: bool) -> dict[str, Any]:
    """The row of one diagnosis."""
    program, parameters, _, places = MODELS[model]
    mechanism = SIZES[kind][1]
    own = (
        [twin.Parameter("taper", -0.5, 0.5, "", null=0.0, typical=0.02, plausible=(-0.3, 0.3))]
        if variant
        else []
    )
    finer = partial(program, parts=200) if model == "mujoco" else None
    mine = twin.simulator(program, parameters, variants=own, finer=finer)
    data = data_of(hidden(model, kind, size), seed, places)
    like = twin.calibrate(ccxfinger.like(), data) if kind == ROOF else None
    found = twin.diagnose(mine, data, like=like).diagnosis
    kind = "wall_taper" if kind == ROOF else kind
    near = {name for each in found.nearest for name in each.split(" + ")}
    sure = found.grade in (Grade.NAMED, Grade.LIKELY)
    return {
        "model": model, "kind": kind, "size": size, "variant": variant, "verdict": found.verdict,
        "grade": found.grade, "mechanism": found.mechanisms[:1] == (mechanism,), "runs": len(mine.runs),
        "in_set": kind in near if kind != "taper" or variant else None,
        "sure_wrong": sure and set(found.named) != {kind},
    }  # fmt: skip


def models(quick: bool, programs: Sequence[str]) -> dict[str, Any]:
    """Rates of the trials by program; seeds are those of all programs together."""
    solver = "" if shutil.which("ccx") else "ccx is not installed (apt package calculix-ccx)"
    absent = {
        "calculix": solver, "roof": solver,
        "mujoco": "" if importlib.util.find_spec("mujoco") else "it is not installed (pip install mujoco)",
    }  # fmt: skip
    for model in [m for m in programs if absent.get(m)]:
        print(f"{model}: left out, as {absent[model]}", file=sys.stderr)
    some = [m for m in programs if not absent.get(m)]
    trials = [
        (model, kind, size, variant)
        for model in MODELS
        for kind in SIZES
        for size in sizes(model, kind)
        for variant in ((False, True) if kind == "taper" else (False,))
        if (kind == ROOF) == (model == "roof") and (model != "calculix" or kind != "taper")
    ]
    rows: list[dict[str, Any]] = []
    for seed, (model, kind, size, variant) in enumerate(trials):
        if model not in some or (quick and seed % 4):
            continue
        began = time.process_time()
        rows.append(trial(model, kind, size, seed, variant=variant))
        print(f"{rows[-1]} {time.process_time() - began:.0f} s", file=sys.stderr, flush=True)
    return {model: rates([r for r in rows if r["model"] == model]) for model in some}


def targets(project: Path) -> dict[str, Any]:
    """Errors of the simulators that are installed, by name, for a copy of a project with a fit."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(project, copy := Path(folder) / project.name)
        for name, simulator in SIMULATORS.items():
            if not simulator.runs:
                print(f"{name}: {simulator.package} is not installed", file=sys.stderr)
                continue
            made = twin.open_project(copy).export(name).summary
            found[name] = {key: made[key] for key in ("tip_error", "film_error", "cover", "load_error")}
            print(f"{name}: {found[name]}", file=sys.stderr, flush=True)
    return found


def main() -> None:
    """Run the parts, print what they give."""
    every = ("models", "targets")
    more = {
        "--only": {"nargs": "+", "choices": every, "default": every, "help": "these parts alone"},
        "--programs": {"nargs": "+", "choices": list(MODELS), "default": list(MODELS), "help": "of models"},
        "--project": (Path, "project with a fit, for the targets"),
    }
    typed = options(__doc__, more, quick="every fourth trial", json="one JSON line")
    result: dict[str, Any] = {}
    if "models" in typed.only:
        result["models"] = models(typed.quick, typed.programs)
    if "targets" in typed.only and typed.project:
        result["targets"] = targets(typed.project)
    print(json.dumps(result, indent=None if typed.json else 1))


def rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """n and the shares of some rows."""

    def share(key: str) -> float:
        seen = [r[key] for r in rows if r[key] is not None]
        return round(sum(seen) / max(len(seen), 1), 3)

    return {"n": len(rows)} | {key: share(key) for key in ("mechanism", "in_set", "sure_wrong")}


if __name__ == "__main__":
    main()
