"""How right a reduced model of motions in time states its error, and what a film costs with it."""

import time
from dataclasses import replace

from benchmarks.kernel.beams import DENSITY
from benchmarks.kernel.convergence import SILICONE

import numpy as np

from fe import Case, Finger, Lattice, finger_case
from fe.dynamics.reduced import ReducedModel, ReducedMotion
from fe.dynamics.timesteps import transient
from fe.path import Path

X = 10 + 100 / 9
STUB = Finger(length=X, bellows=1, tip_node=(X, 11.5, 0.0), middle_node=(X / 2, 11.5, 0.0))
COARSE = Lattice(per_bellow=2, ring=False, centred=False)
TOP = 0.021  # MPa, of the courses
LEVELS = np.linspace(-0.5 * TOP, 2 * TOP, 13).tolist()
RISES = (0.6, 2.3)  # periods in which the pressure rises to TOP
LASTS = 4.0  # periods after that
SEEN, STEPS = 20, 60  # output times, and whole steps, a period


def stub() -> Case:
    """A finger of one bellow."""
    return finger_case(replace(SILICONE, density=DENSITY), finger=STUB, lattice=COARSE)


def period_of(model: ReducedModel) -> float:
    """The period in s of its slowest vibration at TOP."""
    return float(2 * np.pi / np.sqrt(np.interp(TOP, model.pressure, model.square[:, 0])))


def stepped(model: ReducedModel, rise: float) -> tuple[Path, ReducedMotion]:
    """The path of a rise in so many periods, and the motion with the error that two moments state."""
    period = period_of(model)
    corners = np.array([0.0, rise, rise + LASTS]) * period
    output = np.linspace(0.0, corners[-1], round(SEEN * (rise + LASTS)) + 1)
    path = Path(corners, np.array([0.0, TOP, TOP]), output)
    moved = model.follow(path)
    return path, model.certified(moved, [rise * period, (rise + 1.5) * period])


def reduced_pull(model: ReducedModel) -> dict[str, float]:
    """reduced_pull: rms of the error over the stated one after each rise; reduced_error: the largest error
    over the swing."""
    pulls, errors = [], []
    for rise in RISES:
        path, moved = stepped(model, rise)
        whole = transient(model.case, path, tolerance=1e9, longest=period_of(model) / STEPS, radius=0.95)
        off = np.linalg.norm(whole.u - moved.u, axis=2).max(axis=1)
        late = slice(round(SEEN * rise), None)
        pulls.append(off[late] / moved.error[late])
        errors.append(float(off[late].max() / moved.swing.max()))
    return {"reduced_pull": float(np.sqrt(np.mean(np.concatenate(pulls) ** 2))), "reduced_error": max(errors)}


def s_per_film_s(case: Case, film_s: float = 60.0) -> dict[str, float]:
    """s_per_film_s: seconds of processor a second of a film of `film_s` s with twelve fast steps, to make,
    follow and check the model; reduced_follow_s and reduced_certify_s: of it, to follow and to check it."""
    begun = time.process_time()
    model = ReducedModel.of(case, LEVELS)
    made = time.process_time()
    period = period_of(model)
    at = np.arange(12) * film_s / 12
    corners = np.column_stack([at, at + 0.6 * period]).ravel()
    pressure = TOP * (np.arange(12) % 2)
    held = np.append(np.column_stack([np.roll(pressure, 1), pressure]).ravel(), pressure[-1])
    path = Path(np.append(corners, film_s), held, np.linspace(0, film_s, 601))
    moved = model.follow(path, loss=0.1)
    followed = time.process_time()
    model.certified(moved, [float(at[1] + period), float(at[6] + period)])
    ended = time.process_time()
    parts = {"s_per_film_s": ended - begun, "reduced_follow_s": followed - made,
             "reduced_certify_s": ended - followed}  # fmt: skip
    return {name: seconds / film_s for name, seconds in parts.items()}
