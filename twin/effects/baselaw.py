"""The law of the base model and its two constants: their names, bounds and nominal values stand here once.

The silicone is Mooney-Rivlin rubber. Where pressure alone loads one material, displacements depend on
pressure / (C10 + C01) and on the share C01 / (C10 + C01) only: hence `total` and `share`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from fe import Case


@dataclass(frozen=True)
class Constants:
    """The constants C10 and C01 of Mooney-Rivlin rubber in MPa."""

    C10: float
    C01: float

    @staticmethod
    def of(values: Mapping[str, float]) -> "Constants":
        """The constants among named values."""
        return Constants(**{name: float(values[name]) for name in NAMES})

    @staticmethod
    def at(total: float, share: float) -> "Constants":
        """The constants of a total C10 + C01 in MPa and a share C01 / (C10 + C01)."""
        return Constants((1 - share) * total, share * total)

    @property
    def total(self) -> float:
        """C10 + C01 in MPa."""
        return self.C10 + self.C01

    @property
    def share(self) -> float:
        """C01 / (C10 + C01), without unit."""
        return self.C01 / self.total

    @property
    def named(self) -> dict[str, float]:
        """The values by their names."""
        return asdict(self)


NAMES = ("C10", "C01")
NOMINAL = Constants(0.2, 0.1)  # MPa, until they are fitted
BOUNDS = {"C10": (0.01, 0.5), "C01": (0.0, 0.5)}  # MPa, where twin.toml states no others
STRETCH = 1.63  # to which rubber must be stable; the built-in finger reaches 1.47 at 30 kPa
LEAST_SHARE = -0.6  # that Mooney-Rivlin rubber may have for it; Ogden's exponent 4 with C20 has -0.5
WIDEST_SHARE = -2.0  # with terms beside C10 and C01, which make it stable: Ogden's exponent 10
TYPICAL = 0.02  # MPa, a change of either that shows


def steadiness(case: Case) -> float:
    """The least `Material.steadiness` of the materials of a case up to STRETCH, but for those kept."""
    own = [m for name, m in case.materials.items() if name not in case.kept]
    return min((m.steadiness(STRETCH) for m in own), default=1.0)
