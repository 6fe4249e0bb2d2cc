"""A short finger on a coarse mesh, and targets of it, that the tests of twin share."""

import base64
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Finger, Lattice, solve
from tests.messages import Lines
from tests.strangers import studio
from tests.twin.solvedonce import SolvedOnce
from twin.executors.local import Serial, using
from twin.model import discretisation, fingertable, prediction
from twin.model.structure import BuiltIn, base_case
from twin.targets import Noise, PointKind, TargetPoint, Targets, at_node
from twin.virtual import truthsolves

SHORT = Finger(
    length=10 + 100 / 3, bellows=3, tip_node=(10 + 100 / 3, 11.5, 0.0), middle_node=(4 + 50 / 3, 11.5, 0.0)
)
COARSE = Lattice(per_bellow=2, ring=False, centred=False)
ONCE = SolvedOnce(solve)
TABLE = Path(__file__).with_name("shortfinger.npz")


@pytest.fixture(scope="session", autouse=True)
def known_finger() -> None:
    """The short finger has a table of load paths and finer meshes, as the fingers of the demos have."""
    fingertable.FILES["short"] = str(TABLE)


@pytest.fixture(scope="session")
def short() -> Finger:
    """Three of the nine bellows: 1300 nodes where the whole finger has 4700."""
    return SHORT


@pytest.fixture(scope="session")
def short_builtin() -> BuiltIn:
    """The short finger on its coarse mesh, as a project takes it: `Project.open(folder, builtin=...)`."""
    return BuiltIn(SHORT, COARSE)


@pytest.fixture(scope="session")
def short_case() -> Case:
    return base_case(finger=SHORT, lattice=COARSE)


@pytest.fixture(scope="session")
def coarsest_case() -> Case:
    """The short finger with one cell a bellow: where a contract asks for no accuracy of the mesh."""
    return base_case(finger=SHORT, lattice=Lattice(per_bellow=1, ring=False, centred=False))


@pytest.fixture(scope="session", autouse=True)
def one_process() -> Iterator[None]:
    """All work in this process: on a finger so small, starting others costs more than they save."""
    with using(Serial()):
        yield


@pytest.fixture(scope="module")
def solved_once() -> Iterator[None]:
    """For files that ask the same of the solver again and again: an earlier test's answer is taken."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (prediction, discretisation, truthsolves):
            patch.setattr(module, "solve", ONCE)
        yield


@pytest.fixture(scope="session")
def studio_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small drawn project that is right, to be copied."""
    return studio.make(tmp_path_factory.mktemp("studio") / "right")


def page_text(path: Path) -> str:
    """What a page says, its drawings included."""
    page = path.read_text(encoding="utf-8")
    drawings = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", page)
    return "\n".join([page, *(base64.b64decode(text).decode() for text in drawings)])


@pytest.fixture(scope="module")
def say() -> Lines:
    """What a stage says, kept in `say.lines`."""
    return Lines()


def plain_targets(**changes: object) -> Targets:
    """Targets of the tip, the middle and a fixed marker over 8 steps of a ramp, a hold and a release."""
    time = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 6.0, 7.0, 9.0])
    log_time = np.linspace(0.0, 9.0, 181)
    log_pressure = 0.02 * np.interp(log_time, [0.0, 0.5, 2.0, 6.0, 7.0, 9.0], [0.0, 0.0, 1.0, 1.0, 0.2, 0.2])
    s, p = len(time), 3
    covariance = np.tile(1e-4 * np.eye(3), (s, p, 1, 1))
    given: dict[str, object] = {
        "time": time, "pressure": np.interp(time, log_time, log_pressure), "block": np.zeros(s, np.int64),
        "points": (
            at_node("tip", 4401), at_node("middle", 5848),
            TargetPoint("fixed", PointKind.FIXED, None, (20.0, 11.5, 30.0)),
        ), "value": np.zeros((s, p, 3)),
        "covariance": covariance, "valid": np.ones((s, p, 3), bool), "held_out": np.zeros(s, bool),
        "modes": np.zeros((0, s, p, 3)), "mode_names": (), "noise": None, "log_time": log_time,
        "log_pressure": log_pressure, "reference": np.array([0, 1]), "gravity": None,
        "pressure_sd": np.zeros(s),
    }  # fmt: skip
    return Targets(**{**given, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def make_targets() -> Callable[..., Targets]:
    """`make_targets(**changes)`: small targets of the short finger, with what is changed."""
    return plain_targets


def perfect_noise(points: int, *, sd: float, rho: float, common: float, frames: int = 10**8) -> Noise:
    """A noise model as if from `frames` static frames: one sd and rho, axes correlated between markers."""
    correlation = np.eye(3 * points)
    for i in range(3 * points):
        for k in range(3 * points):
            if i != k and i % 3 == k % 3:
                correlation[i, k] = common
    full = np.full((points, 3), 1.0)
    return Noise(
        sd=sd * full, rho=rho * full, correlation=correlation, frames=frames, codec_sd=0.0 * full,
        gauge_sd_MPa=0.0, gauge_frames=0,
    )  # fmt: skip


@pytest.fixture(scope="session")
def make_noise() -> Callable[..., Noise]:
    """`make_noise(points, sd=, rho=, common=, frames=)`."""
    return perfect_noise
