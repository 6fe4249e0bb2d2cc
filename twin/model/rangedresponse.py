"""A model and a range of its parameters -> its answers anywhere in the range, in milliseconds, with an error.

Whole solves at the middle of the range and at points spread over it (Sobol 1967,
doi:10.1016/0041-5553(67)90144-9) make a `response.Surrogate`. Every solve checks the response before it joins
it, so that the stated error is what such checks have borne out. docs/python.md has figures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibrate import Parameter
from twin.effects.protocol import Unsolvable
from twin.model.keptmodel import KeptModel
from twin.model.response import Surrogate
from twin.targets import Array

SPREAD = 0.2  # of a value: the range of its parameter either way, but for a typical step at least
NARROWER = (1.0, 0.5, 0.25, 0.125)  # of that, where walls would be too thin
SOLVES = 8
LEAST = 1e-3  # mm, of a stated error: what is less, no check has borne out, and no film shows


@dataclass(frozen=True)
class Answer:
    """Displacements u (s, p, 3) mm relative to the reference, and their error (s, p, 3) mm, 1 sd."""

    u: Array
    error: Array


@dataclass(frozen=True)
class RangedResponse:
    """A model's answers for parameters between low (d,) and high (d,); those that are not asked for stay at
    middle (d,)."""

    surrogate: Surrogate
    low: Array
    high: Array
    middle: Array

    @staticmethod
    def of(
        model: KeptModel,
        theta: Array,
        *,
        within: Mapping[str, tuple[float, float]] | None = None,
        solves: int = SOLVES,
    ) -> "RangedResponse":
        """The response of a model around theta (d,), from `solves` solves with their derivatives.

        within: lowest and highest value by a parameter's name; of others 20 % of theta either way, or a
        typical step where that is more, and less where there is no such finger. A model with effects takes
        a solve without them and their tangents on top.

        Raises ValueError for a range that no parameter has, and where the model has no equilibrium in it.
        """
        if solves < 1:
            raise ValueError(f"solves = {solves}: wanted 1 or more")
        low, high = _range(model, theta, within or {})
        middle = np.clip(theta, low, high)
        try:
            out = RangedResponse(begun(model, middle), low, high, middle)
            for point in (middle, *spread(low, high, solves - 1)):
                out = out.certified(point)
        except Unsolvable as why:
            raise ValueError(
                f"the response cannot be made: {why}; wanted a range in which the model has an equilibrium: "
                "give a narrower one as within={name: (low, high)}"
            ) from None
        out.answer(middle)  # what every answer needs is computed now, which may take a second
        return out

    @staticmethod
    def reach(model: KeptModel, theta: Array) -> Array:
        """The lowest and the highest value (d, 2) of every parameter that `of` takes around theta (d,) where
        no range is stated."""
        return np.array([_around(model, theta, k) for k in range(len(theta))])

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The lowest and the highest value that it answers for, by the parameter's name."""
        ends = zip(self._parameters, self.low, self.high, strict=True)
        return {p.name: (float(low), float(high)) for p, low, high in ends}

    def at(self, values: Mapping[str, float] | None = None) -> Answer:
        """The answer at values by the parameters' names. Raises ValueError for a name that
        the model does not have, and outside the range."""
        stated = dict(values or {})
        names = [p.name for p in self._parameters]
        if unknown := sorted(set(stated) - set(names)):
            raise ValueError(
                f"{unknown[0]} = {stated[unknown[0]]:g}: the model has no such parameter; wanted one of "
                f"{', '.join(names)}"
            )
        return self.answer(np.array([stated.get(n, x) for n, x in zip(names, self.middle, strict=True)]))

    def answer(self, theta: Array) -> Answer:
        """The answer at theta (d,). Raises ValueError outside the range."""
        for p, x, low, high in zip(self._parameters, theta, self.low, self.high, strict=True):
            if not low <= x <= high:
                unit = f" {p.unit}" if p.unit else ""
                raise ValueError(
                    f"{p.name} = {x:.4g}{unit}: wanted {low:.4g} to {high:.4g}{unit}, the range of this "
                    f"response; make another, with within={{{p.name!r}: (low, high)}}, or solve the model"
                )
        try:
            u, sd = self.surrogate.answer(theta)
        except Unsolvable as why:
            raise ValueError(f"{why}: make the response of more solves, or of a narrower range") from None
        return Answer(u, np.hypot(sd, LEAST))

    def certified(self, theta: Array) -> "RangedResponse":
        """The response with a whole solve at theta (d,) more. Raises Unsolvable where there is no
        equilibrium."""
        return replace(self, surrogate=self.surrogate.certified(theta))

    @property
    def _parameters(self) -> tuple[Parameter, ...]:
        return self.surrogate.parameters


def spread(low: Array, high: Array, count: int, *, seed: int = 0) -> Array:
    """Points (count, d) spread evenly between low (d,) and high (d,): the first of a scrambled Sobol
    sequence, so that a larger count only adds points.

    >>> spread(np.zeros(1), np.ones(1), 4).shape
    (4, 1)
    """
    from scipy.stats import qmc  # half a second

    power = int(np.ceil(np.log2(max(count, 1))))
    unit = qmc.Sobol(len(low), rng=np.random.default_rng(seed)).random_base2(power)[:count]
    return np.asarray(low + (high - low) * unit)


def begun(model: KeptModel, middle: Array) -> Surrogate:
    """The surrogate of a model before its first whole solve: a solve without its effects, and their tangents.
    It ignores earlier solves of the model, so that its answers can be repeated."""
    parent = model.base
    assert isinstance(parent, KeptModel)
    base = replace(parent)
    theta = np.array([model.named(middle)[p.name] for p in base.parameters])
    more = [e for e in model.effects if e not in base.effects]
    full = replace(model, parent=base) if more else base
    return Surrogate.of(full, base, theta, base.tangents(theta, more))


def _range(
    model: KeptModel, theta: Array, within: Mapping[str, tuple[float, float]]
) -> tuple[Array, Array]:
    """The lowest and highest values (d,) of a response around theta (d,)."""
    names = [p.name for p in model.parameters]
    if unknown := sorted(set(within) - set(names)):
        raise ValueError(
            f"within: {unknown[0]} is no parameter of the model; wanted some of {', '.join(names)}"
        )
    ends = []
    for k, p in enumerate(model.parameters):
        low, high = within[p.name] if p.name in within else _around(model, theta, k)
        if p.name in within and not p.low <= low < high <= p.high:
            raise ValueError(
                f"within: {p.name} from {low:.4g} to {high:.4g} {p.unit}: wanted a lower and a higher value "
                f"between {p.low:.4g} and {p.high:.4g} {p.unit}"
            )
        ends.append((low, high))
    low_ends, high_ends = np.array(ends, float).T
    return low_ends, high_ends


def _around(model: KeptModel, theta: Array, k: int) -> tuple[float, float]:
    """The range of parameter number k around theta (d,), narrower where no finger has its ends."""
    p, x = model.parameters[k], float(theta[k])
    low = high = x
    for half in max(SPREAD * abs(x), p.step) * np.array(NARROWER):
        low, high = max(x - half, min(p.low, x)), min(x + half, max(p.high, x))
        if all(_possible(model, np.where(np.arange(len(theta)) == k, end, theta)) for end in (low, high)):
            break
    return float(low), float(high)


def _possible(model: KeptModel, theta: Array) -> bool:
    """True if there is a finger with theta (d,), even without an equilibrium."""
    try:
        model.put(model.named(theta))
    except Unsolvable:
        return False
    return True
