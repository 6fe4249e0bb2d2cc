"""Finite elements for nearly incompressible soft bodies under pressure.

A case and a path in, a solution out; all numbers are in mm, N, MPa, s. Read `case`, `path` and `laws`
(what is solved) and `solving` (the one door). `element` has the element types, `terms` the laws' formulas,
compiled; `obstacles` are the shapes that a body may touch, `homogeneous` what a test of the silicone itself
measures, in closed form. Then the rooms: `mesh` makes cases, `kernel` knows residual and tangent, `solver`
follows equilibria and their derivatives, `deck` speaks with other programs.
"""

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
