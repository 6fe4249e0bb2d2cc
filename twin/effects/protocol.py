"""The protocol of a physical effect: two pure maps, one of a prediction's input and one of its output.

An effect never states a derivative: `Model` differences its maps. At its null values a prediction equals
the base, bit for bit on the same mesh (`Model.over`: half of a symmetric one, or all of it).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

from calibrate import Parameter
from fe import Case, Path
from fe.mesh.mirror import symmetry_support
from twin.effects.labels import KINDS, NAME
from twin.effects.mechanism import Mechanism, Owner
from twin.effects.origin import Origin, sent
from twin.effects.requirements import Requirement
from twin.laws.law import RubberLaw
from twin.targets import Array

Theta = Mapping[str, float]


class Unsolvable(Exception):
    """The model has no equilibrium for these parameters; the message says how far it came, or why.

    reached: pressure in MPa up to which it has, 0 where nothing can be solved.
    """

    def __init__(self, why: str, *, reached: float = 0.0) -> None:
        super().__init__(why)
        self.reached = reached


class Order(IntEnum):
    """When an effect's maps are applied: from first to last, whatever order the effects were added in.

    Two effects of the same order must give the same result in either sequence.
    """

    LAW = 0  # the base material, to which all others add
    GEOMETRY = 5
    MATERIAL = 10
    SUPPORT = 20  # supports, outside forces, contact
    COURSE = 30  # what perturbs all of that by a course of its own: one `Perturbation` each
    GAUGE_GAIN = 40  # the pressure: first what the gauge read wrong, then what the hose made of it
    GAUGE_OFFSET = 41
    LINE = 50
    MOTION = 55  # how the finger follows the pressure in its chamber
    CLOCK = 60
    SLIP = 70  # markers, then the picture of them
    CAMERA = 80


def mechanism_of(order: Order) -> Mechanism:
    """The mechanism of an effect whose maps are applied at an order, where it states no other.

    >>> str(mechanism_of(Order.LINE))
    'course of the pressure and clock'
    """
    ends = (
        (Order.LAW, Mechanism.LAW), (Order.GEOMETRY, Mechanism.BODY), (Order.MATERIAL, Mechanism.LAW),
        (Order.COURSE, Mechanism.LOAD), (Order.CLOCK, Mechanism.COURSE), (Order.CAMERA, Mechanism.PICTURE),
    )  # fmt: skip
    return next(mechanism for end, mechanism in ends if order <= end)


@dataclass(frozen=True)
class Slip:
    """A marker, by its row among the points, that from `time` s on sits `size` mm further along `axis` (3,),
    a unit vector, as the structure lies undeformed. turns: it stands off the surface, whose turn it follows
    as a rigid body does; else it follows the body's own strain."""

    row: int
    time: float
    size: float
    axis: Array
    turns: bool = False


@dataclass(frozen=True)
class Perturbation:
    """A small change of the case, half the difference of two, that acts on displacements to first order,
    times a `course` (s,) at every output; none where both are one object."""

    plus: Case
    minus: Case
    course: Array


@dataclass(frozen=True, eq=False)
class SeenAtRest:
    """Places (p, 3) mm at rest that tell material points, NaN where these are stated, and the outputs (r,) at
    which they were seen."""

    places: Array
    steps: Any


@dataclass(frozen=True)
class Test:
    """All that a prediction needs: a case, a pressure path, and material points (p, 3) mm that may move or
    not, with names, and that may slip; what perturbs it beside; and where points are seen at rest, if that
    tells which they are."""

    __test__ = False  # the name is the field's word; pytest must not collect it

    case: Case
    path: Path
    points: Array
    moving: Any  # (p,) bool: False for fixed markers, whose displacement is 0
    names: tuple[str, ...] = ()  # (p,) of the points, where they have any
    slips: tuple[Slip, ...] = ()
    perturbations: tuple[Perturbation, ...] = ()
    rest: SeenAtRest | None = None

    @property
    def markers(self) -> tuple[str, ...]:
        """Names (p,) of the points, p1, p2 .. where they have none."""
        return self.names or tuple(f"p{k}" for k in range(1, len(self.points) + 1))

    @property
    def share(self) -> float:
        """The share of the whole structure's forces and moments that the case carries: 0.5 for a half."""
        return 1.0 if symmetry_support(self.case) is None else 0.5


