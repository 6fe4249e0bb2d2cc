"""Somebody's program as a callable: parameters and pressures -> displacements, each run made once."""

import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from calibrate import Parameter
from calibrate.parameters import bounds
from twin import files
from twin.effects.labels import NAME
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Unsolvable
from twin.targets import Array

Values = Mapping[str, float]
SCATTER = 1e-9  # of the motion: two runs that differ by less are the same


@dataclass(frozen=True)
class Variant:
    """A physical effect that a simulator can have by a parameter of its own, absent at the parameter's null:
    `Variant(Parameter("taper", -1, 1, "mm", null=0.0, typical=0.05), "walls thinner at the tip")`.

    mechanism: its class of physics. ValueError for a parameter without a null, or a name that is none.
    """

    parameter: Parameter
    sentence: str = ""
    mechanism: Mechanism = Mechanism.BODY

    def __post_init__(self) -> None:
        name = self.parameter.name
        if self.parameter.null is None:
            raise ValueError(f"variant {name}: no null; wanted the value of no effect, such as null=0.0")
        if not NAME.fullmatch(name):
            raise ValueError(f"variant {name!r}: wanted a name of small letters, digits and _, such as taper")


@dataclass(frozen=True, eq=False)
class Simulator:
    """Somebody's program, which a diagnosis may ask.

    predict: {name: value} -> displacements (s, p, 3) mm of all points at all steps of the data; or {name:
    value} and pressures (s,) MPa at these steps. Without pressures an answer counts as a curve over the
    pressure, on which gauge and lag move. parameters: those that are fitted, with unit and bounds. variants:
    effects that it can have by parameters of its own. keep: a folder for its runs, by which a diagnosis goes
    on where it was stopped; empty it where the program has changed. error_mm: how far its answers are off,
    each by itself, beside what two runs of one question tell. finer: the same program with a finer mesh or
    step, of which one run tells by how much its discretisation errs.
    """

    predict: Callable[..., Any]
    parameters: tuple[Parameter, ...]
    variants: tuple[Variant, ...] = ()
    keep: Path | None = None
    error_mm: float = 0.0
    finer: Callable[..., Any] | None = None
    runs: dict[str, Array] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        bounds((*self.parameters, *(v.parameter for v in self.variants)))  # raises for names used twice

    @property
    def absent(self) -> dict[str, float]:
        """The values at which its variants are absent."""
        return {v.parameter.name: float(v.parameter.null or 0.0) for v in self.variants}

    @cached_property
    def takes_pressure(self) -> bool:
        """Whether the callable takes pressures as its second argument. ValueError where it takes neither one
        nor two."""
        kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        wanted = [p for p in inspect.signature(self.predict).parameters.values() if p.kind in kinds]
        count = sum(p.default is p.empty for p in wanted)
        if count not in (1, 2):
            raise ValueError(
                f"the simulator takes {count} arguments; wanted predict(values) or predict(values, "
                "pressure): {name: value}, and MPa at each step"
            )
        return count == 2

    def at(self, values: Values, pressure: Array, stated: Array, points: int) -> Array:
        """Displacements (s, p, 3) mm at pressures (s,) MPa; stated (s,): those of the data. Raises
        Unsolvable where the program fails; ValueError where its answer is no answer."""
        if self.takes_pressure:
            return self._run(values, pressure, points)
        u = self._run(values, stated, points)
        return u + along_curve(u, stated, pressure) - along_curve(u, stated, stated)

    def scatter(self, values: Values, pressure: Array, points: int) -> float:
        """The sd in mm of its answers: as stated, and by two runs of one question."""
        first, second = self._run(values, pressure, points), self._asked(values, pressure, points)
        apart = float(np.sqrt(np.mean((first - second) ** 2) / 2))
        apart = apart if apart > SCATTER * float(np.abs(first).max()) else 0.0
        return float(np.hypot(apart, self.error_mm))

    def _run(self, values: Values, pressure: Array, points: int) -> Array:
        asked = pressure if self.takes_pressure else np.zeros(0)
        text = repr(sorted((n, float(x)) for n, x in values.items())).encode() + asked.tobytes()
        key = hashlib.sha256(text).hexdigest()[:24]
        if key not in self.runs:
            self.runs[key] = self._kept(key, values, pressure, points)
        return self.runs[key]

    def _kept(self, key: str, values: Values, pressure: Array, points: int) -> Array:
        """A run that is in the folder, or a new one, which is put there."""
        if self.keep is None:
            return self._asked(values, pressure, points)
        path = self.keep / f"{key}.npz"
        if path.is_file():
            u = files.read_npz(path, "u")["u"]
            return checked(u, (len(pressure), points, 3), values, str(path))
        u = self._asked(values, pressure, points)
        self.keep.mkdir(parents=True, exist_ok=True)
        files.write_npz(path, {"u": u})
        return u

    def _asked(self, values: Values, pressure: Array, points: int) -> Array:
        given = dict(values)
        try:
            answer = self.predict(given, pressure.copy()) if self.takes_pressure else self.predict(given)
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            raise Unsolvable(f"the simulator failed at {in_words(values)}: {why}") from error
        return checked(answer, (len(pressure), points, 3), values, "the simulator")


