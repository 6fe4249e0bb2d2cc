"""The desk of `twin setup`: what a click, a drag and a typed value make of a draft, without a browser."""

import socket
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.messages import Lines, says
from twin import files
from twin.commands.init import film_config
from twin.gauge.pressurelog import Log
from twin.inputs.foundrecordings import Recordings, Tags, _tags, with_clock
from twin.project.cameratables import BoardTable
from twin.project.folder import Project
from twin.project.framesheet import SheetMarker, SheetTable
from twin.setup.desk import (
    changed,
    desk_of,
    explained_at,
    moved,
    pressed,
    released,
    with_camera,
    with_tag_role,
    written,
)
from twin.setup.draft import (
    SetupDraft,
    in_body,
    in_frame,
    with_board,
    with_body,
    with_dimension,
    with_log,
    with_rulers,
    with_start,
)
from twin.setup.outline import handles_of
from twin.setup.proposal import proposed
from twin.setup.recordedpictures import clock_chart, headings_of_log, said_of_log
from twin.validation import decoded
from vision import Camera, Mark
from vision.drawing import synthetic
from vision.kinds import CodedMarker, PlainDot

PX, MIDDLE = 3.0, np.array([400.0, 200.0])  # px/mm; of the sheet's middle and z = 0
SIDE = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
START = 7.0  # s of the film on the log's clock
RIG = [(x, z) for x in (-120.0, -80.0, -40.0, 0.0, 40.0, 80.0, 120.0) for z in (50.0, -80.0)]  # mm on the sheet
OWN = [(30.0, 4.0), (-10.0, 4.0), (-55.0, 4.0)]  # the finger points to the left
FIRST_OWN, LOOSE = 0, 30


def seen(place):
    """Where the film shows places of the sheet (n,2) mm."""
    return MIDDLE + PX * np.array(place) * (1.0, -1.0)


def pressure(time):
    return 0.03 * np.interp(time - START, [1.0, 3.0, 4.0, 5.0], [0.0, 0.6, 0.6, 1.0])


@pytest.fixture
def draft(tmp_path):
    """A finger with three tags before a printed sheet; tag 30 stands still, and nobody knows where."""
    places = [*OWN, *RIG, (0.0, -40.0)]
    codes = (*range(len(OWN)), *range(10, 10 + len(RIG)), LOOSE)
    time = np.arange(0.0, 6.0, 0.15)
    share = pressure(time + START) / 0.03
    centre = np.tile(seen(places), (len(time), 1, 1))
    for k, sinks in enumerate((5.0, 15.0, 40.0)):
        centre[:, k, 1] += sinks * share
    quads = centre[:, :, None] + 8.0 * PX * SIDE
    film = Tags(tmp_path / "raw" / "film.mkv", codes, time, quads, 40)
    clock = np.arange(0.0, 20.0, 0.05)
    log = Log(tmp_path / "raw" / "log.csv", clock, pressure(clock), None, "column 'p', in MPa")
    found = with_clock(Recordings(film=film, log=log, board=BoardTable(columns=8, rows=6, square_mm=10.0, marker_mm=7.5)))
    sheet = SheetTable(
        size_mm=8.0, sd_mm=0.1, ruler_mm=(250.0, 160.0), clamp_mm=55.0,
        markers=tuple(SheetMarker(marker=10 + k, role="fixed" if k % 5 == 1 or k % 5 == 3 else "frame", place_mm=place)
                      for k, place in enumerate(RIG)),
    )  # fmt: skip
    template = film_config("own")
    (tmp_path / "raw").mkdir()
    files.write_text(tmp_path / "raw" / "frame.toml", sheet.text())
    return SetupDraft(root=tmp_path, template=template, stated=template, is_former=False, found=found, sheet=sheet)


@pytest.fixture
def desk(draft):
    return desk_of(draft, width=800)


def px_of(desk, handle):
    """The pixel of a handle."""
    return desk.sight.px(handles_of(desk.draft, desk.contour)[handle][None])[0]


def dragged(desk, handle, by):
    """The desk after a handle is dragged by pixels (2,)."""
    start = px_of(desk, handle)
    held = pressed(desk, start)
    assert held.drag is not None
    assert held.drag.handle == handle
    after = released(moved(moved(held, start + 0.5 * np.array(by)), start + np.array(by)))
    assert after.drag is None
    return after