class Effect:
    """A physical effect: a name, parameters, and two pure maps.

    name: as twin.toml writes it, of small letters, digits and _. sentence: what is physically meant, for the
    report. order: when its maps are applied. parameters: each named `<effect>.<parameter>`; a null is the
    value at which the effect is absent. grid: values at which parameters that are invisible at null are
    tried, on any test; `tries` where they depend on the test. requires: what the data must hold, else the
    effect is listed as not testable. smooth: False where its signature is the difference of whole solves, not
    of first order. kind: that of a stand-in, nothing for all others. generic: the kind of stand-in that says
    the same in general, `outside force`, and so is no other explanation. mechanism: its class of physics, by
    default that of its order. belongs: what has it, silicone, body or rig, by default `owner` of its
    mechanism. held: a label that `at` may give it, for who mistypes one.

    Raises ValueError where a class is defined with a name, an order, a requirement or a kind that does not
    exist.

    >>> class Cable(Effect):
    ...     name, order, sentence = "cable", Order.SUPPORT, "a cable pulls at the tip"
    ...     parameters = symmetric("cable.up", most=1.0, unit="N", step=0.02, likely=0.2)
    >>> cable = Cable()
    >>> cable.label, [(p.name, p.null, p.unit) for p in cable.amplitudes]
    ('cable', [('cable.up', 0.0, 'N')])
    >>> cable.lacks(None), cable.wide()  # it needs nothing of a structure, and has no wider law
    ('', None)
    """

    name: str = ""
    sentence: str = ""
    order: Order = Order.SUPPORT
    parameters: tuple[Parameter, ...] = ()
    grid: tuple[Theta, ...] = ()
    requires: tuple[Requirement, ...] = ()
    smooth: bool = True
    kind: str = ""
    generic: str = ""
    mechanism: Mechanism = Mechanism.LOAD
    belongs: Owner | None = None
    held: str = ""
    origin: ClassVar[Origin | None] = None  # the file of the user's that defines it; set where that is read

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.name and not NAME.fullmatch(cls.name):
            raise ValueError(f"effect {cls.name!r}: wanted a name of small letters, digits and _: my_effect")
        order: object = cls.order  # a file of the user's may have anything here
        if not isinstance(order, Order):
            names = ", ".join(f"Order.{o.name}" for o in Order)
            raise ValueError(f"effect {cls.name!r}: order = {order!r}, wanted one of {names}")
        if "order" in vars(cls) and "mechanism" not in vars(cls):
            cls.mechanism = mechanism_of(order)
        cls.requires = tuple(_requirement(cls.name, r) for r in cls.requires)
        if cls.generic and cls.generic not in KINDS:
            raise ValueError(f"effect {cls.name!r}: {cls.generic!r} is no kind of stand-in, wanted one of "
                             f"{', '.join(map(repr, KINDS))}")  # fmt: skip

    def __reduce_ex__(self, protocol: Any) -> Any:
        """The pickle for a worker process; of an effect from a file it holds the file's text."""
        if self.origin is None:
            return super().__reduce_ex__(protocol)
        return sent(self.origin, self)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The parameters that have a null: how much of the effect there is."""
        return tuple(p for p in self.parameters if p.null is not None)

    def tries(self, test: Test) -> tuple[Theta, ...]:
        """Values at which the parameters without a null are tried on a test; at least one entry, which may be
        empty."""
        del test
        return self.grid or ({},)

    def at(self, entry: Theta, test: Test) -> "Effect":
        """The effect that is fitted where an entry of its `tries` on a test shows most: itself, or a copy
        that holds what cannot be fitted, such as a marker's number, under a label that twin.toml can name
        again."""
        del entry, test
        return self

    def closer(self, entry: Theta, test: Test) -> "Effect | None":
        """The effect with a finer grid of `tries` about an entry, where the grid is coarser than the data."""
        del entry, test
        return None

    def named(self, label: str) -> "Effect | None":
        """The effect that a label of twin.toml names, where `at` or `wide` make it; None for all other
        labels."""
        wide = self.wide()
        return wide if wide is not None and wide.label == label else None

    def before(self, test: Test, theta: Theta) -> Test:
        """The test with the effect in it; unchanged at null values."""
        del theta
        return test

    def lacks(self, case: Case) -> str:
        """The lack of a structure for which the effect has no meaning, "no chamber"; "" where it has one.
        With a lack `before` changes nothing."""
        del case
        return ""

    def breaks_symmetry(self, test: Test) -> bool:
        """True if it loads or shapes the halves y > 0 and y < 0 of the test differently; then the whole is
        modelled."""
        del test
        return False

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        """Displacements (s, p, 3) mm as the camera sees them, from u (s, p, 3) mm of the test's points."""
        del test, theta
        return u

    def told(self, values: Theta) -> str:
        """The effect in words at fitted values of its parameters by name: a clause with sizes, units and
        directions, "the core lies 0.4 mm too high (towards +z)"; by default the sentence alone."""
        del values
        return self.sentence

    @property
    def label(self) -> str:
        """The effect as twin.toml writes it: its name, with its number of terms where there is a choice."""
        return self.name

    @property
    def owner(self) -> Owner:
        """What has the effect: another finger of the same silicone has it if that is the silicone.

        >>> from twin.effects.library import effect
        >>> print(*(effect(name).owner for name in ("creep:2", "wall_taper", "camera_scale")))
        silicone body rig
        """
        return self.belongs or self.mechanism.owner

    def beside(self, law: RubberLaw) -> "Effect":
        """The effect in a model whose silicone is of a law: its words and constants say what that lacks. By
        default the same, as most physics is beside any law."""
        del law
        return self

    def laws(self) -> tuple["Effect", ...]:
        """All laws of this physics that can be named in twin.toml, the narrowest first."""
        return (self,)

    def wider(self) -> "Effect | None":
        """The next richer law of this physics, tried where this one is inadequate; None for the richest."""
        return None

    def wide(self) -> "Effect | None":
        """The widest family of this physics, with amplitudes alone on a fixed basis; None where the laws hold
        all that is known. Its `start` maps the values of any law into it, as nearly as it can."""
        return None

    def start(self, theta: Theta) -> Theta:
        """Starting values of the parameters, from values of the narrower law."""
        return theta


