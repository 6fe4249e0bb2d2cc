"""The sampler of a posterior on closed-form models: the mesh's stiffness, checks by whole solves, going on."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibrate import Parameter
from calibrate.posteriors import END, Chain
from calibrate.priors import Prior
from tests.messages import saying
from tests.twin.calibrated import closedfinger as knowing
from tests.twin.conftest import plain_targets
from twin.calibrated import posterior
from twin.calibrated.posterior import CHECKS, OFF, Density, Sample, Sampler, WholeSolve
from twin.effects.protocol import Unsolvable
from twin.judging.fitting import ModelErrors
from twin.judging.likelihood import held
from twin.targets import Array

BOTH = (Parameter("C10", 0.01, 1.5, "MPa", typical=0.02), Parameter("g", 0.0, 1.0, typical=0.05))
X = np.linspace(0.2, 1.0, 12)
TRUE, SD = np.array([0.3, 0.4]), 0.02


def shown(theta: Array) -> Array:
    """Values (m, 12) of a slightly bent model at theta (m, 2)."""
    return np.asarray(theta[:, :1] * X + theta[:, 1:] * X**2 + 0.2 * theta[:, :1] * theta[:, 1:])


@dataclass(frozen=True)
class Stub:
    """A response that is off by `wrong` sd in one value until so many solves have joined it."""

    wrong: float = 0.0
    until: int = 0
    solves: int = 0
    reach: float = np.inf
    parameters: tuple[Parameter, ...] = BOTH
    fields: Array = field(default_factory=lambda: np.eye(len(X)))
    law: None = None

    def joined(self, _: object) -> "Stub":
        return replace(self, solves=self.solves + 1)

    def coefficients(self, theta: Array) -> Array:
        off = self.wrong * SD * (self.solves < self.until)
        far = theta[:, 1:] > self.reach
        return np.where(far, np.nan, shown(theta) + off * np.eye(len(X))[3])

    def named(self, theta: Array) -> dict[str, float]:
        return dict(zip(("C10", "g"), theta, strict=True))

    def allowed(self, values: dict[str, float]) -> bool:
        return values["g"] < 0.42


@dataclass
class Memory:
    """What a sampler keeps, in memory; stops a sampler after so many blocks of steps."""

    stop: int = 10**9
    solves: list[WholeSolve] = field(default_factory=list)
    chains: dict[int, Chain] = field(default_factory=dict)
    decided: dict[int, Array] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def solve(self, theta: Array) -> WholeSolve | None:
        return next((one for one in self.solves if np.array_equal(one.theta, theta)), None)

    def add_solve(self, solve: WholeSolve) -> None:
        self.solves.append(solve)

    def chain(self, number: int) -> Chain | None:
        return self.chains.get(number)

    def set_chain(self, number: int, chain: Chain, most: int) -> None:
        self.chains = {number: chain}
        self.stop -= 1
        if not self.stop:
            raise KeyboardInterrupt

    def points(self, number: int) -> Array | None:
        return self.decided.get(number)

    def set_points(self, number: int, points: Array) -> None:
        self.decided[number] = points

    def note(self, text: str) -> None:
        self.notes.append(text)


class Closed(Sampler):
    """A sampler whose whole solves are `shown`; none beyond `end` of C10."""

    end = np.inf

    def solve(self, theta: Array) -> WholeSolve:
        known = self.keeping.solve(theta)
        if known is None:
            h = 1e-6 * np.eye(2)
            u = shown(theta[None])[0] if theta[0] < self.end else np.full(len(X), np.nan)
            known = WholeSolve(theta, u, (shown(theta + h) - shown(theta - h)) / 2e-6, 0.3 * float(theta[0] / 0.01))
            self.keeping.add_solve(known)
        return known


def sampler(memory: Memory, monkeypatch: pytest.MonkeyPatch, response: Stub, *, everywhere: bool = True) -> Closed:
    """A sampler of the closed model whose first response is given; stable everywhere, or as `Stub` says."""
    monkeypatch.setattr(posterior, "begun", lambda model, theta: response)
    z = np.random.default_rng(3).normal(size=len(X))
    white = SimpleNamespace(whiten=lambda field: np.asarray(field) / SD)
    model: Any = SimpleNamespace(
        parameters=BOTH, mesh=None, law=None, named=response.named, allowed=(lambda values: True) if everywhere else response.allowed
    )
    targets: Any = SimpleNamespace(value=shown(TRUE[None])[0] + SD * z, known=(), curves=())
    made = Closed(model, targets, SimpleNamespace(modes=np.zeros((0, 1))), TRUE, memory)  # type: ignore[arg-type]
    made.__dict__["whitener"] = white
    return made


def integrated(one: Closed) -> tuple[Array, Array]:
    """Mean (2,) and sd (2,) of the posterior by a grid; what the errors add is 30 a MPa of C10."""
    a, b = np.linspace(0.1, 0.5, 401), np.linspace(0.0, 0.9, 401)
    at = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
    chi2 = (((one.targets.value - shown(at)) / SD) ** 2).sum(axis=1) + 30 * at[:, 0]
    p = np.exp(np.maximum(-0.5 * (chi2 - chi2.min()), -300.0))
    mean = (p @ at) / p.sum()
    return mean, np.sqrt((p @ (at - mean) ** 2) / p.sum())


def same(a: Sample, b: Sample) -> None:
    for name, x in a.chain.arrays.items():
        np.testing.assert_array_equal(x, b.chain.arrays[name], err_msg=name)
    assert (a.solves, a.off, a.doubt) == (b.solves, b.off, b.doubt)


@pytest.mark.slow
def test_a_response_that_is_off_is_made_better_and_the_chain_run_again(monkeypatch: pytest.MonkeyPatch) -> None:
    memory, response = Memory(), Stub(wrong=3.0, until=1 + 4 + 1)
    one = sampler(memory, monkeypatch, response)
    found = one.sample(seed=1, most=20000)
    assert found.doubt == ""
    assert sorted(memory.decided) == [0, 1]  # two chains
    assert found.solves == 1 + 4 + 2 * CHECKS == len(memory.solves)
    assert found.off[0] < 1e-6 < OFF
    assert "off by 0." not in memory.notes[0]  # by 9 and more
    mean, sd = integrated(one)
    values = found.density.true(found.chain.samples)
    np.testing.assert_allclose((values.mean(axis=0) - mean) / sd, 0, atol=0.08)  # of 3000 positions: 4 sds
    np.testing.assert_allclose(values.std(axis=0), sd, rtol=0.08)
    assert found.values.shape == (2000, 2)
    np.testing.assert_allclose(found.shown(), shown(found.values))

    killed = Memory(stop=len(memory.notes) + 4)  # in the second block of some chain
    with pytest.raises(KeyboardInterrupt):
        sampler(killed, monkeypatch, response).sample(seed=1, most=20000)
    same(sampler(killed, monkeypatch, response).sample(seed=1, most=20000), found)


@pytest.mark.slow
def test_a_response_that_stays_off_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(posterior, "ROUNDS", 2)
    found = sampler(Memory(), monkeypatch, Stub(wrong=3.0, until=10**6)).sample(seed=1, most=20000)
    assert "the response is off whole solves by" in found.doubt
    monkeypatch.setattr(Closed, "end", 0.32)
    found = sampler(Memory(), monkeypatch, Stub()).sample(seed=1, most=20000)
    assert found.doubt == "it goes where the model has no stable equilibrium"
    monkeypatch.setattr(Closed, "end", np.inf)
    found = sampler(Memory(), monkeypatch, Stub(reach=0.45)).sample(seed=1, most=20000)
    assert found.doubt.startswith("it goes as far as the response reaches")
    monkeypatch.setattr(Closed, "solve", _only_the_fit(Closed.solve))
    with pytest.raises(ValueError, match=saying("5", "1", "twin profile")):
        sampler(Memory(), monkeypatch, Stub()).sample(seed=1, most=250)
    monkeypatch.undo()
    found = sampler(Memory(), monkeypatch, Stub()).sample(seed=1, most=250)
    assert "autocorrelation times" in found.doubt


def _only_the_fit(whole: Callable[[Closed, Array], WholeSolve]) -> Callable[[Closed, Array], WholeSolve]:
    def solve(self: Closed, theta: Array) -> WholeSolve:
        made = whole(self, theta)
        return made if np.array_equal(theta, TRUE) else replace(made, u=np.nan * made.u)

    return solve


def test_no_walker_goes_where_the_rubber_is_not_stable(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = Memory()
    found = sampler(memory, monkeypatch, Stub(), everywhere=False).sample(seed=1, most=20000)
    assert not len(memory.decided[0])  # the first chain went there
    assert found.doubt == ""
    assert found.chain.samples[:, 1].max() < 0.42


def test_what_errors_change_is_checked_between_the_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    class Wild(Closed):
        def solve(self, theta: Array) -> WholeSolve:
            return replace(super().solve(theta), moved=float(20 * np.sin(theta[1] * 300)))

    one = sampler(Memory(), monkeypatch, Stub())
    wild = Wild(one.model, one.targets, one.errors, one.theta, one.keeping)
    wild.__dict__["whitener"] = one.whitener
    monkeypatch.setattr(posterior, "ROUNDS", 1)
    assert "errors of gauge, mesh and laws change by more" in wild.sample(seed=1, most=20000).doubt


def test_what_other_errors_add_is_that_of_the_normal_density() -> None:
    """-2 ln of a normal density, by its inverse covariance from whitened unit vectors, without `log_det`."""
    targets, rng = plain_targets(), np.random.default_rng(4)
    s, p = targets.valid.shape[:2]
    mode = 0.02 * rng.normal(size=(1, s, p, 3))
    none = np.zeros((s, p, 3))
    model: Any = SimpleNamespace(mesh=None, law=None, parameters=(), per_pressure=lambda theta: none, modes=lambda theta: 3 * mode)
    errors = ModelErrors(gauge=none, modes=mode)
    memory: Any = None
    made: Any = SimpleNamespace(theta=np.zeros(0), u=0.03 * rng.normal(size=(s, p, 3)))
    wanted, z = 0.0, targets.value - made.u
    for sign, own in ((-1, errors), (1, replace(errors, modes=3 * mode))):
        w = own.whitener(targets)
        unit = np.zeros((w.count, s, p, 3))
        step, column = np.nonzero(w.valid)
        unit[np.arange(w.count), step, *w.components[column].T] = 1.0
        inverse = w.whiten(unit) @ w.whiten(unit).T
        data = w.pick(z)[step, column]
        wanted += sign * (data @ inverse @ data - np.linalg.slogdet(inverse)[1])
    found = Sampler(model, targets, errors, np.zeros(0), memory)._moved(model, made)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_the_stiffness_of_a_mesh_widens_what_it_hides() -> None:
    """With hardly any noise the sum is as uncertain as the mesh is: C exp(-s eta), and the flat prior in C."""
    knowing_sd = 0.05
    response = knowing.ClosedResponse()
    measured = knowing.displacements(knowing.TRUE[None])[0]
    rows = np.column_stack([measured, np.eye(len(measured))]) / 1e-3
    density = Density(response, np.linalg.qr(rows).R, lambda t: np.zeros(len(t)), np.eye(3), knowing_sd, False)  # type: ignore[arg-type]
    eta = np.linspace(-5, 5, 2001)
    x = np.column_stack([np.tile(knowing.TRUE, (len(eta), 1)), eta])
    p = np.exp(density(x) - density(x).max())
    total = density.true(x)[:, :2].sum(axis=1)
    share = np.cumsum(p) / p.sum()
    found = np.interp([1 - q / 100 for q in END], share, total)
    wanted = 0.3 * np.exp(knowing_sd * (2 * knowing_sd + np.array([-1.96, 1.96])))  # eta is normal about -2 s
    np.testing.assert_allclose(found, wanted, rtol=1e-3)
    np.testing.assert_array_equal(density.true(x)[:, 2], knowing.TRUE[2])
    far = np.array([[0.2, 0.09, 0.05, -np.log(7.6) / knowing_sd]])  # its C10 is above 1.5 MPa
    assert density(far)[0] == -np.inf
    assert np.isfinite(density(far * [1, 1, 1, 0.7])[0])


@pytest.mark.slow
def test_a_prior_is_a_factor_of_the_density_at_the_true_constants() -> None:
    """Where the mesh's stiffness is a number of its own, the constants are not those of the mesh."""
    response, s = knowing.ClosedResponse(), 0.05
    rows = np.column_stack([knowing.displacements(knowing.TRUE[None])[0], np.eye(len(knowing.displacements(knowing.TRUE[None])[0]))])
    prior = Prior(held(response.parameters, "C10+C01"), 0.33, 0.01)
    given: Any = (response, np.linalg.qr(rows).R, lambda t: np.zeros(len(t)), np.eye(3), s, False)
    x = np.column_stack([np.tile(knowing.TRUE, (3, 1)), [-1.0, 0.0, 2.0]])
    added = Density(*given, (prior,))(x) - Density(*given)(x)
    total = knowing.TRUE[:2].sum() * np.exp(-s * x[:, -1])
    np.testing.assert_allclose(added, -(((total - 0.33) / 0.01) ** 2) / 2, rtol=1e-9)
    outside = np.array([[9.0, 0.09, 0.05, 0.0]])
    assert Density(*given, (prior,))(outside)[0] == -np.inf


