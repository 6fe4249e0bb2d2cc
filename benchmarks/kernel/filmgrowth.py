"""What the errors of a film cost as it has more frames, markers or blocks: seconds, peak memory, exponents.

    python benchmarks/kernel/filmgrowth.py PROJECT [--quick] [--json]

The targets of a calibrated project are repeated in time, in one block or in as many, or its markers beside
themselves. Errors that a film shares grow with it, those of one stretch of time or one marker come once for
each. Counted is what every fit asks of them once, in seconds of the processor: the whitener, its determinant,
residual and derivatives whitened, and the error of a right model. Each in a process of its own; --quick stops
at twice as many. The last rows are of as many markers and so many steps as `twin measure` keeps of them.
"""

import json
import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options, processor

import numpy as np

from twin.bench.fits import newest_fit
from twin.bench.workbench import Workbench
from twin.fitmemory import steps_held
from twin.judging.fitting import ModelErrors
from twin.messages import Silent
from twin.project.folder import Project
from twin.targets import Array, Targets
from vision.placing.views import even_steps

TIMES = {"frames": (1, 2, 4), "markers": (1, 2, 4), "blocks": (1, 2, 4), "kept steps": (4, 8, 16)}
FRAMES, MARKERS, BLOCKS, KEPT = TIMES