def test_it_begins_with_what_motion_and_sheet_tell(desk):
    roles = desk.proposal.roles
    assert [roles[k] for k in range(3)] == ["finger"] * 3
    assert roles[10] == "frame"
    assert roles[11] == "fixed"
    assert roles[LOOSE] == "ignore"
    config = desk.proposal.config
    assert [(p.name, p.marker) for p in config.points] == [("p1", 0), ("middle", 1), ("tip", 2)]
    assert (config.frame.sheet, config.frame.finger) == ("raw/frame.toml", "left")
    assert config.cameras[0].film_start_s == pytest.approx(START, abs=0.1)
    assert any(line.startswith("Tags 30 stand still") for line in desk.proposal.wanted)
    assert desk.proposal.frame is not None
    assert not desk.proposal.frame.is_new


def test_a_tag_near_the_clamp_is_on_the_finger_though_it_hardly_moves(draft):
    film = draft.found.film
    assert film is not None
    quads = film.quads.copy()
    k = film.codes.index(LOOSE)
    quads[:, k] += (seen((52.0, 5.0)) - seen((0.0, -40.0))) + np.array((0.0, 0.5)) * (pressure(film.time + START) / 0.03)[:, None, None]
    quads[:, -1:] += 0.02 * np.random.default_rng(0).standard_normal(quads[:, -1:].shape)
    near = replace(draft, found=replace(draft.found, film=replace(film, quads=quads)))
    assert proposed(near).roles[LOOSE] == "finger"
    assert [p.marker for p in proposed(near).config.points] == [LOOSE, 0, 1, 2]
    # at the same place, at rest
    away = quads.copy()
    away[:, k] = quads[0, k]
    assert proposed(replace(draft, found=replace(draft.found, film=replace(film, quads=away)))).roles[LOOSE] == "ignore"
    # and one that moves as little elsewhere
    away[:, k] = quads[:, k] + (0.0, 60.0)
    assert proposed(replace(draft, found=replace(draft.found, film=replace(film, quads=away)))).roles[LOOSE] == "ignore"


def test_a_click_selects_a_tag_and_gives_it_a_role(desk):
    after = with_tag_role(pressed(desk, seen(RIG[1]) + 5.0), "ignore")
    assert after.selected == 11
    assert 11 not in [m.marker for m in after.proposal.project.config.frame.markers]
    assert after.proposal.frame.is_new
    assert desk.proposal.roles[11] == "fixed"  # the former desk is as it was
    back = with_tag_role(after, "frame")
    assert {m.marker: m.role for m in back.proposal.project.config.frame.markers}[11] == "frame"
    # of the finger: it is no point any more, and the middle is named anew
    less = with_tag_role(pressed(desk, seen(OWN[1])), "ignore")
    assert [p.name for p in less.proposal.config.points] == ["p1", "tip"] or [p.marker for p in less.proposal.config.points] == [0, 2]
    none = pressed(after, np.array([400.0, 320.0 + 60.0]))
    assert none.selected is None
    assert with_tag_role(none, "frame") is none


def test_a_tag_without_a_place_is_no_frame_marker(desk):
    there = pressed(desk, seen((0.0, -40.0)))
    assert there.selected == LOOSE
    assert there.proposal.choices(LOOSE) == ("finger", "ignore")
    refused = with_tag_role(there, "frame")
    says(refused.fault, f"tag {LOOSE}", "printed sheet", "position_mm")
    assert refused.draft is there.draft
    said = with_tag_role(there, "ignore")
    assert not any("30" in line for line in said.proposal.wanted)  # somebody has decided


def with_dots(draft, places, sinks):
    """The draft with plain dots of 3 mm at places (n,2) mm of the sheet, which sink by so many px at most."""
    film = draft.found.film
    share = (pressure(film.time + START) / 0.03)[:, None]
    centre = np.tile(seen(places), (len(film.time), 1, 1))
    centre[..., 1] += share * sinks
    quads = np.concatenate([film.quads, centre[:, :, None] + 3.0 * PX * SIDE], axis=1)
    more = replace(film, codes=(*film.codes, *(-1 - k for k in range(len(places)))), quads=quads)
    return replace(draft, found=replace(draft.found, film=more))


