"""A model without finite elements: displacements linear in every parameter, so that a diagnosis takes a moment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from calibrate import Parameter
from twin.effects.protocol import Effect
from twin.targets import Array, Noise, PointKind, TargetPoint, Targets

STEPS, POINTS, SD = 120, 4, 0.01  # mm


def toy_effect(
    name: str, *, amplitudes: int = 1, one_sided: bool = False, kind: str = "", wide: int = 0, null: float = 0.0
) -> Effect:
    """An effect of a name whose maps are those of a `Toy`; wide: terms of its declared wider family; null: of
    its amplitudes."""
    low = 0.0 if one_sided else -5.0
    own = tuple(
        Parameter(
            f"{name}.a{k}", null + low, null + 5.0, "mm", null=null, typical=0.1, plausible=(null + low / 5, null + 1.0)
        )
        for k in range(amplitudes)
    )
    methods: dict[str, Any] = {"name": name, "parameters": own, "sentence": f"{name} is there"}
    if kind:
        methods |= {"kind": kind, "resembles": lambda self, theta: f"{theta[own[0].name]:.2f} of {name}"}
    if amplitudes > 1:
        methods["start"] = lambda self, theta: {**{p.name: 0.0 for p in own}, **theta}
    if wide:
        methods["wide"] = lambda self: _wide(name, wide)
    return type("Toyed", (Effect,), methods)()


def _wide(name: str, terms: int) -> Effect:
    """The wider family of an effect."""
    found = toy_effect(name, amplitudes=terms)
    type(found).label = property(lambda self: f"{name}:wide")  # type: ignore[assignment]
    return found


@dataclass(frozen=True, eq=False)
class Toy:
    """fields: (k, s, p, 3) mm per unit of the k-th parameter of each effect, by name; the base's is `base`."""

    fields: Mapping[str, Array]
    effects: tuple[Effect, ...] = ()
    parent: Any = None
    mesh: Any = None
    test: Any = field(default_factory=lambda: SimpleNamespace(points=np.array([[10.0 * k, 11.5, 0.0] for k in range(POINTS + 1)])))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        base = Parameter("base.C", 0.1, 10.0, "MPa", typical=0.1, start=1.0)
        return (base, *(p for e in self.effects for p in e.parameters))

    def theta(self, values: Mapping[str, float]) -> Array:
        return np.array([values[p.name] for p in self.parameters])

    def named(self, theta: Array) -> dict[str, float]:
        return {p.name: float(x) for p, x in zip(self.parameters, theta, strict=True)}

    def with_effect(self, effect: Effect) -> "Toy":
        kept = tuple(e for e in self.effects if e.name != effect.name)
        return replace(self, effects=(*kept, effect), parent=self)

    def allowed(self, theta: Mapping[str, float]) -> bool:
        del theta
        return True

    def jacobian(self, theta: Array) -> Array:
        rows = [self.fields["base"], *(self.fields[e.name][: len(e.parameters)] for e in self.effects)]
        return np.concatenate(rows)

    def predict(self, theta: Array) -> Array:
        null = np.array([p.null or 0.0 for p in self.parameters])
        return np.tensordot(theta - null, self.jacobian(theta), 1)

    def solution(self, theta: Array) -> Any:
        return SimpleNamespace(history=None)

    def per_pressure(self, theta: Array) -> Array:
        return np.zeros(self.fields["base"].shape[1:])

    def modes(self, theta: Array) -> Array:
        return np.zeros((0, *self.fields["base"].shape[1:]))

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> dict[str, list[Array]]:
        return {e.label: [self.fields[e.name][: len(e.amplitudes)] for _ in e.tries(self.test)] for e in effects}


def pressure() -> Array:
    """Two cycles (s,) MPa with a hold."""
    x = np.linspace(0, 2, STEPS) % 1.0
    return 0.03 * np.clip(np.minimum(x / 0.3, (1 - x) / 0.3), 0, 1)


def smooth_field(seed: int, count: int = 1) -> Array:
    """Fields (count, s, p, 3) mm of size one, smooth in time and pressure, in x and z."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 1, STEPS)
    x = pressure() / 0.03
    shapes = np.array([x, x**2, x**3, t * x, t**2, np.sin(7 * t) * x])
    out = np.zeros((count, STEPS, POINTS + 1, 3))  # the last one is fixed
    out[:, :, :POINTS, (0, 2)] = np.einsum("kpif,fs->kspi", rng.standard_normal((count, POINTS, 2, len(shapes))), shapes)
    return out - out[:, :5].mean(axis=1, keepdims=True)


def targets(truth: Array, *, seed: int, sd: float = SD) -> Targets:
    """Targets of a true displacement (s, p, 3) mm with white noise, four markers on the finger and one fixed."""
    rng = np.random.default_rng(seed)
    value = np.where(np.arange(3) == 1, np.nan, truth) + sd * rng.standard_normal(truth.shape)
    names = tuple(f"p{k}" for k in range(POINTS)) + ("f0",)
    points = tuple(
        TargetPoint(n, PointKind.FIXED if n == "f0" else PointKind.PLACE, None, (10.0 * k, 11.5, 0.0))
        for k, n in enumerate(names)
    )
    covariance = np.zeros((STEPS, POINTS + 1, 3, 3))
    covariance[..., range(3), range(3)] = sd**2
    covariance[:, :, 1], covariance[:, :, :, 1] = np.nan, np.nan
    shape = (POINTS + 1, 3)
    own = np.tile([sd, np.nan, sd], (POINTS + 1, 1))
    noise = Noise(
        sd=own, rho=np.zeros(shape), correlation=np.eye(3 * (POINTS + 1)), frames=100_000,
        codec_sd=np.zeros(shape), gauge_sd_MPa=0.0, gauge_frames=1000,
    )  # fmt: skip
    time = np.arange(STEPS) * 0.25
    return Targets(
        time=time, pressure=pressure(), block=np.zeros(STEPS, np.int64), points=points, value=value,
        covariance=covariance, valid=np.isfinite(value), held_out=np.zeros(STEPS, bool),
        modes=np.zeros((0, STEPS, POINTS + 1, 3)), mode_names=(), noise=noise,
        log_time=np.linspace(0, time[-1], 4 * STEPS), log_pressure=np.interp(np.linspace(0, time[-1], 4 * STEPS), time, pressure()),
        reference=np.arange(5), gravity=None, pressure_sd=np.zeros(STEPS),
    )  # fmt: skip
