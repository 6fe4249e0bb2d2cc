"""A film and tests of its silicone in one fit: calibrate and what follows, on a short finger."""

from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Lattice, Material
from fe.homogeneous import nominal_stress
from tests.messages import says
from tests.twin.commands.test_twin_chain import NAMES, Silent, X
from twin import files, virtual
from twin.bench.fits import fit_file, stale
from twin.bench.workbench import BEYOND, Workbench
from twin.calibrated.profiles import sd_of
from twin.commands.calibrate import run_calibrate
from twin.commands.check import run_check
from twin.coupons.testtable import MaterialTestTable
from twin.judging.fitrecord import FitRecord, MaterialTestsRow
from twin.marktables import PointTable
from twin.model.structure import BuiltIn
from twin.project.config import CalibrateTable, Config, ProjectTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump

FILM = ((0.0, 0.0), (2.0, 0.0), (5.0, 30.0), (7.0, 30.0))
BENCH = virtual.Bench(film_hz=3.5, gauge_sd_MPa=3e-4, sd=0.005)
RUBBER = Material(C10=0.214, C01=0.083)
STRAIN = np.linspace(0.0, 1.2, 241)
TENSION = MaterialTestTable(
    name="tension", file="raw/tension.csv", kind="uniaxial", sd_MPa=0.002, sd_percent=0.5, scale_percent=1.0
)


def tension(material: Material, *, scale: float = 1.0, seed: int = 7) -> str:
    """A file as a tester writes it: lines above the header, decimal commas, percent, and kPa; and unloading."""
    noise = 0.001 * np.random.default_rng(seed).standard_normal(len(STRAIN))
    stress = scale * nominal_stress(material, STRAIN, "uniaxial") + noise
    rows = [*zip(STRAIN, stress), *zip(STRAIN[::-2], 0.9 * stress[::-2])]
    body = "\n".join(f"{k / 10:.1f};{100 * x:.3f};{1e3 * y:.4f}".replace(".", ",") for k, (x, y) in enumerate(rows))
    return f"Prüfer;M. Muster\nGeschwindigkeit (mm/min);450\n\nZeit;Dehnung;Standardspannung\n[s];[%];[kPa]\n{body}\n"


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, short_case: Case, short_builtin: BuiltIn) -> Project:
    """A project with the film of a finger that nothing is hidden in, made on another mesh."""
    folder = tmp_path_factory.mktemp("joint") / "batch"
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    points, course = short_case.nodes[rows], virtual.path(BENCH, protocol=FILM)
    truth = virtual.truth_case(short_builtin.finger, Lattice(per_bellow=2, centred=False), material=RUBBER, element=None)
    u, slope = virtual.displaced(truth, course, points)
    where = virtual.at_nodes(NAMES, short_case.labels[rows], points)
    config = Config(
        project=ProjectTable(name="joint"),
        points=tuple(PointTable(name=n, node=int(k)) for n, k in zip(NAMES, short_case.labels[rows])),
        calibrate=CalibrateTable(population=6, generations=2),
    )
    (folder / "raw").mkdir(parents=True)
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", virtual.noisy_targets(u, slope, course, points=where, bench=BENCH, seed=1))
    return Project.open(folder, builtin=short_builtin)


def with_tests(project: Project, text: str, *tables: MaterialTestTable) -> Project:
    """The project with a tension test of this text and with these tables."""
    (project.root / "raw/tension.csv").write_text(text, encoding="utf-8")
    config = project.config.model_copy(update={"material_tests": tables})
    (project.root / "twin.toml").write_text(dump(config), encoding="utf-8")
    return Project.open(project.root, builtin=project.builtin)


def fitted(project: Project) -> FitRecord:
    return files.read(FitRecord, fit_file(project))


@pytest.fixture(scope="module")
def alone(film: Project) -> FitRecord:
    """The fit of the film alone."""
    run_calibrate(film, Silent())
    return fitted(film)


@pytest.fixture(scope="module")
def joint(film: Project, alone: FitRecord) -> tuple[Project, Silent]:
    """The project with a tension test, calibrated anew."""
    project, say = with_tests(film, tension(RUBBER), TENSION), Silent()
    run_check(project, say)
    run_calibrate(project, say)
    return project, say


