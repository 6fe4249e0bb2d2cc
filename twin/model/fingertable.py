"""Load paths and finer meshes of two fingers, at their outer nodes, as they come with the package: of the
built-in finger by default, and of the short one that `twin demo --quick` films.

Under pressure alone, displacements of Mooney-Rivlin rubber depend on pressure / scale and the share alone. So
a few paths serve every test of a finger, wherever its markers are. benchmarks/kernel/fingertable.py solves
them; they are kept as sums of a few fields, to 2e-5 mm.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fe import Case
from fe.element import Integers
from fe.mesh.points import interpolation, nearest
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NOMINAL
from twin.model.loadpaths import LoadPaths
from twin.model.structure import Mesh, Structure
from twin.targets import Array

FILES = {"default": "fingertable.npz", "quick": "fingertable-quick.npz"}  # of each finger
PATHS = "paths"
PARTS = ("nodes", "weights", "basis")


@dataclass(frozen=True)
class FieldSums:
    """Displacements of some nodes (m,) of a mesh in several states: weights (.., b) of fields basis (b, m, 3)
    mm."""

    nodes: Integers
    weights: Array
    basis: NDArray[np.floating]

    @staticmethod
    def of(nodes: Integers, u: Array, within: float) -> "FieldSums":
        """Fields u (.., m, 3) mm as sums of as few as leave at most `within` mm of any value."""
        flat = u.reshape(-1, u.shape[-2] * 3)
        vectors, size, right = np.linalg.svd(flat, full_matrices=False)
        weights, count = vectors * size, 1
        while np.abs(weights[:, :count] @ right[:count] - flat).max() > within:
            count += 1
        basis = right[:count].astype(np.float32).reshape(count, -1, 3)
        return FieldSums(nodes, weights[:, :count].reshape(*u.shape[:-2], count), basis)

    def at(self, case: Case, points: Array) -> Array:
        """The displacements (.., p, 3) mm of the points of a case's surface nearest to places (p, 3) mm."""
        operator = interpolation(case, np.array([nearest(case, x) for x in points]))[:, self.nodes]
        return np.asarray(np.tensordot(self.weights, np.stack([operator @ f for f in self.basis]), 1))


@dataclass(frozen=True)
class KnownFinger:
    """The solutions of a structure that come with the package.

    paths: its own mesh at shares (h,) and reduced (k,) pressures p / scale, followed to reached (h,);
    meshes: every mesh at the nominal share and the pressures `fine` (k,), by its key.
    """

    key: str
    shares: Array
    reduced: Array
    reached: Array
    fine: Array
    paths: FieldSums
    meshes: Mapping[str, FieldSums]

    def load_paths(self, case: Case, points: Array) -> LoadPaths:
        """The load paths (`loadpaths.load_paths`) at material points (p, 3) mm, for shares from 0 on."""
        ends = tuple(shape.ends(wide=False) for shape in MOONEY_RIVLIN.shapes)
        return LoadPaths((self.shares,), ends, self.reduced, self.paths.at(case, points), self.reached)

    def serves(self, constants: Constants, top: float) -> bool:
        """True if it has the finer meshes at these constants up to a pressure in MPa."""
        nominal = constants.law == MOONEY_RIVLIN and constants.shape == NOMINAL.shape
        return nominal and top / constants.scale <= self.fine[-1]

    def response(self, mesh: Mesh, *, constants: Constants, pressure: Array, points: Array) -> Array:
        """Displacements (k, p, 3) mm of points (p, 3) mm on a mesh, at pressures (k,) MPa."""
        u = self.meshes[mesh.key].at(mesh.build(), points)
        curve = scipy.interpolate.CubicSpline(self.fine, u, axis=0)
        return np.asarray(curve(pressure / constants.scale))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of its file."""
        fields = {PATHS: self.paths, **self.meshes}
        return {
            "key": np.array(self.key), "shares": self.shares, "reduced": self.reduced,
            "reached": self.reached, "fine": self.fine,
            **{f"{name}.{part}": getattr(f, part) for name, f in fields.items() for part in PARTS},
        }  # fmt: skip

    @staticmethod
    def read(arrays: Mapping[str, NDArray[Any]]) -> "KnownFinger":
        """The table in the arrays of a file."""
        names = [name.removesuffix(".basis") for name in arrays if name.endswith(".basis")]
        fields = {n: FieldSums(*(arrays[f"{n}.{part}"] for part in PARTS)) for n in names}
        axes = {name: arrays[name] for name in ("shares", "reduced", "reached", "fine")}
        return KnownFinger(key=str(arrays["key"]), paths=fields.pop(PATHS), meshes=fields, **axes)


def table_of(structure: Structure) -> KnownFinger | None:
    """The table of a structure, where the package brings it; else None."""
    return _shipped(structure.key)


@cache
def _shipped(key: str) -> KnownFinger | None:
    for name in FILES.values():
        file = resources.files(__package__) / name
        if not file.is_file():
            continue
        with file.open("rb") as stream, np.load(stream) as arrays:
            if str(arrays["key"]) == key:  # read from the file alone: the rest is large
                return KnownFinger.read(dict(arrays))
    return None
