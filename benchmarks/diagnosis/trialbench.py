"""One virtual trial on the short finger: hidden truth, targets, reduced model, diagnosis, and what it is
worth."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import benchmarks  # noqa: F401
from benchmarks.diagnosis.bank import LEFT_OUT, MAIN, fitted_case
from benchmarks.diagnosis.reduced import ReducedModel, Tables, has_table
from benchmarks.diagnosis.simplerules import named_by, ridge
from benchmarks.diagnosis.snapshots import POINTS, SHORT
from benchmarks.diagnosis.truthbook import displaced, slope

import numpy as np

from twin.diagnosis.procedure import diagnose
from twin.diagnosis.record import DiagnosisRecord
from twin.effects.library import all_effects
from twin.effects.protocol import Effect, Unsolvable
from twin.judging.fitting import whitener_of
from twin.model.basemodel import base_model
from twin.project import files
from twin.targets import Array, PointKind, TargetPoint, Targets
from twin.virtual.draws import Setup, measured
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import PROTOCOLS, Protocol, places

SD_MM = 0.015
START = np.array([0.2, 0.1])
NAMES = tuple(places(SHORT))
EDGE = [k for k, n in enumerate(NAMES) if n.startswith("p")]
TIP, OFF = NAMES.index("tip"), [k for k, n in enumerate(NAMES) if n.startswith("off")]


@dataclass(frozen=True)
class Spec:
    """A trial: its group, protocol, kinds hidden and non-centrality wanted (0: nothing hidden), noise, seed,
    and effects that are left out of the candidates."""

    group: str
    protocol: str
    kinds: tuple[str, ...]
    sigmas: float
    noise: str
    seed: int
    without: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """What names it in the file of results."""
        what = "+".join(self.kinds) or "nothing"
        return f"{self.group}/{self.protocol}/{what}/{self.sigmas:g}/{self.noise}/{self.seed}"


@dataclass(frozen=True)
class Scene:
    """A protocol with its markers glued and its noise drawn; the reduced model beside it."""

    protocol: Protocol
    rows: list[int]
    setup: Setup
    seed: int
    start: float = 0.0  # of the course, on the clock of the targets

    @staticmethod
    def of(spec: Spec) -> "Scene":
        """The scene of a trial: which places carry markers is drawn too."""
        protocol, rng = PROTOCOLS[spec.protocol], np.random.default_rng([spec.seed, 7])
        edge = sorted(rng.choice(EDGE, protocol.along - 1, replace=False)) if protocol.along > 1 else []
        off = sorted(rng.choice(OFF, protocol.off_axis, replace=False)) if protocol.off_axis else []
        return Scene(
            protocol,
            [*map(int, edge), TIP, *map(int, off)],
            Setup(sd_mm=SD_MM, noise=spec.noise, placement_sd_mm=0.02),
            spec.seed,
        )

    @property
    def points(self) -> tuple[TargetPoint, ...]:
        """The markers on the finger."""
        return tuple(
            TargetPoint(NAMES[k], PointKind.PLACE, None, tuple(map(float, POINTS[k]))) for k in self.rows
        )  # type: ignore[arg-type]

    def true(self, hidden: tuple[tuple[Kind, float], ...]) -> Array:
        """True displacements (s, m, 3) mm of the markers, and of fixed ones where there are any."""
        return displaced(self.protocol, hidden, self.rows)

    def targets(self, hidden: tuple[tuple[Kind, float], ...]) -> Targets:
        """One draw of what would be measured."""
        return measured(self.protocol, self.true(hidden), slope(self.protocol)[:, self.rows],
        points=self.points, setup=self.setup, seed=self.seed)  # fmt: skip

    def model(self, targets: Targets) -> ReducedModel:
        """The reduced model of targets."""
        base = base_model(
            targets, fitted_case() if self.protocol.weighed else fitted_case().with_material(density=0.0)
        )
        tables = shared_tables(tuple(self.rows), tuple(targets.time - self.start), self.protocol)
        model = ReducedModel(test=base.test, effects=base.effects, reference=base.reference, tables=tables)
        return model.on_mesh(mesh_of(tuple(self.rows), self.protocol.weighed))  # type: ignore[return-value]


@lru_cache(maxsize=64)
def shared_tables(rows: tuple[int, ...], times: tuple[float, ...], protocol: Protocol) -> Tables:
    """The tables of some places in a protocol, kept: their effects' tables take a while to read."""
    way = protocol.block if protocol.weighed else np.zeros(len(times), np.int64)
    return Tables(np.array(rows), np.array(times), way, protocol.weighed)


