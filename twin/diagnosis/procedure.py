"""A base model, a library of effects and targets -> which physical effect the data ask for, and what cannot
be told.

Noise, frame and mesh first: what they forbid is not tested. `searchorder` tries, `verdicts` concludes,
`completing` adds what belongs beside a verdict.
"""

from collections.abc import Sequence
from dataclasses import replace

from calibrate import Fit
from twin.diagnosis.completing import completed
from twin.diagnosis.refitting import Progress
from twin.diagnosis.searchorder import Attempts
from twin.diagnosis.verdicts import Diagnosis, cannot, concluded
from twin.effects.protocol import Effect
from twin.effects.standins import stand_ins
from twin.judging.fitting import whitener_of
from twin.judging.frame import frame_test
from twin.model.prediction import Model
from twin.targets import Array, Targets


def diagnose(
    model: Model,
    effects: Sequence[Effect],
    targets: Targets,
    *,
    seed: int,
    start: Array | Fit,
    beside: Sequence[Effect] | None = None,
    plan: bool = True,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a base model. start: its calibrated parameters (d,), from where it is fitted, or
    its fit, which is taken as it is; beside: generic stand-ins for what the library does not have, by default
    `stand_ins`; plan: whether experiments are planned for a tie; workers: processes that refit.

    Reads targets only. Raises Unsolvable where the base model cannot be solved at `start`.
    """
    why = _refusal(targets)
    if why:
        return cannot(why)
    frame = frame_test(targets)
    if frame.moves:
        return replace(cannot(f"the frame moves: {frame.place}"), frame=frame)
    tell = progress or (lambda stage, done, total: None)
    generic = stand_ins(model.test) if beside is None else beside
    task = Attempts(model, tuple(effects), tuple(generic), targets, seed, workers, tell)
    theta = start.theta if isinstance(start, Fit) else start
    why = _mesh(model, whitener_of(model, theta, targets).noise_sd)
    if why:
        return replace(cannot(why), frame=frame)
    base = task.base(start)
    found = concluded(task.tried(base))
    found = completed(found, base, task.rivals_at(base), task.silent, targets, plan=plan)
    return replace(found, frame=frame)


def _refusal(targets: Targets) -> str:
    if targets.noise is None:
        return "no noise model: film the finger at rest (>= 300 frames) and run twin measure"
    if targets.noise.frames < 30:
        return f"the noise model rests on {targets.noise.frames} static frames, wanted 300 or more"
    return ""


def _mesh(model: Model, noise: float) -> str:
    """Why the mesh does not allow a test at a noise of so many mm; nothing where it does."""
    if model.mesh is None:
        return ""
    if model.mesh.unknown:
        return f"mesh: {model.mesh.unknown}"
    left = model.mesh.remainder_mm
    if left > 0.1 * noise:
        return (
            f"mesh: {left:.4f} mm of the discretisation error is neither corrected nor carried by a mode, "
            f"more than a tenth of the noise ({noise:.4f} mm); refine the mesh"
        )
    return ""
