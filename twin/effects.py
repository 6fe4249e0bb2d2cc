"""The library of physical effects: each is two pure maps, of what goes into a prediction and of what comes
out.

An effect never states a derivative: `Model` differences its maps. At its null values a prediction equals
the base.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibrate import Parameter
from fe import Case, Path
from twin.targets import Array

Theta = Mapping[str, float]


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
    what the data must hold ("history"). sentence: what is physically meant, for the report.
    """

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


class Elasticity(Effect):
    """The base material: Mooney-Rivlin constants C10 and C01 of every element, each free or held at a
    value."""

    name, sentence, order = "elasticity", "Mooney-Rivlin rubber", 0

    def __init__(
        self, *, bounds: Mapping[str, tuple[float, float]] | None = None, fixed: Theta | None = None
    ) -> None:
        limits = {"C10": (0.01, 0.5), "C01": (0.0, 0.5), **(bounds or {})}
        self.fixed = dict(fixed or {})
        self.parameters = tuple(
            Parameter(name, *limits[name], "MPa", typical=0.02, start=float(np.clip(start, *limits[name])))
            for name, start in (("C10", 0.2), ("C01", 0.1))
            if name not in self.fixed
        )

    def before(self, test: Test, theta: Theta) -> Test:
        values = {**theta, **self.fixed}
        return replace(test, case=test.case.with_material(C10=values["C10"], C01=values["C01"]))


class Creep(Effect):
    """Finite-strain Prony relaxation G(t) = G0 [1 - sum g_i (1 - exp(-t / tau_i))] with one or two terms."""

    name, order, requires = "creep", 10, ("history",)
    sentence = "the silicone keeps yielding under a held pressure and recovers slowly (viscoelasticity)"

    def __init__(self, terms: int = 1) -> None:
        self.terms = terms
        self.parameters = tuple(
            p
            for i in range(1, terms + 1)
            for p in (
                Parameter(f"creep.g{i}", 0.0, 0.4, "", null=0.0, typical=0.02, plausible=(0.003, 0.2)),
                Parameter(f"creep.tau{i}", 0.2, 200.0, "s", typical=1.0, plausible=(0.5, 100.0)),
            )
        )
        self.grid = (
            tuple({"creep.tau1": tau} for tau in (0.6, 1.2, 2.5, 5.0, 10.0, 20.0)) if terms == 1 else ()
        )

    @property
    def label(self) -> str:
        return self.name if self.terms == 1 else f"{self.name}:{self.terms}"

    def before(self, test: Test, theta: Theta) -> Test:
        series = tuple((theta[f"creep.g{i}"], theta[f"creep.tau{i}"]) for i in range(1, self.terms + 1))
        return replace(test, case=test.case.with_material(prony=series))

    def wider(self) -> Effect | None:
        return Creep(2) if self.terms == 1 else None

    def start(self, theta: Theta) -> Theta:
        if self.terms == 1:
            return theta
        rest = {k: v for k, v in theta.items() if not k.startswith("creep.")}
        g, tau = theta["creep.g1"], theta["creep.tau1"]
        slow = float(np.clip(4 * tau, 0.2, 150.0))
        first = {"creep.g1": 0.7 * g, "creep.tau1": max(0.6 * tau, 0.2)}
        return {**rest, **first, "creep.g2": 0.5 * g, "creep.tau2": slow}


class Stiffening(Effect):
    """A quadratic term C20 (I1 - 3)^2 in the energy: the rubber stiffens, or softens, with strain."""

    name, order = "stiffening", 10
    sentence = "the silicone stiffens (or softens) with strain beyond the Mooney-Rivlin law"
    parameters = (Parameter("stiffening.C20", -0.05, 0.5, "MPa", null=0.0, typical=0.005),)

    def before(self, test: Test, theta: Theta) -> Test:
        return replace(test, case=test.case.with_material(C20=theta["stiffening.C20"]))


class ElasticClamp(Effect):
    """The clamped face turns about the y axis in proportion to the moment on it."""

    name, order = "clamp", 20
    sentence = "the clamp gives way and turns with the moment on it"
    parameters = (Parameter("clamp.compliance", 0.0, 1e-2, "rad/(N mm)", null=0.0, typical=1e-5),)

    def before(self, test: Test, theta: Theta) -> Test:
        if test.case.clamp is None:
            return test
        clamp = replace(test.case.clamp, compliance=theta["clamp.compliance"])
        return replace(test, case=replace(test.case, clamp=clamp))


class PressureGain(Effect):
    """The gauge reads wrong by a constant factor: true pressure = (1 + gain) recorded."""

    name, order = "pressure_gain", 40
    sentence = "the pressure gauge is off by a constant factor"
    parameters = (Parameter("pressure_gain.gain", -0.3, 0.3, "", null=0.0, typical=0.02),)

    def before(self, test: Test, theta: Theta) -> Test:
        gain = 1 + theta["pressure_gain.gain"]
        return replace(test, path=replace(test.path, pressure=test.path.pressure * gain))


class PressureLag(Effect):
    """The chamber follows the gauge as a first-order line: tau dp/dt = recorded - p."""

    name, order, requires = "pressure_lag", 50, ("history",)
    sentence = "the chamber's pressure lags behind the gauge (hose and orifice)"
    parameters = (Parameter("pressure_lag.tau", 0.0, 5.0, "s", null=0.0, typical=0.1),)

    def before(self, test: Test, theta: Theta) -> Test:
        path = test.path
        lagged = first_order_lag(path.time, path.pressure, theta["pressure_lag.tau"])
        return replace(test, path=replace(path, pressure=lagged))


class CameraScale(Effect):
    """The picture is magnified: all positions are seen (1 + scale) times as far from the origin."""

    name, order = "camera_scale", 80
    sentence = "the picture's scale (mm per pixel) is off by a constant factor"
    parameters = (Parameter("camera_scale.scale", -0.2, 0.2, "", null=0.0, typical=0.01),)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        scale = theta["camera_scale.scale"]
        return u + scale * (test.points + u)


def first_order_lag(time: Array, pressure: Array, tau: float) -> Array:
    """The response (t,) of tau dy/dt + y = p, exact for p linear between the times (t,) s, settled at the
    start.

    For tau <= 0 the linear continuation p - tau dp/dt, so that the map can be differenced at tau = 0.
    """
    slope = np.diff(pressure) / np.diff(time)
    if tau <= 0:
        return pressure - tau * np.concatenate([[0.0], slope])
    x = np.diff(time) / tau
    decay = np.exp(-np.minimum(x, 300.0))  # times a pressure this is still a normal number
    out = np.empty_like(pressure)
    out[0] = pressure[0]
    drive = pressure[1:] - decay * pressure[:-1] - tau * slope * (1 - decay)
    for n in range(len(x)):
        out[n + 1] = decay[n] * out[n] + drive[n]
    return out


def library() -> tuple[Effect, ...]:
    """All effects that `twin diagnose` tries, each in its narrowest law."""
    return (Creep(), PressureLag(), Stiffening(), ElasticClamp(), PressureGain(), CameraScale())


def effect(label: str) -> Effect:
    """The effect that a label of twin.toml names, `creep` or `creep:2`; ValueError lists the known ones."""
    name, _, terms = label.partition(":")
    for known in library():
        if known.name == name:
            while known is not None and known.label != label:
                known = known.wider()  # type: ignore[assignment]
            if known is not None:
                return known
    raise ValueError(
        f"effect {label!r} is not in the library; wanted one of {', '.join(e.name for e in library())} "
        f"(creep:2 for "
        "two terms)" + (f"; {name} has no law with {terms} terms" if terms else "")
    )
