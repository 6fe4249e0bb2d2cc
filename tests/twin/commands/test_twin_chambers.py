"""A deck of two chambers, each filled in a film of its own: fitted by both, predicted with both filled.

The truth has other elements on another mesh; what is planted is the silicone alone.
"""

import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from benchmarks.kernel.smalldecks import RUBBER, lattice, rest, root

import numpy as np
import pytest

from fe import Case, solve
from fe import Path as Course
from fe.deck.reader import read_deck
from tests.messages import Lines
from tests.twin.conftest import plain_targets
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.export import run_export
from twin.commands.init import run_init
from twin.commands.predict import run_predict
from twin.commands.predictchambers import filling_notes
from twin.model.discretisation import meshes_key
from twin.model.keptmodel import base_model, base_test
from twin.model.structure import Structure, skin
from twin.project.folder import Project
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import Array, Noise, PointKind, TargetPoint, Targets

LINES = ((-5.0, -4.0, -1.0, 1.0, 4.0, 5.0), (0.0, 1.0, 4.0, 5.0))  # y, z, mm
FINER = ((-5.0, -4.0, -2.5, -1.0, 1.0, 2.5, 4.0, 5.0), (0.0, 1.0, 2.5, 4.0, 5.0))
LENGTH, TOP, SD, TRUTH = 60.0, 0.05, 0.01, 0.15  # mm, MPa, mm, MPa
SHARES = {"left": np.array([1.0, 0.0, 0.5]), "right": np.array([0.0, 1.0, 1.0])}
PLACES = {"tip": (LENGTH, 0.0, 5.0), "left": (LENGTH, -5.0, 2.5), "middle": (30.0, 0.0, 5.0)}
RISE = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 0.0])  # of a film's pressures


def deck(kind: str, cells: int, lines: tuple[tuple[float, ...], ...]) -> str:
    """A bar of 60 x 10 x 5 mm with two chambers side by side, held at x = 0."""
    x = (0.0, *np.linspace(2.0, LENGTH - 2.0, cells - 1).tolist(), LENGTH)
    middles = [(a + b) / 2 for a, b in pairwise(lines[0])]
    void = {
        (i, j, k) for i in range(1, cells - 1) for j, y in enumerate(middles) if 1 < abs(y) < 4
        for k in range(1, len(lines[1]) - 2)
    }  # fmt: skip
    mesh = lattice(kind, lines=(x, *lines), void=void)
    text = f"{mesh.text}\n*NSET, NSET=ROOT\n{mesh.where(root)}\n"
    for name, side in (("LEFT", -1), ("RIGHT", 1)):
        def inside(corners: list[list[float]], side: int = side) -> bool:
            return all(1 <= side * y <= 4 and 1 <= z <= 4 and x[1] <= a <= x[-2] for a, y, z in corners)

        text += f"*SURFACE, NAME={name}, TYPE=ELEMENT\n{mesh.faces(inside)}\n"
    return text + rest(RUBBER, load=f"*DSLOAD\nLEFT, P, {TOP}\nRIGHT, P, {TOP}")


def own(folder: Path, *made: object) -> Case:
    (folder / "d.inp").write_text(deck(*made))  # type: ignore[arg-type]
    return read_deck(folder / "d.inp").case.with_material(C10=0.75 * TRUTH, C01=0.25 * TRUTH)


def film(block: int, case: Case) -> Array:
    """How the places (s, p, 3) mm move in one film, the case being filled by the film's shares alone."""
    carried = {name: float(shares[block]) for name, shares in SHARES.items()}
    time = np.arange(float(len(RISE)))
    path = Course(time, TOP * RISE, time)
    return solve(replace(case, shares=carried), path).at(np.array(list(PLACES.values())))


def measured(folder: Path) -> Targets:
    """Three films, the last of which is held out, without what the truth is made of."""
    truth = own(folder, "C3D10", 9, FINER)
    u = np.concatenate([film(b, truth) for b in range(3)])
    u = np.concatenate([u, np.zeros((len(u), 1, 3))], axis=1)
    points = (*(TargetPoint(n, PointKind.PLACE, None, x) for n, x in PLACES.items()),
              TargetPoint("fixed", PointKind.FIXED, None, (0.0, 0.0, 30.0)))  # fmt: skip
    time, block = np.arange(float(len(u))), np.repeat([0, 1, 2], len(RISE))
    told = Noise(sd=np.full((4, 3), SD), rho=np.zeros((4, 3)), correlation=np.eye(12), frames=300,
                 codec_sd=np.zeros((4, 3)), gauge_sd_MPa=0.0, gauge_frames=300)  # fmt: skip
    return plain_targets(
        time=time, pressure=np.tile(TOP * RISE, 3), log_time=time, log_pressure=np.tile(TOP * RISE, 3),
        value=u + np.random.default_rng(4).normal(0.0, SD, u.shape), block=block, held_out=block == 2,
        points=points, valid=np.ones(u.shape, bool), covariance=np.tile(SD**2 * np.eye(3), (*u.shape[:2], 1, 1)),
        modes=np.zeros((0, *u.shape)), reference=np.array([0]), pressure_sd=np.zeros(len(u)), shares=SHARES,
        noise=told,
    )  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    root = tmp_path_factory.mktemp("chambers")
    write_targets(root / "t", measured(root))
    (root / "two.inp").write_text(deck("C3D20RH", 8, LINES))
    run_init(root / "p", Lines(), targets=root / "t", deck=root / "two.inp")
    toml = root / "p" / "twin.toml"
    text = toml.read_text().replace("population = 30", "population = 8").replace("generations = 20", "generations = 2")
    assert "objective_component = 2" in text  # it bends to the side
    toml.write_text(text)
    return Project.open(root / "p")


