"""One virtual trial on the short finger: hidden truth, targets, reduced model, diagnosis, and what it is
worth."""

import ast
import hashlib
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from benchmarks import ROOT
from benchmarks.diagnosis.bank import LEFT_OUT, MAIN, fitted_case
from benchmarks.diagnosis.laterkinds import KINDS_LATER
from benchmarks.diagnosis.reduced import ReducedModel, Tables, has_table
from benchmarks.diagnosis.snapshots import POINTS, SHORT
from benchmarks.diagnosis.truthbook import displaced, slope

import numpy as np

from calibrate import Fit
from twin import files
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.procedure import diagnose
from twin.effects.library import all_effects
from twin.effects.protocol import Effect, Unsolvable
from twin.judging.fitting import whitener_of
from twin.judging.judged import judge
from twin.model.keptmodel import base_model
from twin.targets import Array, PointKind, TargetPoint, Targets
from twin.virtual.draws import Setup, measured
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import PROTOCOLS, Protocol, places

EVERY = KINDS | KINDS_LATER
RULE = ("calibrate", "twin/diagnosis", "twin/effects", "twin/judging", "twin/model")  # what decides
SD_MM = 0.015
NOTHING = "nothing"
START = np.array([0.2, 0.1])
NAMES = tuple(places(SHORT))
EDGE = [k for k, n in enumerate(NAMES) if n.startswith("p")]
TIP, OFF = NAMES.index("tip"), [k for k, n in enumerate(NAMES) if n.startswith("off")]


@dataclass(frozen=True)
class Spec:
    """A trial: its group, protocol, kinds hidden and non-centrality wanted (0: nothing hidden), noise, seed,
    and what is left out of candidates and stand-ins: names, or kinds of stand-ins."""

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
        what = "+".join(self.kinds) or NOTHING
        return f"{self.group}/{self.protocol}/{what}/{self.sigmas:g}/{self.noise}/{self.seed}"

    @staticmethod
    def of_key(key: str, without: Sequence[str] = ()) -> "Spec":
        """The trial that a key names."""
        group, protocol, what, sigmas, noise, seed = key.split("/")
        kinds = () if what == NOTHING else tuple(what.split("+"))
        return Spec(group, protocol, kinds, float(sigmas), noise, int(seed), tuple(without))


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

    own = (e for e in stand_ins(model.test) if not left_out(e.name, e.kind, without))
    return tuple(e for e in own if has_table(e, model.test))


def left_out(name: str, kind: str, without: tuple[str, ...]) -> bool:
    """Whether a stand-in is left out: by its name, its kind, or how its name begins, with an underscore."""
    starts = tuple(word for word in without if word.endswith("_"))
    return bool({name, kind} & set(without)) or name.startswith(starts)


# -- size ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sight:
    """What is left of a change of the motion beside the fitted constants, in sds of the noise."""

    scene: Scene
    bare: Array
    targets: Targets
    whitener: Any
    fitted: Array

    @staticmethod
    def of(scene: Scene) -> "Sight":
        """That of a scene where nothing is hidden, at the true constants."""
        targets = scene.targets(())
        model, theta = scene.model(targets), np.array(MAIN.values)
        w = whitener_of(model, theta, targets)
        return Sight(
            scene, scene.true(()), targets, w, np.linalg.qr(w.whiten(model.jacobian(theta)).T)[0]
        )

    def change(self, kind: Kind, size: float) -> Array:
        """The whitened change (n,) by a kind of a size; its length is the non-centrality."""
        u = self.scene.true(((kind, size),))
        change = u.copy()
        change[:, : self.bare.shape[1]] -= self.bare
        return self.left(change)

    def left(self, change: Array) -> Array:
        """The same of a change (s, m, 3) mm of the markers."""
        full = np.zeros(self.targets.value.shape)
        full[:, : change.shape[1]] = change - change[self.targets.reference].mean(axis=0)
        z = self.whitener.whiten(full)
        return np.asarray(z - self.fitted @ (self.fitted.T @ z), float)


def sized(sight: Sight, kind: Kind, sigmas: float, rng: np.random.Generator) -> tuple[float, Array]:
    """The size of a kind with a non-centrality beside the fitted constants, and its whitened change (n,); the
    largest that was solved where that is too small."""
    low, high = kind.range
    sign = 1.0 if low == 0.0 or rng.random() < 0.5 else -1.0
    sign = -1.0 if kind.name == "force_down" else 1.0 if kind.name == "force_up" else sign
    top = a = abs(high if sign > 0 else low)
    if sigmas <= 0:
        return 0.0, np.zeros(1)
    for _ in range(3):
        z = float(np.linalg.norm(sight.change(kind, sign * a)))
        a = min(top, a * sigmas / max(z, 1e-9))
    return sign * a, sight.change(kind, sign * a)


