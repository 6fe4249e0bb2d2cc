"""A finger that was weighed: the table of the genetic algorithm, the mesh's modes and the whole chain under weight."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material, Path, finger_case, solve
from tests.messages import saying
from tests.twin.model import meshtruths
from twin import virtual
from twin.bench.workbench import Workbench
from twin.commands.calibrate import run_calibrate
from twin.commands.check import run_check
from twin.commands.compare import run_compare
from twin.gravity import G, ways
from twin.laws.law import Shape
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, mooney_rivlin
from twin.marktables import PointTable
from twin.messages import Say
from twin.model import discretisation as mesh_error
from twin.model import loadpaths
from twin.model.arraycache import no_cache
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.keptmodel import base_model, base_test
from twin.model.loadpaths import Turned, sheets
from twin.model.structure import BuiltIn, of_finger, weighed
from twin.project.config import CalibrateTable, Config, ModelTable, ProjectTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump
from twin.review.states import Generations
from twin.targets import Array, Targets

COARSE = Lattice(per_bellow=2, ring=False, centred=False)
DENSITY = 8 * 1.07e-9  # tonne/mm3: the short finger sags by as large a share as the long one does
TRUTH = Lattice(per_bellow=4, wall=2, across=2, up=2, centred=False)
THETA = np.array([0.214, 0.083])  # MPa
DOWN = np.array([0.0, 0.0, -1.0])
BENCH = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-4, sd=0.002)
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 25.0), (6.0, 25.0), (8.0, 0.0), (10.0, 0.0), (12.0, 25.0), (14.0, 0.0))
SECOND = 9.0  # s: from then on in another orientation


def three_nodes(shape: Shape, *, wide: bool) -> Array:
    """Few of the values at which load paths are solved."""
    low, high = shape.ends(wide=wide)
    return low + (high - low) * np.array([0.067, 0.5, 0.933])


def turned(targets: Targets, *gravity: Array) -> Targets:
    """The targets in one recording for each gravity, the second from SECOND on."""
    block = (targets.time > SECOND).astype(np.int64) * (len(gravity) > 1)
    return replace(targets, block=block, gravity=np.stack(gravity))


def film(finger: Finger, case: Case, density: float, *gravity: Array, lattice: Lattice = TRUTH) -> Targets:
    """Targets of a heavy finger on another, finer mesh."""
    points, nodes = meshtruths.markers(finger, case)
    course = virtual.path(BENCH, protocol=FILM)
    way = np.stack(gravity)[(course.time > SECOND).astype(int) * (len(gravity) > 1)]
    truth = finger_case(Material(*THETA, density=density), finger=finger, lattice=lattice)
    solution = solve(truth, replace(course, gravity=G * way), count=6)  # quick: leaves a micrometre or two
    assert solution.converged
    u = solution.at(points)
    names = (*(f"p{k}" for k in range(len(points) - 1)), "tip")
    seen = virtual.noisy_targets(
        u, solution.per_pressure(points), course, points=virtual.at_nodes(names, nodes, points), bench=BENCH, seed=1
    )
    return turned(meshtruths.exact(seen, u), *gravity)


@pytest.mark.slow
def test_the_table_under_weight_is_full_finite_elements(
    coarsest_case: Case, make_targets: Callable[..., Targets], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("SCALES", 4), ("LEVELS", 6)):
        monkeypatch.setattr(loadpaths, name, value)  # quick, and still within the tolerance
    monkeypatch.setattr(Shape, "nodes", three_nodes)
    heavy, where = coarsest_case.with_material(density=DENSITY), coarsest_case.position(4401)[None]
    t = make_targets(gravity=np.stack([DOWN, -DOWN]), block=np.array([0, 0, 0, 0, 1, 1, 1, 1]))
    course = base_test(t, heavy).path
    gravities, of_step = ways(heavy, course)
    assert gravities.tolist() == [[0, 0, -G], [0, 0, G]]
    assert of_step.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert not ways(coarsest_case, course)[0].any()  # nothing is heavy
    paths = Turned(
        tuple(
            sheets(heavy, where, cache=no_cache, key="k", top=0.2, scales=(0.15, 0.6), outside={"gravity": g})
            for k, g in enumerate(gravities)
        ),
        of_step,
    )
    constants, steps = MOONEY_RIVLIN.at(0.27, (0.4,)), np.array([6, 1, 3])
    case = heavy.with_material(**constants.named)
    quick = paths.predict(constants, t.pressure[steps], steps=steps)
    assert quick is not None
    for row, k in zip(quick, steps, strict=True):
        load = np.array([0.0, max(t.pressure[k], 1e-6)])
        full = solve(case, Path(load, load, load[1:], gravity=gravities[of_step[k]]), count=3)
        sag = solve(case, Path(load, load, load[:1], gravity=gravities[of_step[k]])).at(where)[0]
        assert np.abs(sag).max() > 0.5  # mm
        np.testing.assert_allclose(row, full.at(where)[0], rtol=0, atol=0.01 * np.abs(sag).max())
    assert paths.predict(constants, np.full(8, 0.21 * constants.scale)) is None


@pytest.mark.slow
def test_the_meshs_error_under_weight_is_corrected(
    short: Finger, short_case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_error, "COUNT", 4)  # quick: the base has the same levels
    density = 2e-9  # tonne/mm3
    targets = film(short, short_case, density, DOWN, -DOWN, lattice=BuiltIn().finer(COARSE)["check"])
    structure = weighed(of_finger(short, COARSE), density)
    model = base_model(targets, structure.case)
    at = SolvedAt.beside(mooney_rivlin(*THETA), float(targets.pressure.max()))
    mesh = discretisation_error(model.test, structure=structure, solved_at=at)
    row = meshtruths.judged(model.on_mesh(mesh), targets, theta=THETA)
    assert row.before_mm > 20 * BENCH.sd  # there is something to correct
    assert row.corrected_mm < 0.1 * row.before_mm
    assert row.left_sd < 0.25  # of the noise: it does not show in a test of fit
    # changes under the weight of the first orientation alone do not hold it
    wrong = replace(mesh, changes=np.repeat(mesh.changes[:, :1], 2, axis=1))
    other = meshtruths.judged(model.on_mesh(wrong), targets, theta=THETA)
    assert other.corrected_mm > 2 * row.corrected_mm


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory, short_case: Case, short: Finger, say: Say) -> Project:
    """A weighed finger in one orientation, without a noise model, after calibrate and compare."""
    targets = film(short, short_case, DENSITY, DOWN, lattice=Lattice(per_bellow=2, centred=False))
    config = Config(
        project=ProjectTable(name="weighed"),
        # gravity is a direction: its length is of no matter
        model=ModelTable(density_kg_m3=DENSITY * 1e12, gravity=(0.0, 0.0, -9.81)),
        points=tuple(
            PointTable(name=p.name, node=p.node) for p in targets.points if p.node is not None
        ),
        calibrate=CalibrateTable(
            population=8, generations=2, objective_points=("tip",), bounds={"C10": (0.1, 0.3), "C01": (0.03, 0.2)}
        ),
    )
    folder = tmp_path_factory.mktemp("weighed") / "batch"
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", replace(targets, gravity=None, noise=None))
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("SCALES", 4), ("LEVELS", 6)):
            patch.setattr(loadpaths, name, value)
        patch.setattr(mesh_error, "COUNT", 4)
        patch.setattr(Shape, "nodes", three_nodes)
        found = Project.open(folder, builtin=BuiltIn(short, COARSE))
        for run in (run_check, run_calibrate, run_compare):
            run(found, say)
        return found


def read(project: Project, kind: str, name: str) -> dict[str, object]:
    path = project.newest(kind, name)
    assert path is not None
    return dict(json.loads(path.read_text(encoding="utf-8")))


def test_a_weighed_finger_has_its_weight_in_every_prediction(project: Project) -> None:
    bench = Workbench.of(project)
    model = bench.model(())
    assert [m.density for m in model.test.case.materials.values()] == [pytest.approx(DENSITY)]
    np.testing.assert_allclose(model.test.path.outside_at(np.zeros(1)), [[0.0, 0.0, -G]])
    assert not bench.scales
    light = project.config.model.model_copy(update={"density_kg_m3": None})
    bare = Workbench.of(replace(project, config=project.config.model_copy(update={"model": light}))).model(())
    top, tip = int(bench.targets.pressure.argmax()), bench.targets.names.index("tip")
    u, none = (m.predict(THETA)[top, tip] for m in (model, bare))
    ends = np.array([0.0, 1.0])
    path = Path(ends, bench.targets.pressure[top] * ends, ends, gravity=G * DOWN)
    alone = solve(model.put(model.named(THETA)).case, path).at(model.test.points[[tip]])[:, 0]
    np.testing.assert_allclose(u, alone[1] - alone[0], atol=2e-3)  # mm: the reference has a little ripple
    assert np.abs(u - none).max() > 0.3  # mm: the sag changes with the pressure


def test_the_genetic_algorithm_knows_the_weight(project: Project) -> None:
    found = project.newest("calibrate", "generations.npz")
    assert found is not None
    history = Generations.load(found)
    tip = history.point_names.index("tip")
    # the best by the table is the best by full finite elements, to which the table is good to 0.01 mm
    error = abs(history.u_points[-1, tip, 2] - history.u_measured[tip, 2])
    assert error == pytest.approx(history.rms_mm[-1], abs=0.01)
    values = {k: v["value"] for k, v in read(project, "calibrate", "fit.json")["parameters"].items()}  # type: ignore[attr-defined]
    # the coarse mesh is stiffer than the truth's: the constants take that up
    assert values["C10"] + values["C01"] == pytest.approx(THETA.sum(), rel=0.4)


def test_what_is_wrong_with_the_weight_is_one_sentence(project: Project, tmp_path: File) -> None:
    config = project.config
    write_targets(tmp_path / "targets", project.targets())
    with pytest.raises(ValueError, match=saying("model.gravity", "targets.toml")):
        Project(tmp_path, config).targets()

    def bench(**changes: object) -> Workbench:
        return Workbench.of(replace(project, config=config.model_copy(update=changes)))

    with pytest.raises(ValueError, match=r"model.density_kg_m3 = 8560: its weight wants the direction of gravity"):
        bench(model=config.model.model_copy(update={"gravity": None}))
    with pytest.raises(ValueError, match=saying("model.fixed.density", "C10", "C01", "model.density_kg_m3")):
        bench(model=ModelTable(fixed={"density": 1e-9}))
    with pytest.raises(ValueError, match=r"gravity\n.*wanted a direction"):
        ModelTable(gravity=(0.0, 0.0, 0.0))
