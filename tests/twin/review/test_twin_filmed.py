"""The models over the film: the edge of the side face, three timelines, four views, still and clip."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from fe import Case
from fe.element import triangles
from twin.drawing.painting import (
    AFTER,
    BEFORE,
    CAPTION,
    LONGEST_S,
    Image,
    edge_rows,
    side_by_side,
    still,
    window,
    write_clip,
)
from twin.review.arrangement import VIEWS, arranged
from twin.review.filmed import Filmed, Trace, magnified, rms
from twin.review.recording import write_review
from twin.review.scene import scene_of
from twin.review.states import Generations
from vision import Video

Array = NDArray[np.float64]
SIZE, FRAMES, RATE = (320, 240), 12, 10
TIMES = np.arange(FRAMES) / RATE
BOX = np.array([[60.0, 80.0], [240.0, 80.0], [240.0, 140.0], [60.0, 140.0], [60.0, 80.0]])
SPOTS = np.array([[100.0, 140.0], [200.0, 140.0]])
OFF = (9.0, 6.0, 1.0)  # px, by which each model is too low


def trace(label: str, off: float, rms_mm: float) -> Trace:
    """A model whose edge and markers are the film's, moved by `off` px down; the film's move by 2 px a frame."""
    down = 2.0 * np.arange(FRAMES)[:, None, None] * [0.0, 1.0] + [0.0, off]
    return Trace(label=label, rms_mm=rms_mm, edge=BOX + down, markers=SPOTS + down)


def filmed(**changes: object) -> Filmed:
    measured = SPOTS + 2.0 * np.arange(FRAMES)[:, None, None] * [0.0, 1.0]
    measured[3, 0] = np.nan  # lost
    way = tuple(trace(n, o, o / 20) for n, o in zip(("nominal constants", "calibrated", "+ creep"), OFF))
    fit = trace("generation", 4.0, 0.1)
    given = {
        "size": SIZE, "frame": np.arange(FRAMES), "time_s": TIMES, "names": ("middle", "tip"), "measured": measured,
        "models": way, "before": 1, "search": Trace(label="", rms_mm=0.1, edge=fit.edge[:4], markers=fit.markers[:4]),
        "search_measured": measured[5], "expected_mm": 0.04,
        "error_mm": tuple(np.full((FRAMES, 2), o) + np.eye(FRAMES, 2, -7) for o in OFF),
    }  # fmt: skip
    return Filmed(**{**given, **changes})


def history() -> Generations:
    box = np.array([[x, y, z] for x in (0.0, 100.0) for y in (-10.0, 10.0) for z in (0.0, 20.0)])
    sides = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]])
    points = np.array([[50.0, 10.0, 0.0], [100.0, 10.0, 0.0]])
    return Generations(
        generation=np.arange(1, 5), names=("C10",), best=np.full((4, 1), 0.2), rms_mm=np.full(4, 0.1), nodes=box,
        triangles=sides, u=np.zeros((4, 8, 3), np.float32), point_names=("middle", "tip"), points=points,
        u_points=np.zeros((4, 2, 3)), u_measured=np.zeros((2, 3)), film_time_s=0.5, film_frame=5,
    )  # fmt: skip


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "test.mp4"
    with av.open(path, "w") as target:
        stream = target.add_stream("libx264", rate=RATE, options={"crf": "12", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.codec_context.time_base = Fraction(1, RATE)
        for number in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(np.full(SIZE[::-1], 120, np.uint8), format="gray")
            frame = frame.reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    return path


# -- the edge ------------------------------------------------------------------------------------------------


def test_the_edge_runs_once_round_the_near_side(short_case: Case) -> None:
    skin = triangles(short_case.face_nodes("outside"))
    rows = edge_rows(short_case.nodes, skin)
    edge = short_case.nodes[rows]
    assert rows[0] == rows[-1]
    assert len(set(rows)) == len(rows) - 1
    used = short_case.nodes[np.unique(skin)]
    np.testing.assert_allclose(edge.max(axis=0), used.max(axis=0))
    np.testing.assert_allclose(edge[:, [0, 2]].min(axis=0), used[:, [0, 2]].min(axis=0))
    # of the flat underside the corner that the camera sees, and no other
    below = edge[edge[:, 2] == 0.0]
    assert len(below) > 20
    np.testing.assert_array_equal(below[:, 1], used[:, 1].max())
    area = 0.5 * np.sum(edge[:-1, 0] * edge[1:, 2] - edge[1:, 0] * edge[:-1, 2])
    drawn = np.zeros((900, 1800), np.uint8)  # all triangles from the side, 0.025 mm a pixel
    for corners in short_case.nodes[skin][..., [0, 2]]:
        cv2.fillConvexPoly(drawn, np.round(corners / 0.025 + 20).astype(np.int32), 1)
    assert abs(area) == pytest.approx(drawn.sum() * 0.025**2, rel=0.01)  # straight between the nodes


# -- the recording -------------------------------------------------------------------------------------------


def logged(path: Path, entity: str, column: str, timeline: str) -> dict[int, object]:
    found: dict[int, object] = {}
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = chunk.to_record_batch()
        if {timeline, column} <= set(table.schema.names):
            times = table.column(timeline).cast("int64").to_pylist()
            found.update(zip(times, table.column(column).to_pylist()))
    return found


@pytest.fixture(scope="module")
def recording(film: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "review.rrd"
    assert write_review(
        path, film=film, frame_times_s=TIMES, generations=history(), fields=None, diagnosis_markdown="creep",
        filmed=filmed(),
    ) == ["along the film the best model of the genetic algorithm is shown, at top pressure only"]  # fmt: skip
    return path


@pytest.mark.parametrize(
    ("entity", "timeline", "count"),
    [("test/before", "film_time", FRAMES), ("test/after", "film_time", FRAMES), ("search", "generation", 4), ("effect", "effect", 3)],
)  # fmt: skip
def test_film_and_models_are_on_each_timeline(recording: Path, entity: str, timeline: str, count: int) -> None:
    edges = logged(recording, f"/film/{entity}/edge", "LineStrips2D:strips", timeline)
    arrows = logged(recording, f"/film/{entity}/error", "Arrows2D:vectors", timeline)
    frames = logged(recording, "/film/frame", "VideoFrameReference:timestamp", timeline)
    assert list(edges) == list(arrows) == list(frames)
    assert len(edges) == count


def test_the_edges_lie_where_the_models_are(recording: Path) -> None:
    found = logged(recording, "/film/test/after/edge", "LineStrips2D:strips", "film_time")
    # the viewer counts pixels from their corner
    np.testing.assert_allclose(np.array(list(found.values()))[:, 0], filmed().models[2].edge + 0.5, atol=1e-4)
    steps = logged(recording, "/film/effect/edge", "LineStrips2D:strips", "effect")
    tops = [np.array(strips[0])[0, 1] for strips in steps.values()]  # type: ignore[index]
    np.testing.assert_allclose(np.diff(tops), np.diff(OFF), atol=1e-4)


def test_arrows_are_as_much_longer_as_the_legend_says(recording: Path) -> None:
    own = filmed()
    arrows = logged(recording, "/film/test/before/error", "Arrows2D:vectors", "film_time")
    np.testing.assert_allclose(np.array(next(iter(arrows.values()))), own.magnified * np.array([[0, -6.0]] * 2), atol=1e-4)
    assert len(list(arrows.values())[3]) == 1  # type: ignore[arg-type]  # a lost marker has none
    (chunk,) = [c.to_record_batch() for c in RrdReader(str(recording)).stream().filter(content="/film/legend/before")]
    texts = chunk.column("Points2D:labels").to_pylist()[0]
    assert texts[-1].endswith(f"to the film's, {own.magnified} times as long")
    assert "orange: model, calibrated" in texts


def test_the_fall_of_the_error_is_that_of_the_models(recording: Path) -> None:
    found = logged(recording, "/fall/error", "Scalars:scalars", "effect")
    assert [value[0] for value in found.values()] == [o / 20 for o in OFF]  # type: ignore[index]
    moment = logged(recording, "/moment/before", "Scalars:scalars", "film_time")
    assert next(iter(moment.values()))[0] == OFF[1]  # type: ignore[index]


def test_the_views_have_their_names_and_open_at_the_test() -> None:
    tabs = arranged(scene_of(history(), None), has_film=True, filmed=filmed(), pictures=("error",)).root_container
    assert [view.name for view in tabs.contents] == list(VIEWS) == ["search", "test", "where it fails", "effects"]  # type: ignore[union-attr]
    assert set(VIEWS.values()) == {"generation", "film_time", "effect"}


def test_models_are_shown_alone_where_no_effect_was_added() -> None:
    one = filmed(models=filmed().models[:2], error_mm=filmed().error_mm[:2])
    assert [model.label for model in one.shown] == ["calibrated"]
    assert [model.label for model in filmed().shown] == ["calibrated", "+ creep"]


# -- still and clip ------------------------------------------------------------------------------------------


def test_the_worst_moment_and_the_length_of_arrows() -> None:
    assert filmed().worst == 7
    assert filmed().magnified == 2  # 6 px: twice is below 0.09 of 320 px, five times is not
    assert magnified(np.full((1, 1, 2), np.nan), SIZE) == 1
    np.testing.assert_allclose(rms(np.array([[3.0, 4.0], [np.nan, 2.0], [np.nan, np.nan]])), [12.5**0.5, 2.0, np.nan])


def coloured(picture: Image, colour: tuple[int, int, int], *, within: int) -> NDArray[np.bool_]:
    return (np.abs(picture.astype(int) - colour) <= within).all(axis=2)


def test_each_model_is_painted_at_its_place() -> None:
    grey = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    own, at = filmed(), 7
    where = window(own, [at], width=400)
    both = side_by_side(grey, own, at, where)
    width, height = where.shape
    head = 2 * round(CAPTION * width / 2)
    assert both.shape[0] == head + height
    for panel, colour, model in ((both[:, :width], BEFORE, own.models[1]), (both[:, -width:], AFTER, own.models[2])):
        rows, columns = np.nonzero(coloured(panel[head:], colour, within=70))
        corner = where.places(model.edge[at])
        # the line is 1 px wide, its sides a mixture of it and the grey
        assert abs(rows.min() - corner[:, 1].min()) <= 1.5
        assert abs(columns.min() - corner[:, 0].min()) <= 1.5
        assert abs(columns.max() - corner[:, 0].max()) <= 1.5
    assert not coloured(both[:, :width], AFTER, within=12).any()
    png = cv2.imdecode(np.frombuffer(still(grey, own), np.uint8), cv2.IMREAD_COLOR)
    assert png is not None
    assert png.shape[1] > 2 * 760


def test_the_clip_is_h264_and_shows_every_frame_with_both_models(film: Path, tmp_path: Path) -> None:
    path, own = tmp_path / "clip.mp4", filmed()
    assert write_clip(path, Video(film), own) == 1.0
    with av.open(path) as stored:
        assert stored.streams.video[0].codec_context.name == "h264"
        frames = list(stored.decode(video=0))
    np.testing.assert_allclose([frame.time for frame in frames], TIMES, atol=1e-3)
    last = frames[-1].to_ndarray(format="bgr24")
    assert last.shape[0] % 2 == last.shape[1] % 2 == 0
    half = last.shape[1] // 2
    # 60 grey levels: colours are stored at half resolution
    assert coloured(last[60:, :half], BEFORE, within=60).sum() > 10 * coloured(last[60:, half:], BEFORE, within=60).sum()
    assert coloured(last[60:, half:], AFTER, within=60).sum() > 10 * coloured(last[60:, :half], AFTER, within=60).sum()
    assert list(tmp_path.iterdir()) == [path]


def test_a_long_film_is_shown_faster(film: Path, tmp_path: Path) -> None:
    long = filmed(time_s=TIMES * 100)
    assert write_clip(tmp_path / "clip.mp4", Video(film), long) == pytest.approx(110.0 / LONGEST_S)
    with av.open(tmp_path / "clip.mp4") as stored:
        frames = list(stored.decode(video=0))
    assert frames[-1].time == pytest.approx(LONGEST_S, abs=1e-3)


# -- in a browser ----------------------------------------------------------------------------------------------

def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def served(recording: Path) -> Iterator[tuple[int, int]]:
    """Ports of viewer and data, while the command of docs/your-own-test.md serves the recording."""
    web, data = free_port(), free_port()
    command = [str(Path(sys.executable).with_name("rerun")), str(recording), "--serve-web", "--bind", "127.0.0.1"]
    command += ["--web-viewer-port", str(web), "--port", str(data)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **quiet, start_new_session=True) as server:  # the command starts another
        try:
            for _ in range(200):
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", web)) == 0:
                        break
                time.sleep(0.05)
            yield web, data
        finally:
            os.killpg(server.pid, signal.SIGKILL)


def test_the_recording_is_served_to_this_computer_alone(served: tuple[int, int]) -> None:
    with urllib.request.urlopen(f"http://127.0.0.1:{served[0]}/", timeout=10) as page:
        assert page.status == 200
    own = [a[4][0] for a in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    for address in {str(a) for a in own} - {"127.0.0.1"}:
        for port in served:
            with socket.socket() as probe:
                probe.settimeout(2.0)
                assert probe.connect_ex((address, port)) != 0
