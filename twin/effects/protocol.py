"""What a physical effect is: two pure maps, of what goes into a prediction and of what comes out.

An effect never states a derivative: `Model` differences its maps. At its null values a prediction equals
the base, bit for bit on the same mesh (`Model.over`: half of a symmetric one, or all of it).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calibrate import Parameter
from fe import Case, Path
from twin.targets import Array

Theta = Mapping[str, float]


class Unsolvable(Exception):
    """The model has no equilibrium for these parameters; the message says how far it came, or why."""


@dataclass(frozen=True)
class Test:
    """All that a prediction needs: a case, a pressure path, and material points (p, 3) mm that may move or
    not."""

    __test__ = False  # the name is the field's word; pytest must not collect it

    case: Case
    path: Path
    points: Array
    moving: Any  # (p,) bool: False for fixed markers, whose displacement is 0


class Effect:
    """A physical effect: `name`, `parameters` (named `<effect>.<parameter>`), and two pure maps.

    order: maps are applied by increasing order, never by the order of adding (material 10, support 20, gauge
    40, line 50, camera 80). grid: values at which a parameter that is invisible at null is tried. requires:
    what the data must hold ("history", "unloading", "gravity"; see `procedure.lacking`). sentence: what
    is physically meant, for the report.
    """

    smooth: bool = True  # False: its signature is the difference of whole solves, not of first order
    name: str = ""
    sentence: str = ""
    order: int = 0
    parameters: tuple[Parameter, ...] = ()
    grid: tuple[Theta, ...] = ()
    requires: tuple[str, ...] = ()

    def before(self, test: Test, theta: Theta) -> Test:
        """The test with the effect in it; at null values the same object's content."""
        del theta
        return test

    def breaks_symmetry(self, test: Test) -> bool:
        """Whether it loads or shapes the halves y > 0 and y < 0 of the test differently; then the whole is
        modelled. Nothing but this says so."""
        del test
        return False

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        """What the camera makes of displacements u (s, p, 3) mm of the test's points."""
        del test, theta
        return u

    @property
    def label(self) -> str:
        """How twin.toml writes it: the name, with its number of terms where there is a choice."""
        return self.name

    def wider(self) -> "Effect | None":
        """The same physics with a richer law, to be tried where this one is inadequate."""
        return None

    def start(self, theta: Theta) -> Theta:
        """Starting values, from those of the narrower law."""
        return theta
