"""A model with effects -> the errors of their laws: smooth parts of what each effect adds, as shared modes.

No law is exact: what it leaves grows with the effect, where the noise does not. Beside what an effect adds,
s(step, point) mm, stand modes eps s phi_j of 1 sd each. phi_j is smooth in pressure and place (products of
Legendre polynomials, of all degrees up to 3), in what the pressure was before, and in time; for U1 and U3
apart, as a law may err in their ratio, and a constant for U1 alone. To first order that is the embedded model
error of Sargsyan, Huan and Najm (arXiv 1801.06768).

How large eps is nobody knows: what is asked of a model is averaged over LEVELS, by WEIGHTS
(benchmarks/diagnosis/identify.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval

from twin.effects.protocol import Effect, Order
from twin.model.prediction import Model
from twin.targets import Array, Targets, relative

LEVELS = (0.0, 0.03, 0.1, 0.3)  # of what an effect adds, 1 sd of each smooth part
WEIGHTS = (0.4, 0.1, 0.35, 0.15)  # how likely each is before the data
DEGREE = 3
TAU = 5.0  # s, over which the pressure of before is felt


@dataclass(frozen=True)
class LawError:
    """The smooth parts of what an effect adds to a prediction: modes (k, s, p, 3) mm at eps = 1, relative to
    the reference."""

    effect: str
    modes: Array


def law_errors(model: Model, theta: Array, targets: Targets) -> tuple[LawError, ...]:
    """The errors of the laws of a model's effects at theta (d,), the base material's aside; what an effect
    adds is taken to first order in its amplitudes, which costs no solve."""
    effects = erring(model)
    if not effects:
        return ()
    jacobian, values = model.jacobian(theta), model.named(theta)
    rows = dict(zip(values, jacobian, strict=True))
    shapes = _shapes(targets, np.asarray(model.test.points, float)[:, 0])
    return tuple(_error(e, values, rows, shapes, targets) for e in effects)


def erring(model: Model) -> list[Effect]:
    """The effects of a model whose laws may err: all but the base material's."""
    return [e for e in model.effects if e.order != Order.LAW and e.amplitudes]


def _error(
    e: Effect, values: dict[str, float], rows: dict[str, Array], shapes: Array, targets: Targets
) -> LawError:
    parts = [(values[p.name] - (p.null or 0.0)) * rows[p.name] for p in e.amplitudes]
    added = np.asarray(sum(parts), float)
    modes = [relative(m, targets.reference, targets.rests) for m in shapes * added]
    return LawError(e.name, np.array(modes))


def _shapes(targets: Targets, x: Array) -> Array:
    """The smooth functions phi (27, s, p, 3) of pressure, place x (p,) mm, memory and time."""
    place = _scaled(x)
    p = 2 * targets.pressure / max(float(np.abs(targets.pressure).max()), 1e-12) - 1
    t = _scaled(targets.time)
    before = np.interp(targets.time, targets.log_time, memory(targets.log_time, targets.log_pressure))
    before = before / max(float(np.abs(before).max()), 1e-12)
    fields = [
        np.outer(_legendre(a, p), _legendre(b, place)) / (a + b)
        for a in range(DEGREE + 1)
        for b in range(DEGREE + 1 - a)
        if a + b
    ]
    ways = np.ones(len(place)), place / 2
    fields += [np.outer(course, factor) for course in (before, t) for factor in ways]
    out = [_along(field, axis) for axis in (0, 2) for field in fields]
    return np.array([*out, _along(np.ones((len(p), len(place))), 0)])


def _along(field: Array, axis: int) -> Array:
    """Displacements (s, p, 3) along an axis, of sizes (s, p)."""
    out = np.zeros((*field.shape, 3))
    out[..., axis] = field
    return out


def _legendre(degree: int, x: Array) -> Array:
    return np.asarray(legval(x, np.eye(degree + 1)[degree]), float)


def _scaled(x: Array) -> Array:
    """Values (k,) as numbers from -1 to 1."""
    low, high = float(x.min()), float(x.max())
    return np.asarray((2 * x - low - high) / max(high - low, 1e-12), float)


def memory(time: Array, pressure: Array, tau: float = TAU) -> Array:
    """The memory of a slow element: the pressure (t,) minus its exponential running mean over tau in s.

    >>> memory(np.arange(3.0), np.array([0.0, 1.0, 1.0]), tau=1.0).round(3)
    array([0.   , 0.368, 0.135])
    """
    out = np.zeros_like(pressure)
    mean = pressure[0]
    for n in range(1, len(time)):
        mean += (1 - np.exp(-(time[n] - time[n - 1]) / tau)) * (pressure[n] - mean)
        out[n] = pressure[n] - mean
    return out


def averaged(values: Sequence[float] | Array) -> float:
    """2 ln of the mean over LEVELS of exp(v / 2), of values (4,) in the unit of 2 ln B; of a
    model whose laws cannot err its one value.

    >>> averaged([10.0])
    10.0
    >>> round(averaged([0.0, 0.0, 10.0, 0.0]), 2)  # 2 ln(0.65 + 0.35 exp(5))
    7.93
    """
    half = np.asarray(values, float) / 2
    top, weights = float(half.max()), np.array(WEIGHTS) if len(half) > 1 else np.ones(1)
    return 2 * (top + float(np.log(np.exp(np.maximum(half - top, -700.0)) @ weights)))