def test_dots_of_a_film_are_found_and_followed_beside_its_tags(tmp_path):
    matrix, facing = np.array([[1200.0, 0, 160], [0, 1200.0, 100], [0, 0, 1]]), -np.eye(3)[[0, 2, 1]]
    camera = Camera(matrix, np.zeros(5), (320, 200))
    marks = [Mark(f"m{k}", CodedMarker(k, 8.0) if k < 4 else PlainDot(4.0), (x, 0.0, z), "finger")
             for k, (x, z) in enumerate([(-30, 15), (30, 15), (-30, -15), (30, -15), (-8, 0), (10, 5)])]  # fmt: skip
    place = np.tile([m.position for m in marks], (8, 1, 1))
    place[:, 4, 2] -= 0.8 * np.arange(8)
    pose = cv2.Rodrigues(facing)[0].ravel(), np.array([0.0, 0.0, 300.0])
    synthetic.film(tmp_path / "film.mkv", camera=camera, pose=pose, marks=marks, positions=place,
                   rotations=np.zeros((8, 6)), codec="rawvideo")  # fmt: skip
    film = _tags(tmp_path / "film.mkv", "DICT_4X4_50")
    assert film.codes == (-2, -1, 0, 1, 2, 3)  # none within a tag
    assert film.moves.tolist() == [True, False, False, False, False, False]
    assert film.still == {0, 1, 2, 3}
    want = 4.0 * place[:, [4, 5]][..., [0, 2]] * (-1.0, -1.0) + (160.0, 100.0)  # px
    np.testing.assert_allclose(film.centre[:, :2], want, atol=0.1)
    np.testing.assert_allclose(np.ptp(film.quads[:, :2], axis=2), 16.0, atol=0.5)


def test_dots_are_drawn_named_and_get_roles_by_a_click(draft):
    dotted = desk_of(with_dots(draft, [(-30.0, 1.0), (-90.0, -40.0)], [25.0, 0.0]), width=800)
    assert (dotted.proposal.roles[-1], dotted.proposal.roles[-2]) == ("finger", "ignore")
    (dot,) = [p for p in dotted.proposal.config.points if p.marker is None]
    assert dot.position_mm == pytest.approx((85.0, 11.5, 1.0), abs=0.01)  # from the clamp, at the side face
    assert dot.size_mm == pytest.approx(3.0, abs=0.01)
    assert dotted.svg.count("r=\"4.5\"") == 2
    assert f">{dot.name}<" in dotted.svg
    assert ">dot 2<" in dotted.svg
    assert "Tags" not in " ".join(line for line in dotted.proposal.wanted if "-2" in line)
    both = with_tag_role(pressed(dotted, seen((-90.0, -40.0))), "finger")
    assert both.selected == -2
    assert sum(p.marker is None for p in both.proposal.config.points) == 2
    says(with_tag_role(both, "frame").fault, "dot 2 cannot be frame")
    none = with_tag_role(pressed(both, seen((-30.0, 1.0))), "ignore")
    assert -1 not in none.proposal.names
    # a dot that twin.toml has keeps its name, and what was measured of it
    own = dot.model_copy(update={"name": "spot", "position_mm": (85.4, 11.5, 1.0)})
    stated = both.draft.stated.model_copy(update={"points": (own,)})
    kept = desk_of(replace(dotted.draft, stated=stated), width=800).proposal
    assert own in kept.config.points
    assert kept.names[-1] == "spot"


def test_the_outline_is_moved_turned_and_made_longer(desk):
    # x goes to the left in the picture, z up: 30 px to the left and 15 px up
    after = dragged(desk, "move", (-30.0, -15.0))
    pose = after.proposal.config.pose
    assert (pose.x_mm, pose.z_mm, pose.turn_deg) == pytest.approx((10.0, 5.0, 0.0), abs=0.02)
    before, now = (d.sight.px(in_frame(d.draft.pose, d.contour)) for d in (desk, after))
    np.testing.assert_allclose(now - before, np.broadcast_to((-30.0, -15.0), now.shape), atol=0.05)
    # the tip is lifted: the finger turns from x towards z
    start = px_of(desk, "turn")
    far = np.linalg.norm(start - desk.sight.px(np.zeros((1, 2)))[0])
    turned = dragged(desk, "turn", (0.0, -0.02 * far))
    assert turned.draft.pose.turn_deg == pytest.approx(np.degrees(0.02), rel=0.02)
    place = np.array([[110.0, 0.0]])
    assert in_frame(turned.draft.pose, place)[0, 1] == pytest.approx(2.2, rel=0.02)
    np.testing.assert_allclose(in_body(turned.draft.pose, in_frame(turned.draft.pose, place)), place, atol=1e-9)
    longer = dragged(turned, "length_mm", (-18.0, 0.0))
    assert longer.proposal.config.model.finger.length_mm == pytest.approx(116.0, abs=0.11)
    assert longer.contour[:, 0].max() == pytest.approx(longer.draft.dimensions.length_mm)
    higher = dragged(desk, "height_mm", (0.0, -6.0))
    assert higher.draft.dimensions.height_mm == pytest.approx(22.0, abs=0.11)
    assert "model.finger" not in " ".join(higher.proposal.wanted)  # somebody has looked