def largest(sight: Sight, kind: Kind) -> Array:
    """The whitened change (n,) by a kind at its largest size."""
    return sight.change(kind, kind.range[1])


def cosine(one: Array, two: Array) -> float:
    """How alike two whitened changes (n,) are: 1 where they cannot be told apart."""
    return float(abs(one @ two) / (np.linalg.norm(one) * np.linalg.norm(two)))


def seen_beside(changes: Sequence[Array]) -> list[float]:
    """The conditional non-centrality of each whitened change (k, n): what the others, at any size, leave of
    it."""
    out = []
    for k, z in enumerate(changes):
        others = np.reshape([x for j, x in enumerate(changes) if j != k], (-1, len(z))).T
        out.append(float(np.linalg.norm(z - others @ np.linalg.lstsq(others, z, rcond=1e-12)[0])))
    return out


# -- one trial ----------------------------------------------------------------------------------------------


def run(spec: Spec) -> dict[str, Any]:
    """The row of results of a trial."""
    began, scene = time.process_time(), Scene.of(spec)
    rng = np.random.default_rng([spec.seed, 11])
    sight = Sight.of(scene) if spec.kinds else None
    drawn = [(EVERY[n], *sized(sight, EVERY[n], spec.sigmas, rng)) for n in spec.kinds if sight]
    hidden = tuple((kind, size) for kind, size, _ in drawn)
    targets = scene.targets(hidden)
    model = scene.model(targets)
    row = told(spec, drawn) | {"prepared": time.process_time() - began}
    middle = time.process_time()
    try:
        said = diagnose(model, candidates(spec.without), targets, seed=spec.seed, start=START,
                        beside=beside(model, spec.without), plan=False)  # fmt: skip
    except Unsolvable as error:
        return row | {"verdict": f"unsolvable: {error}", "names": [], "seconds": time.process_time() - middle}
    row |= {"seconds": time.process_time() - middle, "solves": model.counted[0]}
    row |= worth(said, scene, hidden)
    if hidden and scene.protocol.held_out is not None:
        row["floor"] = floor(scene)
    return row


def attempted(spec: Spec, how: Callable[[Spec], dict[str, Any]] = run) -> dict[str, Any]:
    """As `how` runs it; a trial that breaks is a row too, and no hit."""
    try:
        return how(spec)
    except Exception as error:
        text = f"failed: {type(error).__name__}: {error}"
        return told(spec, ()) | {"verdict": text, "names": [], "seconds": 0.0, "failed": True}


def told(spec: Spec, drawn: Sequence[tuple[Kind, float, Array]]) -> dict[str, Any]:
    """The part of a row that says what was hidden: sizes, non-centralities, and those beside each other."""
    beside = seen_beside([z for _, _, z in drawn])
    return {
        "key": spec.key, "rule": rule(), "commit": commit(), "group": spec.group, "protocol": spec.protocol,
        "kinds": list(spec.kinds), "physics": [EVERY[name].physics for name in spec.kinds],
        "laws": [EVERY[name].law for name in spec.kinds], "wanted": spec.sigmas,
        "without": list(spec.without), "hidden_mechanisms": mechanisms(spec),
        "hidden": [
            {"name": k.name, "size": size, "sigmas": float(np.linalg.norm(z)), "beside": left}
            for (k, size, z), left in zip(drawn, beside, strict=True)
        ],
    }  # fmt: skip


def mechanisms(spec: Spec) -> list[str]:
    """The mechanisms of what is hidden, where they are stated."""
    of = {e.name: e.mechanism for e in all_effects()}
    found = [of.get(EVERY[name].physics, EVERY[name].mechanism) for name in spec.kinds]
    return [str(m) for m in found if m is not None]


@lru_cache(maxsize=1)
def commit() -> str:
    """The last commit of the code that decides, with a plus where files have changed since; "" outside of a
    repository."""
    last = run_git("log", "-1", "--abbrev=8", "--format=%h", "--", *RULE)
    return last + "+" * bool(run_git("status", "--porcelain", *RULE))


def run_git(*words: str) -> str:
    """What git says of this repository; "" where it cannot."""
    found = subprocess.run(("git", "-C", str(ROOT), *words), capture_output=True, text=True, check=False)
    return found.stdout.strip()


@lru_cache(maxsize=1)
def rule() -> str:
    """A word that changes with the code that decides, but not with its docstrings: rows of one rule alone
    belong in one table."""
    found = hashlib.sha256()
    for path in (path for package in RULE for path in sorted((ROOT / package).rglob("*.py"))):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list) and body and _is_text(body[0]):
                body[0] = ast.Pass()
        found.update(ast.dump(tree).encode())
    return found.hexdigest()[:12]


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def floor(scene: Scene) -> float | None:
    """The error (mm) in the recording held out where nothing is hidden, everything else being drawn alike."""
    targets = scene.targets(())
    return heldout(judge(scene.model(targets), targets, starts=START), scene, ())


