"""Dimensions that twin.toml leaves open are fitted from their priors, with the constants."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Lattice
from fe import Path as Course
from fe.mesh.mirror import mirrored
from tests.messages import Lines, saying
from tests.twin.conftest import COARSE, SHORT
from twin import files
from twin.bench.fits import fit_file
from twin.bench.priors import known_values
from twin.bench.workbench import body_of, open_dimensions, own_of, tolerances_of
from twin.bodies.finger import BuiltIn
from twin.commands.calibrate import run_calibrate
from twin.commands.check import _check_effects
from twin.commands.compare import run_compare
from twin.commands.drop import _drop
from twin.commands.predict import run_predict
from twin.effects.opendimensions import OpenDimensions
from twin.effects.protocol import Test, Unsolvable
from twin.judging.fitrecord import FitRecord
from twin.judging.fitting import fit_model, whitener_of
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.marktables import PointTable
from twin.model.keptmodel import base_model
from twin.model.structure import body_case
from twin.project.config import BODIES, CalibrateTable, Config, ModelTable, ProjectTable
from twin.project.folder import Project, dataset
from twin.project.targetfiles import write_targets
from twin.project.toml import dump, parse
from twin.targets import KnownValue, Noise, PointKind, TargetPoint, Targets

BODY = BuiltIn(SHORT, COARSE)
NAME, SD, NOISE = "top_wall_mm", 0.3, 0.03  # mm
PLACES = {name: BODY.places[name] for name in ("tip", "p3", "off4")}
C10, C01 = 0.214, 0.083


def project(table: str, model: str = "") -> Project:
    """The study on the coarse short finger, with open dimensions, and another line of [model]."""
    text = (dataset("study") / "twin.toml").read_text()
    for line in filter(None, (f"open = {{{table}}}", model)):
        text = re.sub(rf"^(# )?{line.partition(' =')[0]} = .*$", line, text, count=1, flags=re.M)
    config = parse(text.encode(), name="twin.toml")
    return replace(Project.open(dataset("study"), builtin=BODY), config=config)


def filmed(make_targets: Callable[..., Targets], noise: Noise) -> Targets:
    """Targets of a finger on another mesh whose top wall is an sd thicker than stated."""
    points = tuple(TargetPoint(n, PointKind.PLACE, None, x) for n, x in PLACES.items())
    plain = make_targets(points=points, noise=noise, covariance=np.tile(NOISE**2 * np.eye(3), (8, 3, 1, 1)))
    other = Lattice(per_bellow=2, ring=True, centred=False)
    truth = base_model(plain, body_case(BODY.larger(NAME, SD), other))
    u = truth.predict(np.array([C10, C01]))
    value = u + NOISE * np.random.default_rng(2).standard_normal(u.shape)
    return replace(plain, value=value - value[plain.reference].mean(axis=0))


def test_a_dimension_that_is_off_is_found_and_constants_are_right_with_it(
    make_targets: Callable[..., Targets], make_noise: Callable[..., Noise]
) -> None:
    t = filmed(make_targets, make_noise(3, sd=NOISE, rho=0.0, common=0.0))
    effect = open_dimensions(project(f"{NAME} = [{BODY.size(NAME)}, {SD}]"))
    start, case = np.array([0.2, 0.1]), body_case(BODY, BODY.lattice)
    plain = base_model(t, case)
    w = whitener_of(plain, start, t)
    shut = fit_model(plain, t, w, start=start)
    known = (KnownValue(name=f"open_dimensions.{NAME}", mean=0.0, sd=SD),)
    opened = plain.with_effect(effect)
    found = fit_model(opened, replace(t, known=known), w, start=np.append(shut.theta, 0.0))
    mm, sd = found.theta[-1], found.sd[-1]
    assert abs(mm - SD) < 2 * sd < 0.9 * SD  # 0.17 +- 0.10: the prior has 0 +- 0.3
    assert found.theta[:2].sum() == pytest.approx(C10 + C01, rel=0.06)
    assert shut.theta[:2].sum() > 1.1 * (C10 + C01)  # 12 % off, with it 5 %


def test_an_open_dimension_stands_at_its_value_and_has_its_prior_in_place_of_a_tolerance() -> None:
    found = project(f"{NAME} = [2.2, {SD}]")
    body = body_of(found)
    assert isinstance(body, BuiltIn)
    assert body.size(NAME) == 2.2
    assert found.config.model.dimensions.top_wall_mm == 2.2  # type: ignore[union-attr]
    assert found.config.model.effects == ("open_dimensions",)
    assert tolerances_of(found, body)[NAME] == 0.0
    _check_effects(found)  # a contract is tried on a finger of its own, whose mesh does not move so
    (prior,) = known_values(found, MOONEY_RIVLIN, own_of)
    assert (prior.name, prior.mean, prior.sd) == (f"open_dimensions.{NAME}", 0.0, SD)
    with pytest.raises(ValueError, match=saying("open_dimensions", r"\[model.open\]", "remove that table")):
        _drop(found, Lines(), "open_dimensions")


@pytest.mark.parametrize(("table", "before", "said"), [
    ("wall_mm = [2.0, 0.3]", "", "model.open.wall_mm is no dimension of the chamber of a finger; wanted some of .*top_wall_mm"),
    (f"{NAME} = [2.0, 0.0]", "", f"model.open.{NAME}.*(greater than|above) 0"),
    (f"{NAME} = [2.0, 0.3]", 'deck = "raw/arm.inp"', f"model.open.{NAME}: a deck's mesh moves with no dimension.*make decks of two"),
    (f"{NAME} = [2.0, 0.3]", 'engine = "calculix"', f"model.open.{NAME} with engine = 'calculix'.*remove"),
    ("", 'effects = ["open_dimensions"]', r"open_dimensions without \[model.open\]; wanted"),
])  # fmt: skip
def test_what_cannot_be_open_is_refused(table: str, before: str, said: str) -> None:
    with pytest.raises(ValueError, match=f"(?s){said}"):
        project(table, before)


def test_a_dimension_moves_nodes_as_another_mesh_has_them_and_not_through_each_other() -> None:
    effect = open_dimensions(project(f"{NAME} = [{BODY.size(NAME)}, {SD}]"))
    case = body_case(BODY, BODY.lattice)
    test = Test(case, Course(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0])), np.zeros((0, 3)), np.zeros(0, bool))
    same = effect.before(test, {f"open_dimensions.{NAME}": 0.0})
    assert same is test
    moved = effect.before(test, {f"open_dimensions.{NAME}": 0.2}).case.nodes
    np.testing.assert_allclose(moved, body_case(BODY.larger(NAME, 0.2), BODY.lattice).nodes, atol=0.01)
    whole = replace(test, case=mirrored(case))
    assert np.abs(effect.before(whole, {f"open_dimensions.{NAME}": 0.2}).case.nodes - whole.case.nodes).max() > 0.1
    thick = OpenDimensions({NAME: (30 * effect.moves[NAME][0], None)}, {NAME: SD})
    with pytest.raises(Unsolvable, match=saying(f"{NAME} is 0.9 mm larger than stated", "wanted 0.05")):
        thick.before(test, {f"open_dimensions.{NAME}": 0.9})


@pytest.mark.parametrize(("kind", "name", "within"), [
    (kind, name, 0.1 if kind == "finger" else 1e-9)  # mm: pleats and round edges are not linear in a wall
    for kind, table in BODIES.items() for name in table().body.inner
])  # fmt: skip
def test_each_dimension_of_each_body_moves_nodes_as_its_mesh_has_them(kind: str, name: str, within: float) -> None:
    body = BODIES[kind]().body
    case, pair = body_case(body, body.lattice), [body_case(body.larger(name, mm), body.lattice) for mm in (-0.075, 0.075)]
    half, _ = OpenDimensions.of(case, {name: (pair[0], pair[1])}, {name: SD}).moves[name]
    other = body_case(body.larger(name, SD), body.lattice)
    np.testing.assert_allclose(case.nodes + SD * half, other.nodes, atol=within)
    assert np.abs(half).max() > 0.4  # mm per mm


@pytest.mark.slow
def test_stages_fit_and_predict_with_an_open_dimension(
    tmp_path: Path, make_targets: Callable[..., Targets], make_noise: Callable[..., Noise]
) -> None:
    t, say = filmed(make_targets, make_noise(3, sd=NOISE, rho=0.0, common=0.0)), Lines()
    model = ModelTable.model_validate({"open": {NAME: (BODY.size(NAME), SD)}})
    points = tuple(PointTable(name=n, position_mm=x) for n, x in PLACES.items())
    calibrate = CalibrateTable(population=8, generations=4, objective_points=("tip", "p3"))
    config = Config(project=ProjectTable(name="open"), model=model, points=points, calibrate=calibrate)
    (tmp_path / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(tmp_path / "targets", t)
    found = Project.open(tmp_path, builtin=BODY)
    run_calibrate(found, say)
    fit = files.read(FitRecord, fit_file(found))
    mm = fit.parameters[f"open_dimensions.{NAME}"]
    assert abs(mm.value - SD) < 2.5 * mm.sd  # the error of the mesh may be the same
    assert mm.sd < 0.9 * SD
    run_compare(found, say)
    (tip,) = run_predict(found, say, pressure=("20kPa",), at=("tip",))["points"]
    assert tip["u_mm"][2] == pytest.approx(t.value[4, 0, 2], abs=0.15)