def test_a_drag_that_no_finger_allows_is_said_and_not_done(desk):
    after = dragged(desk, "height_mm", (0.0, 45.0))
    assert "height_mm" in after.fault
    assert after.draft.dimensions.height_mm >= 12.0
    assert after.contour is not None


def test_the_face_of_the_outline_moves_it_but_a_tag_on_it_is_selected(desk):
    assert pressed(desk, seen((10.0, 8.0))).drag.handle == "move"
    assert pressed(desk, seen(OWN[1])).selected == 1
    assert pressed(desk, seen(OWN[1])).drag is None
    assert moved(desk, np.array([1.0, 1.0])) is desk  # nothing is held


def test_the_lens_is_taken_where_it_is_known(draft):
    matrix = np.array([[2000.0, 0.0, 390.0], [0.0, 2000.0, 260.0], [0.0, 0.0, 1.0]])
    camera = Camera(matrix, np.array([-0.8, 0.0, 0.0, 0.0, 0.0]), (800, 500))
    film = draft.found.film
    bent = replace(draft, found=replace(draft.found, film=replace(film, quads=camera.distort(film.quads))))
    places = np.array([[0.0, 0.0], [110.0, 20.0]])
    want = camera.distort(seen(np.column_stack([55.0 - places[:, 0], places[:, 1]])))
    known = with_camera(desk_of(bent, width=800), camera)
    np.testing.assert_allclose(known.sight.px(places), want, atol=0.05)
    np.testing.assert_allclose(known.sight.mm(known.sight.px(places)), places, atol=1e-6)
    assert np.abs(desk_of(bent, width=800).sight.px(places) - want).max() > 0.1


def test_the_films_start_is_shifted_by_eye_or_left_to_its_motion(desk):
    found = desk.proposal.config
    assert found.pressure.join == "onset"
    after = changed(desk, lambda draft: with_start(draft, 8.25)).proposal.config
    assert (after.cameras[0].film_start_s, after.pressure.join, after.pressure.sync_sd_s) == (8.25, "stamps", 0.05)
    again = changed(changed(desk, lambda draft: with_start(draft, 8.25)), lambda draft: with_start(draft, None))
    assert again.proposal.config == found
    assert explained_at(desk.draft, START) > 0.99 > explained_at(desk.draft, 2.0)
    chart = clock_chart(with_start(desk.draft, 8.25))
    assert chart["series"][1]["data"][0][0] == pytest.approx(8.25)


def test_a_log_is_read_as_its_user_says(desk, tmp_path):
    rows = "".join(f"{t:.2f},{1e3 * pressure(t):.4f},1\n" for t in np.arange(0.0, 20.0, 0.05))
    path = tmp_path / "raw" / "log.csv"
    files.write_text(path, "time_s,p,q\n" + rows)
    found = replace(desk.draft.found, log=None, start_s=None, tables=(path,), of_log=("No pressure log that can be read.",))
    bare = desk_of(replace(desk.draft, found=found), width=800)
    assert headings_of_log(found) == ["time_s", "p", "q"]
    assert "No pressure log that can be read." in bare.proposal.wanted
    after = changed(bare, lambda draft: with_log(draft, column="p", unit="kPa", top_kPa=None))
    assert after.fault == ""
    assert (after.proposal.config.pressure.column, after.proposal.config.pressure.unit) == ("p", "kPa")
    assert after.draft.start == pytest.approx(START, abs=0.1)
    says(said_of_log(after.draft.found), "log.csv", "0 to 30 kPa")
    assert "No pressure log that can be read." not in after.proposal.wanted
    wrong = changed(after, lambda draft: with_log(draft, column="nothing", unit="kPa", top_kPa=None))
    assert "nothing" in wrong.fault
    assert wrong.draft is after.draft


