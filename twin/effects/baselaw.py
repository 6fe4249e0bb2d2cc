"""The law of the base model and its two constants: their names, bounds and nominal values stand here once.

The silicone is Mooney-Rivlin rubber. Where pressure alone loads one material, displacements depend on
pressure / (C10 + C01) and on the share C01 / (C10 + C01) only: hence `total` and `share`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass


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
# With a smaller one C10 + l^2 C01, without which rubber shears on by itself, is negative at a stretch l of
# 1.63 (Baker & Ericksen 1954, doi 10.1007/978-3-642-88691-1_6). Ogden's exponent 4 with C20 has -0.5.
LEAST_SHARE = -0.6
TYPICAL = 0.02  # MPa, a change of either that shows