@pytest.mark.slow
def test_films_of_one_chamber_each_are_fitted_and_both_filled_is_predicted(
    project: Project, say: Lines
) -> None:
    found = run_calibrate(project, say)["fit"]["parameters"]
    assert found["C10"]["value"] + found["C01"]["value"] == pytest.approx(TRUTH, rel=0.1)
    run_compare(project, say)
    t = read_targets(project.targets_folder)
    rows = run_predict(project, say, pressure=["50kPa"], shares=["left=0.5", "right=1.0"])["points"]
    sideways = {row["point"]: row["u_mm"][1] for row in rows}
    held_out = t.value[np.flatnonzero(t.block == 2)[4]]
    alone = {row["point"]: row["u_mm"][1] for row in run_predict(project, say, pressure=["50kPa"])["points"]}
    assert alone["tip"] * t.value[4, 0, 1] > 0  # by default the shares of the first film
    assert sideways["tip"] == pytest.approx(held_out[0, 1], abs=0.1 * abs(held_out[0, 1]))
    assert sideways["tip"] * alone["tip"] < 0  # the fuller chamber pushes it to the other side
    run_export(project, say, form="abaqus", pressure="50kPa")
    text = next(p for p in project.root.rglob("*.inp") if "export" in str(p)).read_text()
    loads = text.partition("*DSLOAD")[2].splitlines()[1:3]
    assert [float(line.split(",")[2]) for line in loads] == [0.05, 0.0]
    assert "Its chambers carry the pressure as in the first film." in say.lines


def test_the_shares_are_kept(project: Project) -> None:
    about = tomllib.loads((project.targets_folder / "targets.toml").read_text())
    assert about["blocks"][2]["pressure_shares"] == {"left": 0.5, "right": 1.0}


@pytest.mark.parametrize(("shares", "words"), [
    (["left=1"], "wanted one for each of left, right, not all 0"),
    (["left=0", "right=0"], "not all 0"),
    (["left=1", "right=full"], "wanted SURFACE=SHARE, such as LEFT=1.0"),
    (["left=1", "top=1"], "wanted one for each of left, right"),
])  # fmt: skip
def test_shares_that_no_film_has_are_refused(project: Project, say: Lines, shares: list[str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        run_predict(project, say, pressure=["50kPa"], shares=shares)


def test_what_no_film_has_filled_is_said(project: Project) -> None:
    t = read_targets(project.targets_folder)
    assert filling_notes(t, {}, TOP) == ["The chambers carry the pressure as in the first film: left 1, right 0."]
    assert filling_notes(t, {"left": 0.5, "right": 1.0}, TOP) == []
    told = filling_notes(t, {"left": 2.0, "right": 1.0}, TOP)
    assert told[0].startswith("left is filled to 100 kPa, in the films to 50 kPa at most")
    assert told[1:] == ["No film has filled the chambers so: left 2, right 1."]


def test_a_surface_without_pressure_is_named(project: Project, tmp_path: Path) -> None:
    t = replace(read_targets(project.targets_folder), shares={"upper": np.ones(3)})
    case = own(tmp_path, "C3D20RH", 8, LINES)
    with pytest.raises(ValueError, match="no pressure on a surface 'upper'; wanted left, right"):
        base_model(t, case)


def test_films_must_name_the_same_surfaces(project: Project) -> None:
    path = project.targets_folder / "targets.toml"
    text = path.read_text()
    for changed, words in (
        (text.replace("left = 0.5\nright = 1.0\n", "left = 0.5\n"), "block 2: pressure_shares names left, that of block 0 left, right"),
        (text.replace("left = 0.5\nright = 1.0\n", "left = 0.0\nright = 0.0\n"), "block 2: pressure_shares is 0.0 throughout"),
    ):
        path.write_text(changed)
        with pytest.raises(ValueError, match=words):
            read_targets(project.targets_folder)
    path.write_text(text)
    assert read_targets(project.targets_folder).shares["right"].tolist() == [0.0, 1.0, 1.0]


def test_chambers_that_change_places_have_other_finer_meshes(project: Project, tmp_path: Path) -> None:
    t, case = read_targets(project.targets_folder), own(tmp_path, "C3D20RH", 8, LINES)
    swapped = replace(t, shares={"right": t.shares["left"], "left": t.shares["right"]})
    structure = Structure(case, "deck", {}, skin(case))
    assert meshes_key(base_test(t, case), structure) != meshes_key(base_test(swapped, case), structure)