def test_what_a_ruler_measures(desk):
    after = changed(desk, lambda draft: with_board(draft, square_mm=12.0, marker_mm=7.5))
    board = after.proposal.config.cameras[0].board
    assert (board.square_mm, board.marker_mm) == (12.0, 9.0)  # the pictures tell the marker's share
    assert "square_mm" not in " ".join(after.proposal.wanted)
    after = changed(after, lambda draft: with_rulers(draft, across=249.0, upright=160.5))
    assert after.proposal.config.frame.ruler_mm == (249.0, 160.5)
    assert "ruler_mm" not in " ".join(after.proposal.wanted)
    assert after.sight.px(np.array([[0.0, 0.0]]))[0, 0] == pytest.approx(seen((55.0, 0.0))[0])
    assert "ruler_mm" in changed(after, lambda draft: with_rulers(draft, across=249.0, upright=80.0)).fault
    assert "square_mm" in changed(after, lambda draft: with_board(draft, square_mm=-1.0, marker_mm=None)).fault


def test_what_stands_there_can_be_right(desk):
    after = changed(desk, lambda draft: with_body(draft, "finger"))
    assert "model.finger" in " ".join(desk.proposal.wanted)
    assert "model.finger" not in " ".join(after.proposal.wanted)
    assert "\n[model.finger]\nlength_mm = 110.0" in after.proposal.text
    board = desk.draft.found.board
    after = changed(after, lambda draft: with_board(draft, square_mm=board.square_mm, marker_mm=board.marker_mm))
    assert after.draft.found.board == board
    assert after.proposal.wanted == [line for line in desk.proposal.wanted if line.startswith(("ruler_mm", "Tags"))]


def test_another_body_has_another_outline(desk):
    after = changed(desk, lambda draft: with_body(draft, "tube"))
    assert after.proposal.config.model.kind == "tube"
    assert len(after.contour) != len(desk.contour)
    assert "wanted" in changed(after, lambda draft: with_dimension(draft, "length_mm", 2.0)).fault
    Project(Path(), after.proposal.project.config)


def test_it_writes_twin_toml_and_keeps_the_former(desk):
    root, told = desk.draft.root, Lines()
    listed = {p.name for p in root.rglob("*")}
    assert not desk.proposal.is_written
    first = written(changed(desk, lambda draft: with_start(draft, 8.25)), told)
    assert first.fault == ""
    assert first.proposal.is_written
    assert {p.name for p in root.rglob("*")} - listed == {"twin.toml"}
    assert "# time of the film's first frame" in decoded((root / "twin.toml").read_bytes())
    again = written(first, told)  # the same: nothing is kept twice
    assert not (root / "twin-0001.toml").exists()
    less = with_tag_role(pressed(again, seen(RIG[1])), "ignore")
    assert not less.proposal.is_written
    assert written(less, told).proposal.is_written
    assert not (root / "twin-0001.toml").exists()  # twin.toml says the same
    assert (root / "raw" / "frame-0001.toml").is_file()
    assert Project.open(root).config.frame.markers == less.proposal.project.config.frame.markers
    written(changed(less, lambda draft: with_start(draft, 8.5)), told)
    assert "film_start_s = 8.25" in (root / "twin-0001.toml").read_text()
    few = less
    for place in RIG[2:9]:
        few = with_tag_role(pressed(few, seen(place)), "ignore")
    refused = written(few, told)
    assert "frame.markers" in refused.fault
    assert not refused.proposal.is_written
    assert proposed(few.draft).roles[12] == "ignore"


def test_the_server_is_for_this_machine_and_says_what_is_not_written(require, draft, monkeypatch):
    require("nicegui")
    import uvicorn

    from twin.setup.server import serve

    bound = []

    def interrupted(self, sockets):
        bound.extend(sockets[0].getsockname())
        raise KeyboardInterrupt

    monkeypatch.setattr(uvicorn.Server, "run", interrupted)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    bare = replace(draft, found=Recordings())
    told = Lines()
    assert not serve(bare, told, check=lambda *args, **how: None, port=0)
    assert bound[0] == "127.0.0.1"
    says(told[0], f"http://127.0.0.1:{bound[1]}")
    says(told[-1], "not written")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=rf"--port {port}: Address already in use; wanted a free port"):
            serve(bare, Lines(), check=lambda *args, **how: None, port=port)
