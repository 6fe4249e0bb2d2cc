"""What the outline of the finger at rest says of a project."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.inputs.cameras import camera_table, lens_of
from twin.inputs.outlines import ModelOutline, SeenOutline, seen_outline
from twin.project.folder import Project
from vision import Video
from vision.perspective import Viewpoint
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


def test_a_finger_that_sags_is_not_compared(tmp_path: Path) -> None:
    weight = ("[model]", '[model]\ndensity_kg_m3 = 1070.0\ngravity = [0.0, 0.0, -1.0]')
    with pytest.raises(ValueError, match=saying("this finger sags", "1070", "markers of role clamp")):
        seen(project(tmp_path, weight))


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
