"""Effects of the silicone itself: its law and its memory."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibrate import Parameter
from fe import Material
from twin.effects.families import Parts, Wide, in_logs
from twin.effects.mechanism import Mechanism, Owner
from twin.effects.phrases import felt, listed, number, percent, way
from twin.effects.protocol import Effect, Family, Order, Test, Theta, Unsolvable, symmetric
from twin.effects.requirements import Requirement
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN

ALL = 0.95  # of the stiffness is what relaxation may take


class Elasticity(Effect):
    """The base material: the constants of a law in every element, each free or held at a value."""

    name, order = "elasticity", Order.LAW

    def __init__(
        self,
        law: RubberLaw = MOONEY_RIVLIN,
        *,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        fixed: Theta | None = None,
        nominal: Constants | None = None,
    ) -> None:
        self.law, self.sentence = law, f"{law.title} rubber"
        self.fixed = dict(fixed or {})
        self.nominal = nominal or law.nominal
        limits = {**law.bounds, **(bounds or {})}
        self.parameters = tuple(
            replace(p, low=low, high=high, start=float(np.clip(self.nominal[p.name], low, high)))
            for p in law.parameters
            if p.name not in self.fixed
            for low, high in [limits[p.name]]
        )

    def fitted(self) -> "Elasticity":
        """The same law for least squares, whose bounds may be wider: `RubberLaw.widened`."""
        wider = self.law.widened({p.name: (p.low, p.high) for p in self.parameters}, self.fixed)
        return Elasticity(self.law, bounds=wider, fixed=self.fixed, nominal=self.nominal)

    @property
    def scales(self) -> tuple[float, float]:
        """The smallest and the largest scale that the constants may have, MPa."""
        held = {name: (value, value) for name, value in self.fixed.items()}
        return self.law.scales({p.name: (p.low, p.high) for p in self.parameters} | held)

    @property
    def initial(self) -> Constants:
        """The constants with which a fit begins: nominal ones within their bounds."""
        return self.constants({p.name: p.start or 0.0 for p in self.parameters})

    def constants(self, values: Theta) -> Constants:
        """The constants among named values, those held at a value included."""
        return self.law.of({**values, **self.fixed})

    def before(self, test: Test, theta: Theta) -> Test:
        return replace(test, case=test.case.with_material(**self.constants(theta).terms))


class Creep(Family):
    """Finite-strain Prony relaxation G(t) = G0 [1 - sum g_i (1 - exp(-t / tau_i))] with one or two terms."""

    name, order, requires = "creep", Order.MATERIAL, (Requirement.HISTORY,)
    mechanism = Mechanism.HISTORY
    sentence = "the silicone creeps: it keeps moving under a held pressure and recovers slowly"

    def law(self, terms: int) -> tuple[Parameter, ...]:
        return tuple(
            p
            for i in range(1, terms + 1)
            for p in (
                Parameter(f"creep.g{i}", 0.0, 0.4, "", null=0.0, typical=0.02, plausible=(0.003, 0.2)),
                Parameter(f"creep.tau{i}", 0.2, 200.0, "s", typical=1.0, plausible=(0.5, 100.0)),
            )
        )

    def tried(self, terms: int) -> tuple[Theta, ...]:
        times = (0.6, 1.2, 2.5, 5.0, 10.0, 20.0) if terms == 1 else ()
        return tuple({"creep.tau1": tau} for tau in times)

    def before(self, test: Test, theta: Theta) -> Test:
        series = tuple((theta[f"creep.g{i}"], theta[f"creep.tau{i}"]) for i in range(1, self.terms + 1))
        return replace(test, case=test.case.with_material(prony=series))

    def told(self, values: Theta) -> str:
        terms = [(values[f"creep.g{i}"], values[f"creep.tau{i}"]) for i in range(1, self.terms + 1)]
        (g, tau), *more = terms
        rest = "".join(f", {percent(g)} with {number(tau)} s" for g, tau in more)
        return f"the silicone creeps: {percent(g)} of its stiffness relaxes with {number(tau)} s{rest}"

    def start(self, theta: Theta) -> Theta:
        if self.terms == 1:
            return theta
        rest = {k: v for k, v in theta.items() if not k.startswith("creep.")}
        g, tau = theta["creep.g1"], theta["creep.tau1"]
        slow = float(np.clip(4 * tau, 0.2, 150.0))
        fast = {"creep.g1": 0.7 * g, "creep.tau1": max(0.6 * tau, 0.2)}
        return {**rest, **fast, "creep.g2": 0.5 * g, "creep.tau2": slow}

    def wide(self) -> Effect:
        return CreepSpectrum()


class CreepSpectrum(Wide, of=Creep):
    """Prony relaxation on fixed time constants TAUS, from some frames of a film to its length: amplitudes w
    alone. Three a decade carry one term anywhere between them to 0.6 % of it, where amplitudes may be a
    little below 0 (to 2.3 % where they may not)."""

    TAUS: ClassVar[tuple[float, ...]] = (0.3, 0.66, 1.45, 3.2, 7.0, 15.5, 34.0, 75.0)  # s
    parameters = tuple(
        Parameter(f"creep.w{k}", -0.05, 0.3, "", null=0.0, typical=0.02, plausible=(-0.03, 0.1))
        for k in range(1, len(TAUS) + 1)
    )

    def before(self, test: Test, theta: Theta) -> Test:
        series = tuple((theta[p.name], tau) for p, tau in zip(self.parameters, self.TAUS, strict=True))
        if sum(w for w, _ in series) > ALL:
            raise Unsolvable("creep: the amplitudes add up to all of the stiffness; wanted less than that")
        return replace(test, case=test.case.with_material(prony=series))

    def told(self, values: Theta) -> str:
        w = [values[p.name] for p in self.parameters]
        terms = [f"{way(w[k], '', '-')}{percent(w[k])} with {number(self.TAUS[k])} s" for k in felt(w)]
        return f"the silicone creeps: {percent(sum(w))} of its stiffness relaxes, {listed(terms)}"

    def amounts(self, theta: Theta) -> dict[str, float]:
        """Each g shared by the two nearest of TAUS, by the logarithm of its tau."""
        terms = [(theta[f"creep.g{i}"], theta[f"creep.tau{i}"]) for i in (1, 2) if f"creep.g{i}" in theta]
        return self.bounded(in_logs(terms, self.TAUS))


STRETCH = 1.5  # at which what stiffens is told: I1 - 3 and I2 - 3 there
STRAINED = STRETCH**2 + 2 / STRETCH - 3, STRETCH**-2 + 2 * STRETCH - 3
ADDED = {  # terms of the energy that may be missing, in the order in which they are tried
    "C20": Parameter("stiffening.C20", -0.05, 0.5, "MPa", null=0.0, typical=0.005, plausible=(-0.02, 0.05)),
    "C30": Parameter("stiffening.C30", -0.02, 0.2, "MPa", null=0.0, typical=0.002, plausible=(-0.005, 0.02)),
    "C11": Parameter("stiffening.C11", -0.1, 0.3, "MPa", null=0.0, typical=0.005, plausible=(-0.02, 0.03)),
    "C02": Parameter("stiffening.C02", -0.1, 0.3, "MPa", null=0.0, typical=0.005, plausible=(-0.02, 0.03)),
}


def missing(law: RubberLaw) -> tuple[Parameter, ...]:
    """The terms to second order in both invariants, and C30, that a law does not have itself."""
    return tuple(p for name, p in ADDED.items() if name not in law.names)


def richer(m: Material, added: Theta) -> Material:
    """A material with more of the terms C20 (I1 - 3)^2, C30 (I1 - 3)^3, C11 (I1 - 3) (I2 - 3) and
    C02 (I2 - 3)^2, by name, MPa.

    >>> richer(Material(C10=0.2, C01=0.1), {"C20": 0.01}).shear == Material(C10=0.2, C01=0.1).shear
    True

    The mixed one and that in I2 are written as terms of Ogden, by l1^-4 + l2^-4 + l3^-4 = I2^2 - 2 I1 and
    l1^6 + l2^6 + l3^6 = I1^3 - 3 I1 I2 + 3. None of them changes the shear modulus at rest.
    """
    C20, C30, C11, C02 = (added.get(name, 0.0) for name in ADDED)
    pairs = {"C11": (-6 * C11, 6.0), "C02": (8 * C02, -4.0)}
    return replace(
        m,
        C10=m.C10 + 6 * C11 + 2 * C02,
        C01=m.C01 - 3 * C11 - 6 * C02,
        C20=m.C20 + C20 + 3 * C11,
        C30=m.C30 + C30 + C11 / 3,
        ogden=(*m.ogden, *(pair for name, pair in pairs.items() if name in added)),
    )


class Stiffening(Family):
    """A term in the energy that the law of the base model has not: to Mooney-Rivlin rubber C20 (I1 - 3)^2, by
    which it stiffens, or softens, with strain. With two terms a cubic one, C30 (I1 - 3)^3, too: Yeoh's law,
    and Gent's to third order. Yeoh's law itself has both: to that C11 (I1 - 3) (I2 - 3) is added first, and
    then C02 (I2 - 3)^2."""

    name, order = "stiffening", Order.MATERIAL

    def __init__(self, terms: int = 1, law: RubberLaw = MOONEY_RIVLIN) -> None:
        self.base, self.sentence = law, f"the silicone stiffens or softens with strain, {_other(law)}"
        super().__init__(terms)

    def again(self, terms: int) -> "Stiffening":
        return Stiffening(terms, self.base)

    def beside(self, law: RubberLaw) -> "Stiffening":
        return Stiffening(self.terms, law)

    def law(self, terms: int) -> tuple[Parameter, ...]:
        return missing(self.base)[:terms]

    def start(self, theta: Theta) -> Theta:
        return {**{p.name: 0.0 for p in self.parameters[1:]}, **theta}

    def before(self, test: Test, theta: Theta) -> Test:
        return _with_terms(test, self.parameters, theta)

    def told(self, values: Theta) -> str:
        c = {name: values.get(p.name, 0.0) for name, p in ADDED.items()}
        x, y = STRAINED
        more = 4 * c["C20"] * x + 6 * c["C30"] * x**2
        more += 2 * c["C11"] * (y + x / STRETCH) + 4 * c["C02"] * y / STRETCH
        return (
            f"the silicone {way(more, 'stiffens', 'softens')} with strain, {_other(self.base)}, "
            f"by {number(more)} MPa of its shear modulus at a stretch of {STRETCH:g}"
        )

    def wide(self) -> Effect:
        return StrainEnergy(self.base)


def _other(law: RubberLaw) -> str:
    return f"other than the {law.title} law says"


def _with_terms(test: Test, parameters: Sequence[Parameter], theta: Theta) -> Test:
    """The test with these terms more in the energy of its silicone."""
    added, case = {p.name.partition(".")[2]: theta[p.name] for p in parameters}, test.case
    materials = {name: richer(m, added) for name, m in case.materials.items() if name not in case.kept}
    return replace(test, case=replace(case, materials={**case.materials, **materials}))


class StrainEnergy(Wide, of=Stiffening):
    """The strain energy to second order in both invariants, and C30 (I1 - 3)^3: all terms of `richer` that
    the law has not (Rivlin & Saunders 1951, doi 10.1098/rsta.1951.0004)."""

    def __init__(self, law: RubberLaw = MOONEY_RIVLIN) -> None:
        self.base, self.parameters = law, missing(law)
        self.sentence = Stiffening(1, law).sentence

    def beside(self, law: RubberLaw) -> "StrainEnergy":
        return StrainEnergy(law)

    def before(self, test: Test, theta: Theta) -> Test:
        return _with_terms(test, self.parameters, theta)


class Mullins(Family):
    """Mullins softening below the largest energy that a point has carried: the stress is multiplied by
    1 - softening erf((W_max - W) / (m + beta W_max)), softening = 1/r (Ogden & Roxburgh 1999,
    doi 10.1098/rspa.1999.0431). One term: beta = 0. The finger is virgin at the beginning of the path.

    Derivatives are those on the side of W_max on which each point is: where a parameter moves the moment at
    which W_max is met again, an output there has another slope on either side.
    """

    name, order = "mullins", Order.MATERIAL
    mechanism = Mechanism.HISTORY
    requires = (Requirement.HISTORY, Requirement.UNLOADING)
    sentence = "the silicone is softer below the largest load it has carried (Mullins softening)"
    added: ClassVar[Theta] = {"mullins.beta": 0.5}

    def law(self, terms: int) -> tuple[Parameter, ...]:
        return (
            Parameter("mullins.softening", 0.0, 0.9, "", null=0.0, typical=0.1, plausible=(0.02, 0.6)),
            Parameter("mullins.m", 1e-4, 0.1, "MPa", typical=2e-3, plausible=(3e-4, 0.03)),
            Parameter("mullins.beta", 0.0, 2.0, "", null=0.0, typical=0.1, plausible=(0.0, 1.0)),
        )[: 1 + terms]

    def tried(self, terms: int) -> tuple[Theta, ...]:
        return tuple({"mullins.m": m} for m in (5e-4, 2e-3, 8e-3, 3e-2)) if terms == 1 else ()

    def wide(self) -> Effect:
        return Mullins(2)  # the widest that the solver has: all of its constants free

    def before(self, test: Test, theta: Theta) -> Test:
        law = (theta["mullins.softening"], theta["mullins.m"], theta.get("mullins.beta", 0.0))
        return replace(test, case=test.case.with_material(mullins=law))

    def told(self, values: Theta) -> str:
        most = percent(values["mullins.softening"])
        return f"the silicone is up to {most} softer below the largest load it has carried (Mullins)"


class Compressibility(Effect):
    """The bulk modulus K is finite beyond the base's: 1/K = 1/K_base + excess."""

    name, order = "compressibility", Order.MATERIAL
    sentence = "the silicone changes its volume (bubbles, or a low bulk modulus)"
    parameters = (
        Parameter("compressibility.excess", 0.0, 0.5, "1/MPa", null=0.0, typical=0.02, plausible=(1e-3, 0.2)),
    )

    def before(self, test: Test, theta: Theta) -> Test:
        excess = theta["compressibility.excess"]
        materials = {
            name: replace(m, bulk_ratio=m.bulk_ratio / (1 + m.bulk * excess))
            for name, m in test.case.materials.items()
            if name not in test.case.kept
        }
        case = replace(test.case, materials={**test.case.materials, **materials})
        return replace(test, case=case)

    def told(self, values: Theta) -> str:
        share = percent(0.1 * values["compressibility.excess"])
        return f"the silicone changes its volume by {share} under 100 kPa (bubbles, low bulk modulus)"

    def wide(self) -> Effect:
        return Parts(self)


