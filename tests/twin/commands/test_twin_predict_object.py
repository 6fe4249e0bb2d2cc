"""`twin predict --object`: the model beside an object, the force's interval, and what is told of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.bench.workbench import Workbench
from twin.calibrated.objectforce import RISE, Touched, beside, rising
from twin.calibrated.predictions import WantedCourse
from twin.commands.predict import run_predict
from twin.commands.predictobject import contact_csv, contact_picture, contact_rows, pushed, told
from twin.effects.library import effect
from twin.effects.protocol import Unsolvable
from twin.model.objects import RigidObject
from twin.project.folder import Project, dataset

HELD = WantedCourse.held(0.02, ramp_s=2.0, hold_s=1.0)
ROD = RigidObject.of("cylinder:d=40,x=70,z=-30")


@pytest.fixture(scope="module")
def bench() -> Workbench:
    return Workbench.of(Project.open(dataset("study")))


@pytest.fixture
def met(bench: Workbench) -> Touched:
    """A force that rises from the middle of a held course on, with two errors."""
    s = RISE + 2
    force = np.outer(np.clip(np.linspace(-1.0, 1.0, s), 0.0, None), [0.3, 0.0, -0.4])
    factors = np.array([0.1 * force, [[0.0, 0.0, 0.02]] * s])
    course = rising(HELD)
    return Touched(
        time=course.output, pressure=np.interp(course.output, course.time, course.pressure), force=force,
        factors=factors, shape=np.zeros((s, *bench.case.nodes.shape)), yielded=0.0,
        beyond=np.zeros(s, bool), why="",
    )  # fmt: skip


def test_a_held_pressure_is_told_along_its_rise() -> None:
    course = rising(HELD)
    assert len(course.output) == RISE + 2
    assert (course.output[0], course.output[-2:].tolist()) == (0.0, [2.0, 3.0])
    assert rising(course) is course


def test_the_model_stands_beside_the_object_along_the_course(bench: Workbench) -> None:
    model = beside(bench.model(), rising(HELD), ROD)
    contact = model.test.case.contact
    assert contact is not None
    assert contact.obstacle == ROD.shape
    assert model.test.path.pressure.max() == 0.02
    assert model.reference.tolist() == [0]
    assert bench.case.contact is None


def test_a_model_with_a_table_meets_no_object(bench: Workbench) -> None:
    with pytest.raises(ValueError, match=r"the model has the effect contact, a table .* run `twin drop contact`"):
        beside(bench.model(["contact"]), rising(HELD), ROD)


def test_a_table_is_not_tried_beside_an_object(bench: Workbench) -> None:
    test = bench.model().test
    own = replace(test, case=ROD.beside(test.case))
    table = effect("contact", users=())
    values = {"contact.stiffness": 0.1, "contact.distance": 5.0}
    assert table.before(own, {**values, "contact.stiffness": 0.0}) is own
    with pytest.raises(Unsolvable, match="meets one obstacle alone"):
        table.before(own, values)


def test_the_interval_is_that_of_the_factors(met: Touched) -> None:
    end = met.half[-1] / 1.96
    # along the force, (0.6, 0, -0.8): 0.1 of 0.5 N, and -0.8 of 0.02 N
    assert end[0] == pytest.approx(np.hypot(0.05, 0.016))
    assert end[1:] == pytest.approx([0.03, 0.0, np.hypot(0.04, 0.02)])


def test_what_is_told_of_a_force(bench: Workbench, met: Touched) -> None:
    row = contact_rows(met)[-1]
    assert (row.force_N, row.along_N) == (pytest.approx(0.5), pytest.approx((0.3, 0.0, -0.4)))
    said = pushed(met, ROD)
    assert said.startswith(f"20 kPa: the finger presses on {ROD.text} with 0.5 N (95 %: 0.397 to 0.603): ")
    assert "x 0.3, z -0.4 N. It touches between 10 and 11.7 kPa." in said
    sprung = RigidObject.of(f"{ROD.text},spring=2")
    assert "gives way by 0.2 mm" in pushed(replace(met, yielded=0.2), sprung)
    away = replace(met, force=np.zeros_like(met.force))
    assert pushed(away, ROD) == f"20 kPa: the finger does not reach {ROD.text}."
    assert "that meets nothing" in told(False)
    assert "that meets nothing" not in told(True)
    bare = contact_csv(contact_rows(replace(met, why="the model does not fit")))
    assert bare.splitlines()[-1] == "3,0.02,0.5,,,0.3,0,-0.4,false"
    assert contact_picture(bench, [replace(met, yielded=0.2)], sprung)[1:4] == b"PNG"


@pytest.mark.parametrize("text", ["plane:nx=0,ny=0,nz=1,distance=-20", "cylinder:d=40,x=70,y=60", "cylinder:d=40,y=0,z=-30"])
def test_every_shape_is_drawn(bench: Workbench, met: Touched, text: str) -> None:
    assert contact_picture(bench, [met], RigidObject.of(text))[1:4] == b"PNG"


def test_an_object_wants_a_pressure_or_a_course() -> None:
    with pytest.raises(ValueError, match=saying("--object", "--pressure", "--course")):
        run_predict(Project.open(dataset("study")), lambda text: None, inverse=("tip.U3=-4",), object=ROD.text)  # type: ignore[arg-type]


def test_a_project_has_an_object_of_its_own(tmp_path: Path) -> None:
    text = (dataset("study") / "twin.toml").read_text(encoding="utf-8")
    for file in dataset("study").rglob("*"):
        if file.is_file():
            (tmp_path / file.relative_to(dataset("study"))).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file.relative_to(dataset("study"))).write_bytes(file.read_bytes())
    (tmp_path / "twin.toml").write_text(text.replace("[model]\n", f'[model]\nobject = "{ROD.text}"\n', 1))
    bench = Workbench.of(Project.open(tmp_path))
    assert bench.model().test.case.contact == ROD.beside(Workbench.of(Project.open(dataset("study"))).case).contact
    assert not bench.scales