@lru_cache(maxsize=64)
def mesh_of(rows: tuple[int, ...], weighed: bool) -> Any:
    """The measured error of the fitted mesh at some places."""
    from benchmarks.diagnosis.meshbook import discretisation

    return discretisation(rows, weighed)


@lru_cache(maxsize=4)
def candidates(without: tuple[str, ...] = ()) -> tuple[Effect, ...]:
    """All effects that the tables know."""
    from benchmarks.diagnosis.bank import case_test

    test = case_test(fitted_case())
    return tuple(e for e in all_effects() if e.name not in (*LEFT_OUT, *without) and has_table(e, test))


def beside(model: ReducedModel, without: tuple[str, ...]) -> tuple[Effect, ...]:
    """The generic stand-ins that the tables know."""
    from twin.effects.standins import stand_ins

    return tuple(e for e in stand_ins(model.test) if e.name not in without and has_table(e, model.test))


# -- size ---------------------------------------------------------------------------------------------------


def sized(scene: Scene, kind: Kind, sigmas: float, rng: np.random.Generator) -> tuple[float, float]:
    """The size of a kind with a non-centrality beside the fitted constants, and the one it has; the largest
    that was solved where that is too small."""
    low, high = kind.range
    sign = 1.0 if low == 0.0 or rng.random() < 0.5 else -1.0
    sign = -1.0 if kind.name == "force_down" else 1.0 if kind.name == "force_up" else sign
    top = abs(high if sign > 0 else low)
    see, bare = _projector(scene), scene.true(())

    def at(a: float) -> float:
        u = scene.true(((kind, sign * a),))
        return see(u - _beside(bare, u))

    if sigmas <= 0:
        return 0.0, 0.0
    a = top
    for _ in range(3):
        z = at(a)
        a = min(top, a * sigmas / max(z, 1e-9))
    return sign * a, at(a)


def _beside(bare: Array, u: Array) -> Array:
    """The bare motion, and that of fixed markers where the camera sees them move."""
    rest = np.zeros((len(u), u.shape[1] - bare.shape[1], 3))
    return np.concatenate([bare, rest], axis=1)


def largest(scene: Scene, kind: Kind) -> float:
    """The non-centrality of a kind at its largest size."""
    u = scene.true(((kind, kind.range[1]),))
    return float(_projector(scene)(u - _beside(scene.true(()), u)))


def cosine(scene: Scene, a: Kind, b: Kind) -> float:
    """How alike the changes by two kinds are at their largest sizes, beside the fitted constants: 1 where
    they cannot be told apart."""
    bare, see = scene.true(()), _projector(scene)
    one, two = (u - _beside(bare, u) for u in (scene.true(((k, k.range[1]),)) for k in (a, b)))
    x, y = see(one), see(two)
    both = _beside(one, two) + two if one.shape[1] < two.shape[1] else one + _beside(two, one)
    return float(abs(see(both) ** 2 - x**2 - y**2) / (2 * x * y))


def _projector(scene: Scene) -> Any:
    targets = scene.targets(())
    model = scene.model(targets)
    theta = np.array([MAIN.C10, MAIN.C01])
    w = whitener_of(model, theta, targets)
    rows = w.whiten(model.jacobian(theta)).T
    q, _ = np.linalg.qr(rows)

    def length(change: Array) -> float:
        full = np.zeros(targets.value.shape)
        full[:, : change.shape[1]] = change - change[targets.reference].mean(axis=0)
        z = w.whiten(full)
        return float(np.linalg.norm(z - q @ (q.T @ z)))

    return length


# -- one trial ----------------------------------------------------------------------------------------------


def run(spec: Spec) -> dict[str, Any]:
    """The row of results of a trial."""
    began, scene = time.process_time(), Scene.of(spec)
    rng = np.random.default_rng([spec.seed, 11])
    hidden, sizes = [], []
    for name in spec.kinds:
        size, z = sized(scene, KINDS[name], spec.sigmas, rng)
        hidden.append((KINDS[name], size))
        sizes.append({"name": name, "size": size, "sigmas": z})
    targets = scene.targets(tuple(hidden))
    model = scene.model(targets)
    row: dict[str, Any] = {
        "key": spec.key,
        "group": spec.group,
        "protocol": spec.protocol,
        "kinds": list(spec.kinds),
        "physics": [k.physics for k, _ in hidden],
        "wanted": spec.sigmas,
        "hidden": sizes,
    }
    middle = time.process_time()
    try:
        said = diagnose(model, candidates(spec.without), targets, seed=spec.seed, start=START,
                        beside=beside(model, spec.without), plan=False)  # fmt: skip
    except Unsolvable as error:
        return row | {"verdict": f"unsolvable: {error}", "names": [], "seconds": time.process_time() - middle}
    row |= {"seconds": time.process_time() - middle, "solves": model.counted[0]}
    return row | worth(said, scene, tuple(hidden), targets) | {"prepared": middle - began}


