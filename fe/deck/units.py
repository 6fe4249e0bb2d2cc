"""Units of a deck, by default mm, N, MPa, s; a comment may declare others: `** units: m, N, s`."""

from dataclasses import dataclass, replace

from fe.case import Case
from fe.deck.keywords import Place

LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "inch": 25.4}  # in mm
FORCES = {"n": 1.0, "kn": 1e3}  # in N
STRESSES = {"pa": 1e-6, "kpa": 1e-3, "mpa": 1.0, "gpa": 1e3}  # in MPa
MASSES = {"g": 1e-6, "kg": 1e-3, "t": 1.0, "tonne": 1.0}  # in tonne
KNOWN = {"length": LENGTHS, "force": FORCES, "stress": STRESSES, "mass": MASSES, "time": {"s": 1.0}}
SAME = 1e-6


@dataclass(frozen=True)
class Units:
    """Units of a deck: length in mm, stress in MPa; times are in s.

    >>> Units(length=1000.0, stress=1e-6).force  # m and Pa: the force is in N
    1.0
    """

    length: float = 1.0
    stress: float = 1.0

    @property
    def density(self) -> float:
        """The deck's unit of density in tonne/mm3: force s2 / length^4."""
        return self.stress / self.length**2

    @property
    def force(self) -> float:
        """The deck's unit of force in N."""
        return self.stress * self.length**2

    def applied(self, case: Case) -> Case:
        """A case in these units, converted into mm, N, MPa."""
        if self == Units():
            return case
        materials = {
            name: replace(m.stiffened(self.stress), density=m.density * self.density)
            for name, m in case.materials.items()
        }
        supports = tuple(
            s if s.value is None else replace(s, value=self.length * s.value) for s in case.supports
        )
        forces = {name: self.force * f for name, f in case.forces.items()}
        layers = tuple(replace(y, stiffness=self.stress * self.length * y.stiffness) for y in case.layers)  # type: ignore[operator]
        ties = tuple(replace(t, reach=self.length * t.reach) for t in case.ties)
        return replace(
            case, nodes=self.length * case.nodes, materials=materials, supports=supports, forces=forces,
            layers=layers, ties=ties,
        )  # fmt: skip


def declared(comment: tuple[Place, str] | None) -> tuple[Units, str]:
    """Units declared by a comment, by default mm, N, MPa; and a remark where the comment is not understood.
    ValueError for an unknown unit beside known ones, and for contradicting units."""
    if comment is None:
        return Units(), ""
    place, text = comment
    scales: dict[str, float] = {}
    words = [w.strip() for w in text.replace(";", ",").split(",")]
    if not any(w.lower() in units for w in words for units in KNOWN.values()):
        return Units(), f"The comment on units, {text}, is not understood: mm, N, MPa and s are taken."
    for word in words:
        kind = next((k for k, units in KNOWN.items() if word.lower() in units), None)
        if kind is None or kind in scales:
            raise ValueError(
                f"{place}: units {text}: wanted one length, force or stress, mass and time of "
                f"{', '.join(name for units in KNOWN.values() for name in units)}, as in ** units: mm, N, s"
            )
        scales[kind] = KNOWN[kind][word.lower()]
    length = scales.get("length", 1.0)
    stress = scales.get("stress", scales.get("force", 1.0) / length**2)
    units = Units(length, stress)
    for kind, derived in (("force", units.force), ("mass", units.force / length)):
        if kind in scales and abs(scales[kind] - derived) > SAME * derived:
            raise ValueError(
                f"{place}: units {text}: the {kind} does not go with the others, for which it would be "
                f"{derived:.4g} {'N' if kind == 'force' else 'tonne'}; leave it out or correct it"
            )
    return units, ""