def checked(answer: Any, wanted: tuple[int, ...], values: Values, who: str) -> Array:
    """An answer as numbers (s, p, 3). ValueError for another shape; Unsolvable where it is not finite."""
    try:
        u = np.asarray(answer, float)
    except (TypeError, ValueError):
        kind = type(answer).__name__
        raise ValueError(f"{who} gave {kind}; wanted numbers of shape {wanted}, mm") from None
    if u.shape != wanted:
        raise ValueError(
            f"{who} gave displacements of shape {u.shape}; wanted {wanted}: steps and points of the data, "
            "and x, y, z in mm"
        )
    if not np.isfinite(u).all():
        step = int(np.argwhere(~np.isfinite(u))[0, 0])
        raise Unsolvable(f"{who} gave {u[~np.isfinite(u)][0]} at step {step}, at {in_words(values)}")
    return u


def nominal(parameters: Sequence[Parameter]) -> dict[str, float]:
    """The start of each parameter, or the middle of its bounds."""
    return {p.name: (p.low + p.high) / 2 if p.start is None else p.start for p in parameters}


def in_words(values: Values) -> str:
    """Values by name.

    >>> in_words({"E": 0.25, "nu": 0.49})
    'E = 0.25, nu = 0.49'
    """
    return ", ".join(f"{name} = {value:.4g}" for name, value in values.items())


def along_curve(u: Array, stated: Array, pressure: Array) -> Array:
    """Displacements (s, p, 3) at other pressures (s,), on the lines between those (s, p, 3) at stated ones,
    their mean where several have one pressure; beyond them on the last line.

    >>> p = np.array([0.0, 1.0, 2.0])
    >>> along_curve(p[:, None, None] ** 2, p, np.array([0.5, 1.5, 3.0])).ravel()
    array([0.5, 2.5, 7. ])
    """
    x, first = np.unique(stated, return_inverse=True)
    if len(x) < 2:
        return u
    count = np.bincount(first)
    flat = u.reshape(len(u), -1)
    y = np.stack([np.bincount(first, column) / count for column in flat.T], axis=1)
    k = np.clip(np.searchsorted(x, pressure) - 1, 0, len(x) - 2)
    share = (pressure - x[k]) / (x[k + 1] - x[k])
    return np.asarray((y[k] + share[:, None] * (y[k + 1] - y[k])).reshape(u.shape))


def simulator(
    predict: Callable[..., Any],
    parameters: Sequence[Parameter],
    *,
    variants: Sequence[Variant | Parameter] = (),
    keep: str | Path | None = None,
    finer: Callable[..., Any] | None = None,
) -> Simulator:
    """Somebody's program for `twin.diagnose(simulator, data)`; see `Simulator`.

    >>> from calibrate import Parameter
    >>> def predict(values, pressure):  # a spring: one point that moves along z
    ...     return pressure[:, None, None] / values["k"] * np.array([0.0, 0.0, -1.0])
    >>> spring = simulator(predict, [Parameter("k", 1e-4, 1e-2, "MPa/mm", start=1e-3)])
    >>> spring.at({"k": 1e-3}, np.array([0.0, 0.02]), np.array([0.0, 0.02]), 1)[:, 0, 2]
    array([ -0., -20.])
    """
    own = tuple(v if isinstance(v, Variant) else Variant(v) for v in variants)
    return Simulator(predict, tuple(parameters), own, None if keep is None else Path(keep), finer=finer)
