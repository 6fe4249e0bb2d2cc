"""Finite elements for nearly incompressible soft bodies under pressure.

A case and a path in, a solution out; all numbers are in mm, N, MPa, s. Read `case`, `path` and `material`
(the problem) and `solving` (the one door). `element` has the element types, `terms` the formulas of the
material laws, compiled; `obstacles` are the shapes that a body may touch, `homogeneous` the stresses of a
material test in closed form. Then the rooms: `mesh` makes cases, `kernel` computes residual and tangent,
`solver` follows equilibria and their derivatives, `dynamics` gives vibrations about them, `deck` reads Abaqus
decks, `engines` writes decks and runs other programs.
"""

from fe.case import Block, Case, Clamp, Support
from fe.material import Material
from fe.mesh.finger import Finger, Lattice, finger_case
from fe.path import Path
from fe.solver.sensitivity import Variation
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