class Thermal(Effect):
    """All moduli drift with time: times 1 + rate t, t on the clock of the pressure log."""

    name, order = "thermal", Order.MATERIAL
    mechanism = Mechanism.HISTORY
    belongs = Owner.RIG  # a film's own: how warm the room was
    sentence = "the silicone gets stiffer or softer with time (its temperature drifts)"
    parameters = symmetric("thermal.rate", most=5e-3, unit="1/s", step=2e-4, likely=1e-3)

    def before(self, test: Test, theta: Theta) -> Test:
        factor = 1 + theta["thermal.rate"] * test.path.time
        return replace(test, path=replace(test.path, stiffness=factor))

    def told(self, values: Theta) -> str:
        return _drifting(60 * values["thermal.rate"], "a minute")

    def wide(self) -> Effect:
        return ModulusDrift()


class ModulusDrift(Wide, of=Thermal):
    """All moduli follow a polynomial of time: times 1 + a x + b x (1 - x) + c x (1 - x) (1 - 2 x), x in
    minutes on the clock of the pressure log."""

    MINUTE: ClassVar[float] = 60.0  # s
    parameters = symmetric(*(f"thermal.{k}" for k in "abc"), most=0.5, unit="", step=0.01, likely=0.06)

    def before(self, test: Test, theta: Theta) -> Test:
        x = test.path.time / self.MINUTE
        basis = (x, x * (1 - x), x * (1 - x) * (1 - 2 * x))
        factor = 1 + np.tensordot([theta[p.name] for p in self.parameters], basis, 1)
        return replace(test, path=replace(test.path, stiffness=factor))

    def told(self, values: Theta) -> str:
        return _drifting(values["thermal.a"], "in the first minute of the pressure log")

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {"thermal.a": self.MINUTE * theta.get("thermal.rate", 0.0)}


def _drifting(much: float, when: str) -> str:
    stiffer = way(much, "stiffer", "softer")
    return f"the silicone gets {percent(much)} {stiffer} {when} (its temperature drifts)"
