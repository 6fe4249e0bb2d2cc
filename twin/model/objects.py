"""A rigid object that a finger meets: what is typed for it, and a case with it.

`cylinder:d=40,x=70,z=-30` is a cylinder of 40 mm in diameter whose axis passes through x = 70, z = -30 mm
along the one axis that is not named, here y; `sphere:d=..,x=..,y=..,z=..`; and
`plane:nx=..,ny=..,nz=..,distance=..` is all that lies behind a plane whose normal points to the finger.
`friction=0.4` is Coulomb's coefficient. `spring=2` lets the object give way along z (a plane along its
normal), by 1 mm for every 2 N; `along=x` makes that x.
"""

from dataclasses import dataclass, replace

import numpy as np

from fe import Case
from fe.case import Contact, Spring
from fe.kernel.contact import off_the_clamp
from fe.mesh.mirror import middle_plane, mirrored, symmetry_support
from fe.obstacles import Flat, Obstacle, Round

STIFFNESS = 5.0  # MPa/mm: ten times as much changes the force of a short finger on a cylinder by 0.1 %
AXES = "xyz"
NEEDED = {"cylinder": ("d",), "sphere": ("d", "x", "y", "z"), "plane": ("nx", "ny", "nz", "distance")}
ALLOWED = {"cylinder": ("x", "y", "z"), "sphere": (), "plane": ()}
OPTIONS = ("friction", "spring", "along")
Way = tuple[float, float, float]


@dataclass(frozen=True)
class RigidObject:
    """An object: as it was typed, its shape, Coulomb's coefficient of friction, and where it is on a spring
    that spring's stiffness in N/mm and its way (3,)."""

    text: str
    shape: Obstacle
    friction: float = 0.0
    spring: float | None = None
    way: Way = (0.0, 0.0, 1.0)

    @staticmethod
    def of(text: str) -> "RigidObject":
        """The object that a text states. ValueError where it states none.

        >>> rigid = RigidObject.of("cylinder:d=40,x=70,z=-30,friction=0.4")
        >>> rigid.friction, rigid.shape.radius
        (0.4, 20.0)
        """
        kind, _, rest = text.partition(":")
        if kind not in NEEDED:
            raise ValueError(
                f"object {text!r}: wanted a cylinder, sphere or plane, such as cylinder:d=40,x=70,z=-30 (mm)"
            )
        pairs = [part.partition("=")[::2] for part in rest.split(",") if part]
        words = dict(pairs)
        if len(words) < len(pairs):
            twice = next(key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1)
            raise ValueError(f"object {text!r}: {twice} stands twice; wanted each key once")
        along = words.pop("along", "")
        values = {key: _number(text, key, word) for key, word in words.items()}
        keys = (*NEEDED[kind], *ALLOWED[kind], *OPTIONS)
        for key in values:
            if key not in keys:
                raise ValueError(f"object {text!r}: a {kind} has no {key}; wanted {', '.join(keys)}")
        for key in NEEDED[kind]:
            if key not in values:
                raise ValueError(f"object {text!r}: no {key}; a {kind} needs {', '.join(NEEDED[kind])}")
        for key, least in (("d", "above 0 mm"), ("spring", "above 0 N/mm")):
            if not values.get(key, 1.0) > 0:
                raise ValueError(f"object {text!r}: {key}={values[key]:g}, wanted {least}")
        if not 0 <= (friction := values.get("friction", 0.0)) <= 2:
            raise ValueError(f"object {text!r}: friction={friction:g}, wanted a coefficient from 0 to 2")
        shape = _shape(text, kind, values)
        axis = _way(text, along, shape)
        return RigidObject(text, shape, friction, values.get("spring"), axis)

    def beside(self, case: Case) -> Case:
        """The case with the object, of the whole finger where its halves meet the object differently.

        ValueError where the object overlaps the finger at rest, or it is not known what may touch.
        """
        if "outside" not in case.surfaces:
            raise ValueError(
                f"object {self.text!r}: the model has no surface 'outside', wanted the faces that may touch; "
                f"name them so (there are {', '.join(case.surfaces) or 'none'})"
            )
        rows = np.unique(case.face_nodes("outside")[off_the_clamp(case, "outside")])
        height = self.shape.height(case.nodes[rows])
        if (inside := -float(height.min())) > 0:
            place = ", ".join(f"{v:.3g}" for v in case.nodes[rows[height.argmin()]])
            raise ValueError(
                f"object {self.text!r} reaches {inside:.3g} mm into the finger at rest, at ({place}) mm; "
                "wanted one that does not touch it before it is inflated: move it away"
            )
        half = symmetry_support(case) is not None
        if half and not self._even(middle_plane(case)):
            case, half = mirrored(case), False
        spring = None if self.spring is None else Spring(self.spring * (0.5 if half else 1.0), self.way)
        touch = Contact("outside", self.shape, STIFFNESS, self.friction, spring)
        return replace(case, contact=touch)

    def _even(self, y: float) -> bool:
        """True if both halves of a finger that is symmetric about the plane y in mm meet it alike."""
        return self.shape.even(y) and (self.spring is None or self.way[1] == 0)


def _number(text: str, key: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"object {text!r}: {key}={word!r}, wanted a number (mm; spring in N/mm)")
    return value


def _shape(text: str, kind: str, v: dict[str, float]) -> Obstacle:
    if kind == "plane":
        normal = (v["nx"], v["ny"], v["nz"])
        if not any(normal):
            raise ValueError(f"object {text!r}: a normal of no length; wanted its direction, such as nz=1")
        return Flat(normal, v["distance"])
    axes = [axis for axis in AXES if axis in v]
    if kind == "cylinder" and len(axes) != 2:
        raise ValueError(
            f"object {text!r}: wanted two of x, y and z in mm: where its axis is, along the third"
        )
    place = (v.get("x", 0.0), v.get("y", 0.0), v.get("z", 0.0))
    free_axes = set(AXES) - set(axes)
    return Round(place, v["d"] / 2, _unit(free_axes.pop()) if free_axes else None)


def _way(text: str, along: str, shape: Obstacle) -> Way:
    if along and along not in tuple(AXES):
        raise ValueError(f"object {text!r}: along={along!r}, wanted x, y or z, the way of its spring")
    if not along and isinstance(shape, Flat):
        return shape.normal
    return _unit(along or "z")


def _unit(axis: str) -> Way:
    return (float(axis == "x"), float(axis == "y"), float(axis == "z"))
