"""Ogden's rubber of one to three terms in the principal stretches (Ogden 1972, doi 10.1098/rspa.1972.0026),
in the form that Abaqus uses: each mu is what its term adds to the shear modulus."""

from functools import partial
from typing import TYPE_CHECKING, Any

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Shape, Values, ratio

if TYPE_CHECKING:
    from fe import Material


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return sum(2 * mu / alpha**2 * ((l**alpha).sum(axis=-1) - 3) for mu, alpha in _pairs(c))


def _pairs(c: Values) -> tuple[tuple[float, float], ...]:
    return tuple((c[f"mu{k}"], c[f"alpha{k}"]) for k in range(1, len(c) // 2 + 1))


def _terms(c: Values) -> dict[str, Any]:
    return {"ogden": _pairs(c)}


def _read(count: int, m: "Material") -> dict[str, float]:
    pairs = (*m.ogden, *((0.0, 1.0),) * count)[:count]
    return _named(pairs)


def _named(pairs: Any) -> dict[str, float]:
    return {k: v for i, (mu, alpha) in enumerate(pairs, 1) for k, v in ((f"mu{i}", mu), (f"alpha{i}", alpha))}


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    (_, alpha1), *more = pairs = _pairs(c)
    total = sum(mu for mu, _ in pairs)
    return total / 2, (alpha1, *(x for mu, alpha in more for x in (ratio(mu, total), alpha)))


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    alpha1, *more = shape
    parts, exponents = more[::2], more[1::2]
    fractions = (1 - sum(parts), *parts)
    pairs = zip(fractions, (alpha1, *exponents), strict=True)
    return _named([(2 * scale * fraction, alpha) for fraction, alpha in pairs])


# Of each law the terms: a usual part of the shear modulus in MPa, and an exponent with its bounds. At 0 a
# term is the limit of those beside it, which no fit hits; of several terms each has its own sign.
_TERMS = (
    ((0.6, 2.5, -8.0, 8.0),),
    ((0.4, 2.0, 0.5, 10.0), (0.2, -2.0, -10.0, -0.5)),
    ((0.36, 2.0, 0.5, 4.0), (0.04, 6.0, 4.0, 14.0), (0.2, -2.0, -10.0, -0.5)),
)


def _law(count: int) -> RubberLaw:
    rows = _TERMS[count - 1]
    total = sum(mu for mu, *_ in rows)
    parameters, shapes, more = [], [], dict[str, Any]()
    for k, (mu, alpha, low, high) in enumerate(rows, 1):
        least = 0.02 if k == 1 else 0.0
        parameters.append(Parameter(f"mu{k}", least, 1.0, MPA, typical=0.04, start=mu))
        parameters.append(Parameter(f"alpha{k}", low, high, typical=0.2, start=alpha))
        shapes += [] if k == 1 else [Shape(f"mu{k}/mu", 0.0, 1.0, usual=mu / total)]
        more = {"count": 8, "also": (-3.0,)} if low < 0.0 < high else {}  # an even count: none at 0
        shapes.append(Shape(f"alpha{k}", low, high, usual=alpha, **more))
    return RubberLaw(
        name=f"ogden{count}",
        title=f"Ogden ({count} term{'s' if count > 1 else ''})",
        formula="W = sum 2 mu_k / alpha_k^2 (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3)",
        stiffness=" + ".join(f"mu{k} / 2" for k in range(1, count + 1)),
        source="10.1098/rspa.1972.0026",
        parameters=tuple(parameters),
        shapes=tuple(shapes),
        energy=_energy,
        terms=_terms,
        read=partial(_read, count),
        split=_split,
        join=_join,
    )


OGDEN = tuple(_law(count) for count in (1, 2, 3))