def found(record: FitRecord) -> MaterialTestsRow:
    assert record.material_tests is not None
    return record.material_tests


def test_a_tension_test_parts_the_constants(joint: tuple[Project, Silent], alone: FitRecord) -> None:
    project, _ = joint
    both = fitted(project)
    for name, true in (("C10", 0.214), ("C01", 0.083)):
        row = both.parameters[name]
        assert abs(row.value - true) < 3 * row.sd
    assert sd_of(both.fit, "share") < 0.5 * sd_of(alone.fit, "share")
    assert both.adequate
    row = found(both).tests[0]
    assert (row.name, row.kind, row.count, row.recorded) == ("tension", "uniaxial", 20, 362)
    assert row.chi2 < 45  # 20 values; 1e-3 of right curves are above
    assert abs(row.shared_sd["scale"]) < 3
    # whoever holds a constant, all data together hold as many as are fitted
    assert found(both).film_decides + row.decides == pytest.approx(2.0, abs=1e-6)
    np.testing.assert_allclose(row.fitted_MPa, row.stress_MPa, atol=0.006)


def test_the_curve_is_used_as_far_as_the_finger_is_stretched(joint: tuple[Project, Silent]) -> None:
    project, _ = joint
    tests = found(fitted(project))
    assert tests.finger_stretch is not None
    assert 1.2 < tests.finger_stretch < 1.6
    assert tests.tests[0].up_to == pytest.approx(BEYOND * tests.finger_stretch, abs=0.02)  # a row every 0.005
    assert tests.tests[0].left_out > 50
    bench = Workbench.of(project)  # whoever goes on from the fit takes the same values
    assert bench.targets.curves[0].strain.tolist() == list(tests.tests[0].strain)
    assert bench.of_film.targets.curves == ()


def test_what_was_fitted_is_said_and_drawn(joint: tuple[Project, Silent]) -> None:
    project, say = joint
    text = "\n".join(say.lines)
    says(text, "241", "362", "raw/tension.csv", "120 %")
    assert "121 of 362 rows, those of unloading, are left out" in text
    assert "rows beyond are left out" in text
    assert "Film and material tests (tension) agree within their errors." in text
    assert fit_file(project).with_name("material-tests.png").read_bytes().startswith(b"\x89PNG")


def test_a_fit_is_stale_where_its_tests_have_changed(joint: tuple[Project, Silent]) -> None:
    project, _ = joint
    folder, file = fit_file(project).parent, project.root / "raw/tension.csv"
    assert stale(project, folder) == []
    kept = file.read_text(encoding="utf-8")
    try:
        file.write_text(kept + "\n", encoding="utf-8")
        assert stale(project, folder) == ["raw/tension.csv has changed since"]
    finally:
        file.write_text(kept, encoding="utf-8")
    other = TENSION.model_copy(update={"scale_percent": 5.0})
    looser = replace(project, config=project.config.model_copy(update={"material_tests": (other,)}))
    assert stale(looser, folder) == ["[[material_tests]] of twin.toml has changed since"]
    bare = replace(project, config=project.config.model_copy(update={"material_tests": ()}))
    assert stale(bare, folder) == ["[[material_tests]] of twin.toml has changed since"]


def test_a_specimen_of_another_silicone_contradicts_the_film(film: Project, joint: object) -> None:
    project, say = with_tests(film, tension(RUBBER, scale=3.0), TENSION), Silent()
    run_calibrate(project, say)
    record = fitted(project)
    tests = found(record)
    assert tests.p_value is not None
    assert tests.p_value < 1e-3
    assert tests.law_p_value is not None
    assert tests.law_p_value > 1e-3  # the curve alone is one of Mooney-Rivlin rubber
    assert tests.tests_shear_MPa == pytest.approx(3 * RUBBER.shear, rel=0.05)
    assert not record.adequate
    assert all(e.low is None and "contradict each other" in e.note for e in record.estimates.values())
    assert any("contradict each other. The film alone asks for a shear modulus of" in line for line in say.lines)
