"""Free vibrations of a beam that is let go: in time steps, by closed forms and by CalculiX."""

from dataclasses import replace
from pathlib import Path as Folder

from benchmarks.kernel.beams import Beam

import numpy as np

from fe import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.timesteps import Transient, inertia_of, transient
from fe.dynamics.vibration import modes
from fe.element import Array
from fe.engines.calculix import CalculiX
from fe.engines.writer import deck
from fe.mesh.convert import converted
from fe.path import Path

BEAM = Beam()
CELLS = (8, 1, 1)
AFTER = (  # a static step: the end is let go; in single precision of the answer, as CalculiX writes it
    "*STEP, NLGEOM, INC=100000\n*DYNAMIC, DIRECT\n{step:.9g}, {end:.9g}\n*CLOAD, OP=NEW\n"
    "*NODE FILE, FREQUENCY=1\nU\n*END STEP\n"
)


def tip_of(case: Case) -> int:
    """The row of the node in the middle of a beam's end."""
    return int(np.argmin(np.linalg.norm(case.nodes - BEAM.end, axis=1)))


def bent(case: Case, force: float) -> HeldLoad:
    """Forces of so many N in all that bend a beam into the shape of its first vibration."""
    x, first = case.nodes, modes(at_rest(case, HeldLoad()), count=1).shape[0][:, 2]
    on = np.flatnonzero((x[:, 1] < 1e-9) & (np.abs(x[:, 2] - BEAM.height / 2) < 1e-9) & (x[:, 0] > 1))
    share = first[on] * np.where(np.isclose(x[on, 0], BEAM.length), 0.5, 1.0)
    pulls = np.zeros((len(on), 3))
    pulls[:, 2] = -force * share / np.abs(share).sum()
    return HeldLoad(places=x[on], pulls=pulls)


def let_go(
    case: Case, held: HeldLoad, *, periods: float, steps: int, radius: float = 0.8
) -> tuple[Transient, float]:
    """The free motion after a load, in so many steps a period of the first vibration, and its frequency in
    Hz about rest."""
    frequency = float(modes(at_rest(case, HeldLoad()), count=1).frequency[0])
    end = periods / frequency
    path = Path(np.array([0.0, end]), np.zeros(2), np.linspace(0.0, end, round(50 * periods) + 1))
    found = transient(case, path, held=held, tolerance=1e9, longest=1 / frequency / steps, radius=radius)
    return found, frequency


def off_a_cosine(case: Case, *, steps: int, radius: float) -> float:
    """The largest difference of a small free vibration from a cosine of its frequency, over its amplitude."""
    found, frequency = let_go(case, bent(case, 2e-5), periods=1.5, steps=steps, radius=radius)
    z = found.u[:, tip_of(case), 2]
    return float(np.abs(z / z[0] - np.cos(2 * np.pi * frequency * found.time)).max())


def energy(case: Case, found: Transient) -> Array:
    """Kinetic and strain energy (s,) N mm of a motion of rubber, that of its change of volume left out."""
    problem, inertia = at_rest(case, HeldLoad()).problem, inertia_of(case)
    kernel, weight = problem.kernel, problem.geometry.weight
    strain = [(kernel.energies(u, problem.constants, problem.geometry) * weight).sum() for u in found.u]
    return np.array(strain) + np.array([inertia.energy(v) for v in found.velocity])


def against_calculix(force: float, folder: Folder, *, periods: float = 1.5, steps: int = 400) -> float:
    """The largest difference of the tip from CalculiX's *DYNAMIC, over the amplitude, after a force in N on
    half of the end is let go. FileNotFoundError where ccx is not installed, RuntimeError where it stops."""
    case = converted(BEAM.case(CELLS), "C3D20RH")
    end = np.flatnonzero(np.abs(case.nodes[:, 0] - BEAM.length) < 1e-6)
    case = replace(case, node_sets={**case.node_sets, "tip_face": end})
    period = 1 / float(modes(at_rest(case, HeldLoad()), count=1).frequency[0])
    pulled = deck(replace(case, forces={"tip_face": np.array([0.0, 0.0, -force])}), 0.0)
    pulled = pulled.replace("*NODE FILE\nU\n", "*NODE FILE\nU\n*EL FILE\nENER\n")  # which *DYNAMIC asks for
    later = AFTER.format(step=period / steps, end=periods * period)
    theirs = CalculiX().run(pulled + later, folder=folder)
    if not theirs.converged:
        raise RuntimeError(f"CalculiX: {theirs.reason}")
    held = HeldLoad(places=BEAM.end[None], pulls=np.array([[0.0, 0.0, -2 * force]]))
    path = Path(np.array([0.0, theirs.share[-1]]), np.zeros(2), theirs.share)
    ours = transient(case, path, held=held, tolerance=1e9, longest=2 * period / steps, radius=0.9)
    z = [u[:, tip_of(case), 2] for u in (ours.u, theirs.course)]
    return float(np.abs(z[0] - z[1]).max() / np.abs(z[1][0]))
