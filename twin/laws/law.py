"""The law of a rubber: constants with bounds, a strain energy, and its split into stiffness and form.

Where pressure alone loads one material, displacements depend on pressure / scale and on the law's shape
alone: the scale is half of the shear modulus at rest, in MPa (C10 + C01 of Mooney-Rivlin rubber), the shape
a few numbers without unit. So load paths, finer meshes and ridges that are solved at one scale serve for all.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrate import Parameter
from twin.targets import Array

if TYPE_CHECKING:
    from fe import Material

Values = Mapping[str, float]
Bounds = Mapping[str, tuple[float, float]]
MPA = "MPa"
STRETCH = 1.63  # to which rubber must be stable; the built-in finger reaches 1.47 at 30 kPa


@dataclass(frozen=True)
class Shape:
    """A number without unit that gives a law its form: its name, the range over which load paths are solved,
    a usual value, and how many paths; below: the least that a fit may end at, with so many paths more; also:
    other values at which a fit should begin, where a law has more than one kind of answer."""

    name: str
    low: float
    high: float
    usual: float
    count: int = 5
    below: float | None = None
    more: int = 0
    also: tuple[float, ...] = ()

    def ends(self, *, wide: bool) -> tuple[float, float]:
        """Between which values load paths are solved; wide: from `below` on."""
        return self.below if wide and self.below is not None else self.low, self.high

    def nodes(self, *, wide: bool) -> Array:
        """The values (h,) at which load paths are solved, Chebyshev points."""
        low, high = self.ends(wide=wide)
        count = self.count if low == self.low else self.count + self.more
        unit = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        return np.asarray(low + (high - low) * unit)


def ratio(a: float, b: float) -> float:
    """The quotient a / b; NaN where b is 0, which no rubber has."""
    return a / b if b else np.nan


def _same(bounds: Bounds, fixed: Values) -> Bounds:
    del fixed
    return bounds


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class RubberLaw:
    """A law, whose constants stand in the order of its parameters, each with bounds, a start and a step.

    name: as twin.toml writes it; title: as a sentence does; formula: its energy in one line; stiffness: its
    scale in its constants. shapes: of its form. energy(c, I1, I2, l): W in MPa at invariants I1, I2 (...) and
    stretches l (..., 3), at constant volume. terms(c): the fields of a `fe.Material`; read(material): the
    constants back. split(c): scale and shape; join(scale, shape): the constants back. widened(bounds, fixed):
    those of least squares from those of the genetic algorithm, of the constants that are not fixed. source:
    DOI.

    >>> from twin.laws.catalogue import named_law
    >>> gent = named_law("gent")
    >>> gent.formula
    'W = -mu Jm / 2 ln(1 - (I1 - 3) / Jm)'
    >>> gent.names, gent.moduli
    (('mu', 'Jm'), ('mu',))
    >>> gent.at(0.3, (0.125,)).told
    'mu = 0.6 MPa, Jm = 8'

    Energy at a uniaxial stretch of 1.5, at constant volume:

    >>> l = np.array([1.5, 1.5**-0.5, 1.5**-0.5])
    >>> I1, I2 = (l**2).sum(), (l**-2).sum()
    >>> round(float(gent.energy(gent.nominal.named, I1, I2, l)), 4)
    0.1817
    """

    name: str
    title: str
    formula: str
    stiffness: str
    source: str
    parameters: tuple[Parameter, ...]
    shapes: tuple[Shape, ...]
    energy: Callable[[Values, Any, Any, Any], Any]
    terms: Callable[[Values], dict[str, Any]]
    read: "Callable[[Material], dict[str, float]]"
    split: Callable[[Values], tuple[float, tuple[float, ...]]]
    join: Callable[[float, tuple[float, ...]], dict[str, float]]
    widened: Callable[[Bounds, Values], Bounds] = _same

    def __repr__(self) -> str:
        return f"RubberLaw({self.name})"

    def __eq__(self, other: object) -> bool:  # one that was sent to another process, too
        return isinstance(other, RubberLaw) and self.name == other.name

    def __hash__(self) -> int:
        return hash(self.name)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of its constants."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """The lowest and highest value of each constant."""
        return {p.name: (p.low, p.high) for p in self.parameters}

    @cached_property
    def moduli(self) -> tuple[str, ...]:
        """The constants in MPa: a stiffer silicone has all of them larger by one factor."""
        return tuple(p.name for p in self.parameters if p.unit == MPA)

    @cached_property
    def at_rest(self) -> tuple[str, ...]:
        """The `moduli` on which the shear modulus at rest depends."""
        usual = self.nominal
        return tuple(n for n in self.moduli if self.of({**usual.named, n: 2 * usual[n]}).scale != usual.scale)

    @cached_property
    def nominal(self) -> "Constants":
        """Its constants until they are fitted."""
        return Constants(self, tuple(p.start or 0.0 for p in self.parameters))

    def of(self, values: Values) -> "Constants":
        """The constants among named values."""
        return Constants(self, tuple(float(values[name]) for name in self.names))

    def at(self, scale: float, shape: tuple[float, ...]) -> "Constants":
        """The constants of a scale in MPa and a shape."""
        return self.of(self.join(scale, shape))

    def usual(self, scale: float) -> "Constants":
        """The constants of a scale in MPa and the usual shape."""
        return self.at(scale, tuple(s.usual for s in self.shapes))

    @cached_property
    def starts(self) -> tuple[tuple[float, ...], ...]:
        """The shapes at which a fit begins: the nominal one, and it with another value that a number may
        have."""
        usual = self.nominal.shape
        others = [(k, x) for k, shape in enumerate(self.shapes) for x in shape.also]
        return usual, *((*usual[:k], x, *usual[k + 1 :]) for k, x in others)

    def around(self, constants: "Constants") -> Bounds:
        """Bounds for constants that are known nearly, such as a deck's: as far either way as usual, by the
        stiffness; and those of numbers without unit as usual, or wider where they are beyond."""
        factor, out = constants.scale / self.nominal.scale, {}
        for p in self.parameters:
            low, high = (factor * p.low, factor * p.high) if p.name in self.moduli else (p.low, p.high)
            if constants[p.name] * high < 0:  # an exponent of the other sign
                low, high = -high, -low
            reach = 1.5 * constants[p.name]
            out[p.name] = min(low, reach), max(high, reach)
        return out

    def scales(self, bounds: Bounds) -> tuple[float, float]:
        """The lowest and highest scale in MPa of constants between bounds: those of their ends."""
        ends = product(*(bounds[name] for name in self.names))
        every = [self.of(dict(zip(self.names, values, strict=True))).scale for values in ends]
        return min(every), max(every)


@dataclass(frozen=True)
class Constants:
    """Values of a law's constants, in the order of its parameters.

    >>> from twin.laws.mooneyrivlin import mooney_rivlin
    >>> silicone = mooney_rivlin(0.2, 0.1)
    >>> silicone.told
    'C10 = 0.2, C01 = 0.1 MPa'
    >>> round(2 * silicone.scale, 6)  # shear modulus at rest, 2 (C10 + C01), in MPa
    0.6
    >>> [round(x, 3) for x in silicone.shape]  # the share C01 / (C10 + C01)
    [0.333]
    """

    law: RubberLaw
    values: tuple[float, ...]

    def __getitem__(self, name: str) -> float:
        return self.values[self.law.names.index(name)]

    @property
    def named(self) -> dict[str, float]:
        """The values by their names."""
        return dict(zip(self.law.names, self.values, strict=True))

    @property
    def scale(self) -> float:
        """Half of the shear modulus at rest in MPa."""
        return self.law.split(self.named)[0]

    @property
    def shape(self) -> tuple[float, ...]:
        """The law's shape, without unit."""
        return self.law.split(self.named)[1]

    @property
    def terms(self) -> dict[str, Any]:
        """The fields of a material of this law, and of all others the ones that it leaves at 0."""
        return {**NOTHING, **self.law.terms(self.named)}

    @property
    def material(self) -> "Material":
        """A material of this law."""
        from fe import Material

        return Material(**self.law.terms(self.named))

    @property
    def told(self) -> str:
        """The values in words, C10 = 0.2, C01 = 0.1 MPa."""
        units = {p.name: p.unit for p in self.law.parameters}
        same = len({*units.values()}) == 1
        each = [f"{n} = {v:.3g}" + ("" if same else f" {units[n]}".rstrip()) for n, v in self.named.items()]
        return ", ".join(each) + (f" {MPA}" if same else "")


NOTHING: dict[str, Any] = {
    "C10": 0.0, "C01": 0.0, "C20": 0.0, "C30": 0.0, "gent": None, "chains": None, "ogden": (),
}  # fmt: skip


# -- polynomials in the invariants: their constants are fields of a material ---------------------------------

def terms_of(c: Values) -> dict[str, Any]:
    """The fields of a material."""
    return dict(c)


def _read(names: tuple[str, ...], m: "Material") -> dict[str, float]:
    return {name: float(getattr(m, name)) for name in names}


def reader(*names: str) -> Any:
    """A function that reads the constants of these names off a material."""
    return partial(_read, names)