class Family(Effect):
    """An effect with laws of one, two or more terms, `creep` and `creep:2`; the wider holds the narrower.

    most: terms of its widest law. widens: whether `twin diagnose` tries a wider law by itself. added: values
    at which the parameters of a wider law start. ValueError for a number of terms that it does not have.
    """

    most: int = 2
    widens: bool = True
    added: ClassVar[Theta] = {}

    def __init__(self, terms: int = 1) -> None:
        if not 1 <= terms <= self.most:
            raise ValueError(f"effect {self.name!r} has no law with {terms} terms, wanted 1 to {self.most}")
        self.terms = terms
        self.parameters = self.law(terms)
        self.grid = self.tried(terms)

    def law(self, terms: int) -> tuple[Parameter, ...]:
        """The parameters of the law with `terms` terms."""
        raise NotImplementedError

    def tried(self, terms: int) -> tuple[Theta, ...]:
        """The grid of the law with `terms` terms."""
        del terms
        return ()

    @property
    def label(self) -> str:
        return self.name if self.terms == 1 else f"{self.name}:{self.terms}"

    def again(self, terms: int) -> Effect:
        """The effect of this physics whose law has `terms` terms."""
        return type(self)(terms)

    def laws(self) -> tuple[Effect, ...]:
        return tuple(self.again(terms) for terms in range(1, self.most + 1))

    def wider(self) -> Effect | None:
        return self.again(self.terms + 1) if self.widens and self.terms < self.most else None

    def start(self, theta: Theta) -> Theta:
        own = {p.name for p in self.parameters}
        return {**{name: x for name, x in self.added.items() if name in own}, **theta}


def symmetric(*names: str, most: float, unit: str, step: float, likely: float) -> tuple[Parameter, ...]:
    """Amplitudes of either sign: 0 where the effect is absent, from -most to most, plausible from -likely to
    likely; a change by `step` shows.

    >>> (gain,) = symmetric("gain.share", most=0.3, unit="", step=0.02, likely=0.1)
    >>> gain.low, gain.high, gain.null, gain.plausible
    (-0.3, 0.3, 0.0, (-0.1, 0.1))
    """
    return tuple(
        Parameter(name, -most, most, unit, null=0.0, typical=step, plausible=(-likely, likely))
        for name in names
    )


def _requirement(name: str, value: str) -> Requirement:
    try:
        return Requirement(value)
    except ValueError:
        names = ", ".join(repr(r.value) for r in Requirement)
        raise ValueError(f"effect {name!r} requires {value!r}, wanted one of {names}") from None
