"""The outline of `twin setup` on the edges that the film shows, without a browser."""

import shutil

import pytest

from tests.messages import says
from twin.commands.init import film_config
from twin.project.folder import dataset
from twin.setup.desk import changed, desk_of, lens_of_board
from twin.setup.draft import draft_of, with_dimension, with_pose
from twin.setup.outline import snapped


def test_the_outline_snaps_to_the_edges(tmp_path):
    for name in ("raw", "twin.toml"):
        copy = shutil.copytree if name == "raw" else shutil.copyfile
        copy(dataset("quick") / name, tmp_path / name)
    draft = draft_of(tmp_path, film_config("quick"))
    moved = with_pose(with_dimension(draft, "length_mm", 68.2), draft.pose.model_copy(update={"x_mm": 1.5}))
    desk = desk_of(moved, width=800)
    says(changed(desk, lambda draft: snapped(draft, None)).fault, "lens", "board")
    camera = lens_of_board(desk.proposal)
    after = changed(desk, lambda draft: snapped(draft, camera))
    assert after.fault == ""
    assert after.draft.pose.source == "outline"  # `twin measure` tells it again
    assert after.draft.pose.x_mm == pytest.approx(0.0, abs=0.4)
    assert after.draft.dimensions.length_mm == pytest.approx(70.0, abs=0.3)
    assert after.draft.dimensions.width_mm == draft.dimensions.width_mm  # no camera sees it
    says(after.proposal.text, 'from = "outline"')