def worth(said: Any, scene: Scene, hidden: tuple[tuple[Kind, float], ...]) -> dict[str, Any]:
    """What a diagnosis says and how good it is."""
    plain = files.plain(DiagnosisRecord.of(said))
    noise = plain.get("noise_sd_mm")
    found = {
        "verdict": plain["verdict"], "sentence": plain["sentence"], "named": plain["named"], "law":
        plain["law"], "ties": plain["ties"], "classes": [c["members"] for c in plain.get("classes") or []],
        "rms_over_sd": plain["rms_after_mm"] / noise if noise and plain["rms_after_mm"] else None,
        "adequate": plain["adequate"], "names": in_verdict(plain), "grade": plain["grade"],
        "nearest": plain["nearest"], "mechanisms": plain["mechanisms"], "foretold": dict(said.foretold),
    }  # fmt: skip
    judged = judged_of(said)
    if judged is None:
        return found
    tied = [h.refit for h in said.tied[1:] if said.ties and not h.kind and h.refit is not None]
    told = not any(refit.comparison.doubt for refit in tied)  # else a tie has no intervals
    inside = coverage([judged.fit, *(refit.fit for refit in tied)], hidden) if told else {}
    found |= {"inside": inside, "heldout": heldout(judged, scene, hidden)}
    if scene.protocol.held_out is not None:
        found["base_heldout"] = heldout(said.base, scene, hidden)
    return found


def in_verdict(plain: Mapping[str, Any]) -> list[str]:
    """The effects that a verdict names: those of `A or B`, `A + B`, `A`."""
    tied = [name for tie in plain["ties"] for name in tie]
    return list(dict.fromkeys([*plain["named"], *tied]))


def judged_of(said: Any) -> Any:
    """The kept refit, or the base's."""
    kept = said.kept
    return getattr(kept, "refit", None) or kept or said.base


def coverage(fits: Sequence[Fit], hidden: Sequence[tuple[Kind, float]]) -> dict[str, bool]:
    """Whether 95 % intervals hold the truth: of the sum of the constants, the share, and the size of an
    effect whose law is the library's. fits: of what a verdict names; of a tie the union over all is asked."""
    every = [spans(fit, hidden) for fit in fits]
    out = {}
    for key in ("sum", "share", "size"):
        rows = [row[key] for row in every if key in row]
        if rows and (key == "size" or len(rows) == len(every)):
            out[key] = min(low for low, _ in rows) <= 0.0 <= max(high for _, high in rows)
    return out


def spans(fit: Fit, hidden: Sequence[tuple[Kind, float]]) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of a fit, less the truth; of a constant at its bound none."""
    theta = {p.name: float(x) for p, x in zip(fit.parameters, fit.theta, strict=True)}
    names = list(theta)
    if not {"C10", "C01"} <= set(names) or {"C10", "C01"} & set(fit.at_bound):
        return {}
    if not np.isfinite(fit.covariance).all():
        return {}
    total = theta["C10"] + theta["C01"]
    by_share = -theta["C01"] / total**2, theta["C10"] / total**2
    slopes = {"sum": {"C10": 1.0, "C01": 1.0}, "share": dict(zip(("C10", "C01"), by_share, strict=True))}
    errors = {"sum": total - MAIN.scale, "share": theta["C01"] / total - MAIN.shape[0]}
    for kind, size in hidden:
        if kind.law == "same" and kind.amplitude in names and kind.amplitude not in fit.at_bound:
            slopes["size"], errors["size"] = {kind.amplitude: 1.0}, theta[kind.amplitude] - size
    out = {}
    for key, by in slopes.items():
        g = np.array([by.get(name, 0.0) for name in names])
        half = 1.96 * float(np.sqrt(g @ fit.covariance @ g))
        out[key] = (errors[key] - half, errors[key] + half)
    return out


def heldout(judged: Any, scene: Scene, hidden: tuple[tuple[Kind, float], ...]) -> float | None:
    """Root mean square (mm) by which the kept fit misses the true motion in the recording held out, x and
    z."""
    held = scene.protocol.held_out
    if held is None:
        return None
    true = scene.true(hidden)
    reference = judged.model.reference
    true = (true - true[reference].mean(axis=0))[scene.protocol.block == held]
    told = judged.model.predict(judged.fit.theta)[scene.protocol.block == held][:, : true.shape[1]]
    return float(np.sqrt(((told - true)[:, : len(scene.rows), ::2] ** 2).mean()))
