"""What the outline of the finger at rest says of a project."""

import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from benchmarks.films.outlines import STATED, WALL_MM, draw

import numpy as np
import pytest

from fe import Lattice, Material, finger_case
from tests.messages import saying
from twin.bench.workbench import structure_of
from twin.inputs.cameras import camera_table, lens_of
from twin.inputs.outlines import ModelOutline, SeenOutline, seen_outline
from twin.inputs.restsags import RestSag, rest_sag
from twin.project.folder import Project
from vision import Video
from vision.perspective import Viewpoint
from vision.placing.outlines import fit_outline
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import cut, on_plane, silhouette

QUICK = Path(__file__).parents[3] / "datasets" / "quick"


def project(folder: Path, *changes: tuple[str, str]) -> Project:
    """The quick data set with other lines in twin.toml."""
    text = (QUICK / "twin.toml").read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    (folder / "twin.toml").write_text(text, encoding="utf-8")
    shutil.copytree(QUICK / "raw", folder / "raw")
    return Project.open(folder)


def seen(of: Project) -> SeenOutline:
    table = camera_table(of)
    return seen_outline(of, table, Video(of.path(table.film)), lens_of(of, table))


def test_the_outline_tells_pose_and_length(tmp_path: Path) -> None:
    of = project(tmp_path, ("length_mm = 70.0", "length_mm = 68.2"),
                 ("[[points]]", '[pose]\nfrom = "outline"\nx_mm = 2.0\n\n[[points]]'))  # fmt: skip
    outline = seen(of)
    pose, sd = outline.found.pose, np.sqrt(np.diag(outline.found.covariance))
    assert (np.abs([pose.x_mm, pose.turn]) < np.minimum(3.5 * sd[[0, 2]], [0.4, 0.005])).all()
    assert abs(pose.z_mm) < 0.6  # the film draws the near side face alone: its bottom is not that of a solid
    (length,) = (line for line in outline.wrong if "length_mm" in line)
    assert re.match(r"model\.length_mm = 68\.2, the film shows (69\.[89]|70\.[0-2])\d* \+- 0\.\d+ mm: ", length)
    assert outline.summary["sizes_mm"]["length_mm"][0] == pytest.approx(70.0, abs=0.3)
    assert "x = " in outline.told[0]
    assert outline.drawn().startswith(b"\x89PNG")


DOWN = np.array([0.0, 0.0, -1.0])


def sagged(modulus: float, lattice: Lattice) -> RestSag:
    """That of a finger whose modulus is known to 20 %."""
    silicone = Material(C10=0.75 * modulus, C01=0.25 * modulus, density=5e-10)
    case = finger_case(silicone, finger=STATED.finger, lattice=lattice)
    return RestSag.of(cast(Any, SimpleNamespace(case=case)), DOWN, 0.2)


@pytest.fixture(scope="module")
def sag() -> RestSag:
    return sagged(0.2, Lattice(per_bellow=4, ring=False, centred=False))


def tip_of(sag: RestSag) -> float:
    return -float(sag(np.array([70.0, 0.0, 7.5]))[2])


def test_a_finger_that_sags_is_compared_with_the_model_that_sags(sag: RestSag) -> None:
    """It is of a finer mesh, and softer by a tenth than the model's constants say."""
    softer = sagged(0.18, Lattice(per_bellow=6))
    assert 0.5 < tip_of(sag) < 5.0
    drawn = draw(np.random.default_rng(11), distance=500.0, sag=softer)
    model = ModelOutline.of(STATED, dict.fromkeys(STATED.body.inner, WALL_MM), sag)
    found = fit_outline(drawn.rest, model, BodyPose())
    sd = np.sqrt(np.diag(found.covariance))
    a, b = found.pose, drawn.pose
    off = np.array([a.x_mm - b.x_mm, a.z_mm - b.z_mm, a.turn - b.turn])
    assert (np.abs(off) < 3.5 * sd).all()
    sizes = {size.name: size for size in found.sizes}
    more = tip_of(softer) / tip_of(sag) - 1.0
    assert abs(sizes["sag"].off - more) < 3.5 * sizes["sag"].sd < 3.5 * 0.25
    stiff = fit_outline(drawn.rest, replace(model, sag=None), BodyPose())
    assert abs(stiff.pose.turn - drawn.pose.turn) > 3.5 * sd[2]  # the sag is taken for a turn
    assert stiff.covariance[2, 2] < found.covariance[2, 2]  # what is uncertain of the sag is carried
    seen = SeenOutline(found, drawn.rest.picture, {"length_mm": 70.0})
    assert not any("sag" in line for line in (*seen.wrong, *seen.told))


