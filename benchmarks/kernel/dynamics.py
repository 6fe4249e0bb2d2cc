"""How right natural frequencies are: against beam theory and CalculiX.

    python benchmarks/kernel/dynamics.py [--quick] [--json]

beam_theory: the largest relative difference to Timoshenko's beam, two vibrations up and two aside, with and
without a mass at the tip. ccx_frequency: that to CalculiX's *FREQUENCY about rest and about a dead load, its
own element on one deck. Of the pressurised finger, ccx_answer: the relative difference of what a small force
at the tip moves, and ccx_perturbation: that of frequencies by *STEP, PERTURBATION. Its tangent has 1.75 times
the follower pressure's part of its own statics: ccx_turning is by what share the frequency of a finger on a
hinge and a spring changes with 3 kPa inside it, which do not turn a free body. Time steps, on a beam that is
let go: order, by which power of the step the error falls; energy: the largest change of a large vibration's
energy, over it; ccx_dynamic: the largest difference from CalculiX's *DYNAMIC, over the amplitude. Of the
reduced model, reduced_pull: rms of its error after a fast step over the one that it states, reduced_error:
the largest over the swing, s_per_film_s: seconds of processor a second of film, of a minute with a finger of
nine bellows; of it reduced_follow_s to follow the motion, reduced_certify_s to check it by whole steps.
--quick: a finger of one bellow, not three or nine.
"""

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.kernel.beams import DENSITY, Beam
from benchmarks.kernel.convergence import SHORT, SILICONE
from benchmarks.kernel.freemotions import BEAM, CELLS, against_calculix, bent, energy, let_go, off_a_cosine
from benchmarks.kernel.reducedmotions import COARSE, LEVELS, STUB, reduced_pull, s_per_film_s, stub
from benchmarks.kernel.vibrations import theirs, turning

import numpy as np

from fe import Case, finger_case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import Attached
from fe.dynamics.reduced import ReducedModel
from fe.dynamics.vibration import modes
from fe.engines.calculix import CalculiX
from fe.mesh.convert import converted

PRESSURE = 0.03  # MPa
PULL = np.array([0.3, 0.0, -0.3])  # N, on the half
PUSH = np.array([0.0, 0.0, -0.01])  # N, on the half
COUNT = 3


def beam_theory() -> float:
    """Largest relative difference to Timoshenko's beam."""
    worst = 0.0
    for beam in (Beam(), Beam(tip=2e-5)):
        masses = [Attached(beam.end, beam.tip)] if beam.tip else []
        found = modes(at_rest(beam.case(), HeldLoad()), count=4, attached=masses).frequency
        theory = [beam.timoshenko(n, sideways=s) for n in (0, 1) for s in (False, True)]
        worst = max(worst, float(np.abs(found / theory - 1).max()))
    return worst


def frequencies_of_calculix(case: Case) -> dict[str, float | None]:
    """Relative differences to CalculiX; none of them where it is not installed."""
    pulled = replace(case, forces={"tip_face": PULL}, pressurised=None)
    with tempfile.TemporaryDirectory() as scratch:

        def apart(structure: Case, pressure: float) -> float:
            found = modes(at_rest(structure, HeldLoad(pressure)), count=4 * COUNT)
            ours = found.frequency[~found.sideways][:COUNT]
            folder = Path(scratch, f"{pressure}-{len(structure.forces)}")
            return float(np.abs(theirs(structure, pressure, count=COUNT, folder=folder) / ours - 1).max())

        try:
            return {
                "ccx_frequency": max(apart(case, 0.0), apart(pulled, 0.0)), "ccx_answer": answer(case),
                "ccx_perturbation": apart(case, PRESSURE), "ccx_turning": turning(case, Path(scratch)),
            }  # fmt: skip
        except FileNotFoundError:
            return dict.fromkeys(("ccx_frequency", "ccx_answer", "ccx_perturbation", "ccx_turning"))


def answer(case: Case) -> float:
    """Relative difference to CalculiX of what a small force moves most under pressure."""
    pushed = replace(case, forces={"tip_face": PUSH})
    ours, other = (
        [run(c) for c in (case, pushed)]
        for run in (
            lambda c: at_rest(c, HeldLoad(PRESSURE)).state.u,
            lambda c: CalculiX().solve(c, PRESSURE).u,
        )
    )
    size = [float(np.linalg.norm(b - a, axis=1).max()) for a, b in (ours, other)]
    return abs(size[1] / size[0] - 1)


def time_steps() -> dict[str, float | None]:
    """The figures of time steps; ccx_dynamic None where CalculiX is not installed."""
    case = BEAM.case(CELLS)
    errors = [off_a_cosine(case, steps=n, radius=0.8) for n in (40, 80)]
    large, _ = let_go(case, bent(case, 1e-2), periods=2.0, steps=80, radius=1.0)
    total = energy(case, large)
    change = float(np.abs(total / total[0] - 1).max())
    out = {"order": float(np.log2(errors[0] / errors[1])), "energy": change}
    with tempfile.TemporaryDirectory() as scratch:
        try:
            return {**out, "ccx_dynamic": against_calculix(3e-3, Path(scratch))}
        except FileNotFoundError:
            return {**out, "ccx_dynamic": None}


def figures(quick: bool) -> dict[str, Any]:
    """The figures by name."""
    finger = finger_case(replace(SILICONE, density=DENSITY), finger=STUB if quick else SHORT, lattice=COARSE)
    theirs = frequencies_of_calculix(converted(finger, "C3D20RH"))
    filmed = stub() if quick else finger_case(replace(SILICONE, density=DENSITY), lattice=COARSE)
    reduced = reduced_pull(ReducedModel.of(stub(), LEVELS)) | s_per_film_s(filmed)
    return {"beam_theory": beam_theory(), **theirs, **time_steps(), **reduced}


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="a finger of one bellow"))
