"""Cantilevers of rubber, and what beam theory says of their vibrations."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from fe import Case, Material, Support
from fe.element import Array
from fe.mesh.extruding import box_grid, extruded, hollow_case

DENSITY = 1.07e-9  # tonne/mm3
EULER = (1.8751040687, 4.6940911330, 7.8547574382)  # roots of 1 + cos b cosh b


@dataclass(frozen=True)
class Beam:
    """A cantilever of neo-Hookean rubber along x: mm, Young's modulus in MPa; tip: mass in tonne at its end.
    """

    length: float = 200.0
    width: float = 14.0
    height: float = 10.0
    young: float = 0.6
    density: float = DENSITY
    tip: float = 0.0

    def case(self, cells: tuple[int, int, int] = (16, 1, 2)) -> Case:
        """The half y >= 0; the section at x = 0 keeps its plane but may become narrower, as in beam theory.
        """
        along, across, up = cells
        y, z = np.linspace(0, self.width / 2, across + 1), np.linspace(0, self.height, up + 1)
        solid = np.ones(along * across * up, bool)
        x = extruded(box_grid(y, z), np.linspace(0, self.length, along + 1)).reshape(-1, 27, 3)
        material = Material(C10=self.young / 6, density=self.density)
        case = hollow_case(x, solid, material=material, marks={})
        root = case.node_sets["clamp"]
        level = root[np.abs(case.nodes[root, 2] - self.height / 2) < 1e-9]
        upright = root[case.nodes[root, 1] < 1e-9]
        held = (Support("clamp", (0,)), Support("level", (2,)), Support("upright", (1,)))
        sets = {**case.node_sets, "level": level, "upright": upright}
        return replace(case, clamp=None, node_sets=sets, supports=(*case.supports, *held))

    @property
    def end(self) -> Array:
        """The middle (3,) mm of the end face."""
        return np.array([self.length, 0.0, self.height / 2])

    def euler(self, number: int = 0, *, sideways: bool = False) -> float:
        """Frequency in Hz of a slender beam without a mass at its tip, b^2 / (2 pi L^2) sqrt(E I / (rho A)).
        """
        depth = self.width if sideways else self.height
        return float(EULER[number] ** 2 / (2 * np.pi * self.length**2)
                     * np.sqrt(self.young / self.density / 12) * depth)  # fmt: skip

    def timoshenko(self, number: int = 0, *, sideways: bool = False) -> float:
        """Frequency in Hz with shear, rotary inertia (Timoshenko 1921, doi 10.1080/14786442108636264; shear
        coefficient of Cowper 1966, doi 10.1115/1.3625046, at Poisson's ratio 1/2) and the mass at the tip.
        """
        area, depth = self.width * self.height, self.width if sideways else self.height
        inertia, shear = area * depth**2 / 12, self.young / 3
        kappa = 10 * 1.5 / (12 + 11 * 0.5)

        def gap(omega: float) -> float:
            # deflection, turn of the section, moment, shear force; held at one end, free at the other
            A = np.zeros((4, 4))
            A[0, 1], A[0, 3] = 1.0, 1 / (kappa * shear * area)
            A[1, 2] = 1 / (self.young * inertia)
            A[2, 1], A[2, 3] = -self.density * inertia * omega**2, -1.0
            A[3, 0] = -self.density * area * omega**2
            to = expm(A * self.length)
            # the tip's mass takes the shear force that its motion asks for
            rows = np.array([to[2], to[3] - self.tip * omega**2 * to[0]])[:, 2:]
            return float(np.linalg.det(rows))

        slender = 2 * np.pi * self.euler(number, sideways=sideways)
        grid = np.linspace(1e-3 * slender, 1.02 * slender, 400)
        values = [gap(w) for w in grid]
        turns = [k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0]
        k = turns[number]
        return float(brentq(gap, grid[k], grid[k + 1])) / (2 * np.pi)
