"""An object as it is typed, and a structure beside it."""

import numpy as np
import pytest

from fe import Case, Lattice
from fe.case import Spring
from fe.mesh.mirror import symmetry_support
from fe.obstacles import Flat, Obstacle, Round
from twin.model.objects import RigidObject
from twin.model.structure import BuiltIn, base_case, beside, of_finger

ROD = "cylinder:d=40,x=70,z=-30"


@pytest.fixture(scope="module")
def finger() -> Case:
    return base_case(lattice=Lattice(per_bellow=2, ring=False, centred=False))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (ROD, Round((70.0, 0.0, -30.0), 20.0, (0.0, 1.0, 0.0))),
        ("cylinder:d=4,y=1,z=-30", Round((0.0, 1.0, -30.0), 2.0, (1.0, 0.0, 0.0))),
        ("sphere:z=-30,d=40,x=70,y=0", Round((70.0, 0.0, -30.0), 20.0)),
        ("plane:nx=0,ny=0,nz=1,distance=-12", Flat((0.0, 0.0, 1.0), -12.0)),
    ],
)
def test_what_is_typed_is_an_object(text: str, wanted: Obstacle) -> None:
    assert RigidObject.of(text).shape == wanted


def test_options_of_an_object() -> None:
    thing = RigidObject.of(f"{ROD},friction=0.4,spring=2,along=x")
    assert (thing.friction, thing.spring, thing.way) == (0.4, 2.0, (1.0, 0.0, 0.0))
    assert RigidObject.of(f"{ROD},spring=2").way == (0.0, 0.0, 1.0)
    assert RigidObject.of("plane:nx=1,ny=0,nz=1,distance=-9,spring=2").way == (1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cube:d=40", "wanted a cylinder, sphere or plane, such as"),
        ("cylinder:x=70,z=-30", "no d; a cylinder needs d"),
        ("cylinder:d=-4,x=70,z=-30", "d=-4, wanted above 0 mm"),
        ("cylinder:d=40,x=70", "wanted two of x, y and z in mm"),
        ("cylinder:d=40,x=70,y=0,z=-30", "wanted two of x, y and z in mm"),
        ("cylinder:d=forty,x=70,z=-30", "d='forty', wanted a number"),
        ("cylinder:d=inf,x=70,z=-30", "d='inf', wanted a number"),
        ("cylinder:r=20,x=70,z=-30", "a cylinder has no r; wanted d, x, y, z, friction, spring, along"),
        ("sphere:d=40,x=70,z=-30", "no y; a sphere needs d, x, y, z"),
        ("plane:nx=0,ny=0,nz=0,distance=1", "a normal of no length"),
        (f"{ROD},d=50", "d stands twice; wanted each key once"),
        (f"{ROD},along=x,along=y", "along stands twice"),
        (f"{ROD},friction=-1", "friction=-1, wanted a coefficient from 0 to 2"),
        (f"{ROD},spring=0", "spring=0, wanted above 0 N/mm"),
        (f"{ROD},spring=1,along=w", "along='w', wanted x, y or z"),
    ],
)
def test_what_is_no_object_is_refused(text: str, told: str) -> None:
    with pytest.raises(ValueError, match=told) as caught:
        RigidObject.of(text)
    assert text in str(caught.value)


def test_an_object_in_the_finger_is_refused_with_its_depth(finger: Case) -> None:
    with pytest.raises(ValueError, match=r"reaches 4.99 mm into the finger at rest, at \(.*, 0\) mm; wanted one"):
        RigidObject.of("cylinder:d=40,x=70,z=-15").beside(finger)


def test_a_spring_of_the_whole_is_half_of_it_in_a_half_model(finger: Case) -> None:
    contact = RigidObject.of(f"{ROD},spring=2").beside(finger).contact
    assert contact is not None
    assert contact.spring == Spring(1.0, (0.0, 0.0, 1.0))


def test_what_is_not_met_alike_by_both_halves_takes_the_whole_finger(finger: Case) -> None:
    for text in ("sphere:d=20,x=70,y=5,z=-30", f"{ROD},spring=2,along=y", "plane:nx=0,ny=1,nz=1,distance=-40"):
        whole = RigidObject.of(text).beside(finger)
        assert symmetry_support(whole) is None
        assert len(whole.nodes) > 1.8 * len(finger.nodes)
        assert whole.contact is not None
        assert whole.contact.spring is None or whole.contact.spring.stiffness == 2.0
    for text in (ROD, "sphere:d=20,x=70,y=0,z=-30", "cylinder:d=20,y=0,z=-30", "plane:nx=0,ny=0,nz=1,distance=-40"):
        assert len(RigidObject.of(text).beside(finger).nodes) == len(finger.nodes)


def test_a_structure_and_its_finer_meshes_stand_beside_the_object() -> None:
    own = BuiltIn()
    free = of_finger(own.finger, own.lattice)
    found = beside(free, RigidObject.of(ROD))
    assert not found.scales
    assert found.key != free.key
    assert found.case.contact is not None
    assert found.finer["walls"].build().contact == found.case.contact
    assert np.array_equal(found.case.nodes, free.case.nodes)
    other = beside(free, RigidObject.of(f"{ROD},friction=0.4"))
    assert {found.key, *(m.key for m in found.finer.values())}.isdisjoint({other.key, *(m.key for m in other.finer.values())})
