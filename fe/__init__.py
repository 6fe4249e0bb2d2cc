"""Case in, solution out: a mixed finite-element kernel for nearly incompressible bodies (mm, N, MPa, s)."""

from fe.case import Block, Case, Clamp, Support
from fe.laws import Material
from fe.mesh.finger import Finger, Lattice, finger_case
from fe.path import Path
from fe.solver.varied import Variation
from fe.solving import Solution, solve

__all__ = [
    "Block",
    "Case",
    "Clamp",
    "Finger",
    "Lattice",
    "Material",
    "Path",
    "Solution",
    "Support",
    "Variation",
    "finger_case",
    "solve",
]