def repeated(modes: Array, times: int, axis: int) -> tuple[Array, list[int]]:
    """Modes (k, s, p, 3) of targets that are repeated along steps (1) or points (2): those of less than half
    of them once for each. And the number of the mode that each comes from."""
    others = tuple(n for n in (1, 2, 3) if n != axis)
    local = (modes != 0).any(axis=others).mean(axis=1) < 0.5
    wide, rows = repeat(modes, times, axis), list[tuple[int, Array]]()
    size, place = modes.shape[axis], np.arange(wide.shape[axis])
    for k, mode in enumerate(wide):
        shape = [-1 if n == axis else 1 for n in (1, 2, 3)]
        parts = [(place // size == j).reshape(shape) for j in range(times)] if local[k] else [1.0]
        rows += [(k, mode * part) for part in parts]
    return np.array([m for _, m in rows]), [k for k, _ in rows]


def longer(t: Targets, times: int, what: str) -> Targets:
    """Targets with as many times the frames, the markers, or the blocks."""
    axis = 2 if what == MARKERS else 1
    modes, of = repeated(t.modes, times, axis)
    common: dict[str, Any] = {"modes": modes, "mode_names": tuple(t.mode_names[k] for k in of)}
    common |= {n: repeat(getattr(t, n), times, axis - 1) for n in ("value", "covariance", "valid")}
    if what == MARKERS:
        points = tuple(replace(p, name=f"{p.name}{j or ''}") for j in range(times) for p in t.points)
        if t.noise is not None:
            fields = ("sd", "rho", "codec_sd")
            each: dict[str, Any] = {n: repeat(getattr(t.noise, n), times, 0) for n in fields}
            correlation = np.asarray(np.kron(np.eye(times), t.noise.correlation), float)
            common["noise"] = replace(t.noise, correlation=correlation, **each)
        return replace(t, points=points, **common)
    inside = (t.log_time >= t.time[0]) & (t.log_time <= t.time[-1])
    span = t.time[-1] - t.time[0] + (t.time[1] - t.time[0])
    common |= {n: repeat(getattr(t, n), times, 0) for n in ("pressure", "held_out", "pressure_sd")}
    new = (t.block[-1] + 1) * (what == BLOCKS)
    common["block"] = np.concatenate([t.block + j * new for j in range(times)])
    common |= {"log_pressure": repeat(t.log_pressure[inside], times, 0)}
    for name, x in {"time": t.time, "log_time": t.log_time[inside]}.items():
        common[name] = np.concatenate([x + j * span for j in range(times)])
    return replace(t, **common)


def kept(t: Targets, times: int) -> Array:
    """The steps that are kept where there are so many times the markers."""
    few = longer(shorter(t, t.reference), times, MARKERS)
    components = int(few.valid.any(axis=0).sum())
    most = steps_held(components, len(few.modes), rest=len(t.reference))
    return np.union1d(even_steps(len(t.time), most), t.reference)


def shorter(t: Targets, steps: Array) -> Targets:
    """Targets of some steps, those of the reference among them."""
    of_steps = ("time", "pressure", "block", "value", "covariance", "valid", "held_out", "pressure_sd")
    some: dict[str, Any] = {name: getattr(t, name)[steps] for name in of_steps}
    return replace(t, modes=t.modes[:, steps], reference=np.searchsorted(steps, t.reference), **some)


def repeat(x: Array, times: int, axis: int) -> Array:
    """An array so many times along an axis."""
    return np.concatenate([x] * times, axis=axis)


def cost(project: Path, times: int, what: str) -> dict[str, float]:
    """Processor seconds and peak memory of the errors of targets that are so many times as long or wide."""
    bench, fit = Workbench.of(Project.open(project)), newest_fit(Project.open(project))
    model = bench.on_mesh(bench.model(), fit.theta, Silent())
    t, errors = bench.targets, ModelErrors.of(model, fit.theta, bench.targets)
    u, jacobian = model.predict(fit.theta), model.jacobian(fit.theta)
    steps = kept(t, times) if what == KEPT else np.arange(len(t.time))
    axis = 1 if what in (MARKERS, KEPT) else 0
    t = longer(shorter(t, steps), times, MARKERS if axis else what)
    gauge, u = (repeat(x[steps], times, axis) for x in (errors.gauge, u))
    modes, jacobian = (repeat(x[:, steps], times, axis + 1) for x in (errors.modes, jacobian))
    began = processor()
    w = ModelErrors(gauge=gauge, modes=modes, names=errors.names).whitener(t)
    _ = w.log_det, w.whiten(t.value - u), w.whiten(jacobian)
    whitened = processor()
    w.expected_after(jacobian)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return {
        "times": times, "steps": len(t.time), "points": len(t.points), "shared_errors": len(t.modes),
        "whitening_s": whitened - began, "expected_s": processor() - whitened, "peak_MB": peak,
    }  # fmt: skip


def exponent(rows: list[dict[str, float]], of: str) -> float:
    """Slope of log cost over log times."""
    return float(np.polyfit(np.log([r["times"] for r in rows]), np.log([r[of] for r in rows]), 1)[0])


def main() -> int:
    """Print the table."""
    typed = options(__doc__, {"project": {"type": Path, "help": "a calibrated project"},
                              "--one": {"help": "one row, in this process"}},
                    quick="up to twice as many", json="one JSON line")  # fmt: skip
    if typed.one:
        print(json.dumps(cost(typed.project, *json.loads(typed.one))))
        return 0
    found: dict[str, Any] = {}
    for what, every in TIMES.items():
        rows = []
        for times in every[: 2 if typed.quick else None]:
            command = [sys.executable, __file__, str(typed.project), "--one", json.dumps([times, what])]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            rows.append(json.loads(done.stdout.splitlines()[-1]))
        slopes = {f"exponent_{k}": exponent(rows, k) for k in ("whitening_s", "expected_s")}
        found[what] = {"rows": rows} | slopes
    if typed.json:
        print(json.dumps(found))
        return 0
    print("| steps | points | shared errors | whitening s | error of a right model s | peak MB |")
    print("|---|---|---|---|---|---|")
    for what, each in found.items():
        for r in each["rows"]:
            print(f"| {r['steps']} | {r['points']} | {r['shared_errors']} | {r['whitening_s']:.2f} "
                  f"| {r['expected_s']:.2f} | {r['peak_MB']:.0f} |")  # fmt: skip
        print(f"{what}: exponents {each['exponent_whitening_s']:.2f}, {each['exponent_expected_s']:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