def test_a_sag_is_smooth_along_the_finger(sag: RestSag) -> None:
    places = np.array([[x, 0.0, 7.5] for x in (0.0, 17.5, 35.0, 52.5, 70.0)])
    drop, t = -sag(places)[:, 2] / tip_of(sag), places[:, 0] / 70.0
    np.testing.assert_allclose(drop, (t**4 - 4 * t**3 + 6 * t**2) / 3, atol=0.05)  # of a beam
    assert drop[0] == pytest.approx(0.0, abs=0.01)


def test_which_way_a_finger_sags_is_asked_for(tmp_path: Path) -> None:
    of = project(tmp_path, ("[model]", "[model]\ndensity_kg_m3 = 1070.0"))
    with pytest.raises(ValueError, match=saying("the finger sags", "1070", "gravity = ")):
        rest_sag(of, structure_of(of))


def test_a_modulus_that_is_fixed_is_known(tmp_path: Path) -> None:
    weight = ("[model]", "[model]\ndensity_kg_m3 = 1070.0\ngravity = [0.0, 0.0, -1.0]")
    of = project(tmp_path, weight)
    sag = rest_sag(of, structure_of(of))
    assert sag is not None
    assert sag.sd == pytest.approx(0.2, abs=0.01)
    text = (tmp_path / "twin.toml").read_text(encoding="utf-8")
    stated = text.replace("fixed = {}", "fixed = {C10 = 0.4, C01 = 0.2}")
    (tmp_path / "twin.toml").write_text(stated, encoding="utf-8")
    stiff = Project.open(tmp_path)
    known = rest_sag(stiff, structure_of(stiff))
    assert known is not None
    assert known.sd < 0.05
    assert tip_of(known) < 0.7 * tip_of(sag)


def test_several_cameras_do_not_tell_it(tmp_path: Path) -> None:
    text = (QUICK / "twin.toml").read_text(encoding="utf-8")
    camera = text[text.index("[[cameras]]") : text.index("[pressure]")]
    second = camera.replace('"side"', '"front"')
    with pytest.raises(ValueError, match=saying('pose.from = "outline"', "wanted one")):
        project(tmp_path, (camera, camera + second), ("[[points]]", '[pose]\nfrom = "outline"\n\n[[points]]'))


def test_slopes_are_what_the_dimensions_do() -> None:
    """The outline moves along its normals as the model with a larger dimension says."""
    table = Project.open(QUICK).config.model.dimensions
    assert table is not None
    model, view = ModelOutline.of(table, {}), Viewpoint(np.array([32.0, -8.0]), 500.0)
    solid = model({})
    flat = on_plane(solid.faces, BodyPose(), view, 10.0)
    line = silhouette(flat)
    edge = cut(flat, line.place, line.normal)
    for changed in solid.changed:
        moved = on_plane(changed.faces, BodyPose(), view, 10.0)
        slope = edge.of(moved - flat, line.normal)
        again = cut(moved, line.place, line.normal).off - edge.off
        np.testing.assert_allclose(slope, again, atol=0.02, err_msg=changed.name)
    assert {c.name for c in solid.changed} >= {"length_mm", "height_mm", "pleat_depth_mm", "base_cap_mm"}