def worth(
    said: Any, scene: Scene, hidden: tuple[tuple[Kind, float], ...], targets: Targets
) -> dict[str, Any]:
    """What a diagnosis says and how good it is."""
    plain = files.plain(DiagnosisRecord.of(said))
    noise = plain.get("noise_sd_mm")
    found = {
        "verdict": plain["verdict"], "sentence": plain["sentence"], "named": plain["named"], "law":
        plain["law"], "ties": plain["ties"], "classes": [c["members"] for c in plain.get("classes") or []],
        "rms_over_sd": plain["rms_after_mm"] / noise if noise and plain["rms_after_mm"] else None,
        "adequate": plain["adequate"], "names": in_verdict(plain),
    }  # fmt: skip
    judged = judged_of(said)
    if judged is None:
        return found
    base = said.base
    found["baselines"] = named_by(base, candidates(), targets)
    found |= {"inside": coverage(judged, hidden), "heldout": heldout(judged, scene, hidden)}
    if scene.protocol.held_out is not None:
        held = targets.held_out
        learnt = ridge(base, targets, held)
        found["base_heldout"] = heldout(base, scene, hidden)
        found["ridge_heldout"] = heldout(base, scene, hidden, learnt)
    return found


def in_verdict(plain: Mapping[str, Any]) -> list[str]:
    """The effects that a verdict names: those of `A or B`, `A + B`, `A`."""
    tied = [name for tie in plain["ties"] for name in tie]
    return list(dict.fromkeys([*plain["named"], *tied]))


def judged_of(said: Any) -> Any:
    """The kept refit, or the base's."""
    kept = said.kept
    return getattr(kept, "refit", None) or kept or said.base


def coverage(judged: Any, hidden: Sequence[tuple[Kind, float]]) -> dict[str, bool]:
    """Whether 95 % intervals of the kept fit hold the truth: the sum of the constants, the share, and the
    size of an effect whose law is the library's."""
    fit = judged.fit
    names, theta = (
        [p.name for p in fit.parameters],
        dict(zip((p.name for p in fit.parameters), fit.theta, strict=True)),
    )
    if (
        not {"C10", "C01"} <= set(names)
        or {"C10", "C01"} & set(fit.at_bound)
        or not np.isfinite(fit.covariance).all()
    ):
        return {}
    i, j = names.index("C10"), names.index("C01")
    own = fit.covariance[np.ix_([i, j], [i, j])]
    out = {}
    for key, g, error in (
        ("sum", np.ones(2), theta["C10"] + theta["C01"] - MAIN.total),
        ("share", _share_slope(theta), theta["C01"] / (theta["C10"] + theta["C01"]) - MAIN.share),
    ):
        out[key] = bool(abs(error) <= 1.96 * np.sqrt(g @ own @ g))
    for kind, size in hidden:
        name = kind.amplitude
        if kind.law == "same" and name in names and name not in fit.at_bound:
            k = names.index(name)
            out["size"] = bool(abs(theta[name] - size) <= 1.96 * np.sqrt(fit.covariance[k, k]))
    return out


def _share_slope(theta: Mapping[str, float]) -> Array:
    total = theta["C10"] + theta["C01"]
    return np.array([-theta["C01"], theta["C10"]]) / total**2


def heldout(
    judged: Any, scene: Scene, hidden: tuple[tuple[Kind, float], ...], learnt: Array | float = 0.0
) -> float | None:
    """Root mean square (mm) by which the kept fit misses the true motion in the recording held out, x and
    z."""
    held = scene.protocol.held_out
    if held is None:
        return None
    true = scene.true(hidden)
    reference = judged.model.reference
    true = (true - true[reference].mean(axis=0))[scene.protocol.block == held]
    told = (judged.model.predict(judged.fit.theta)[scene.protocol.block == held] + learnt)[:, : true.shape[1]]
    return float(np.sqrt(((told - true)[:, : len(scene.rows), ::2] ** 2).mean()))