@pytest.mark.slow
def test_intervals_of_virtual_tests_hold_the_truth_as_often_as_they_say() -> None:
    """A few of the trials that docs/records/constants.md counts."""
    found = knowing.coverage([knowing.trial(seed) for seed in range(12)])
    for kind in ("profile", "posterior"):
        for name, share in found[f"coverage_{kind} of"].items():
            assert share >= 9 / 12, name  # of 12, 8 or fewer where 95 % hold: once in 500


def test_tests_of_the_silicone_count_in_the_density(monkeypatch: pytest.MonkeyPatch) -> None:
    def residual(model: object, targets: object, theta: Array) -> Array:
        if theta[0] > 0.5:
            raise Unsolvable("no stress")
        return (theta - TRUE) / [0.01, 0.02]

    monkeypatch.setattr(posterior, "curve_residual", residual)
    one = sampler(Memory(), monkeypatch, Stub())
    assert one._beside is None
    one = replace(one, targets=SimpleNamespace(curves=("a test",)))  # type: ignore[type-var]
    small, x = np.eye(13), np.array([TRUE, TRUE + [0.01, 0.04], TRUE + [0.3, 0.0]])
    bare, both = (
        Density(Stub(), small, lambda theta: np.zeros(len(theta)), np.eye(2), 0.0, False, beside=beside)
        for beside in (None, one._beside)
    )
    np.testing.assert_allclose((both(x) - bare(x))[:2], [0.0, -2.5])  # chi2 of 1 and of 2^2, halved
    assert both(x)[2] == -np.inf
