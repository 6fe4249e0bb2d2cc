"""The rerun file read back: mesh and film frame for every generation, on both timelines, with its layout."""

import os
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from tests.messages import saying
from twin.review.recording import encode_av1, write_review
from twin.review.scene import RAMP, colours
from twin.review.states import Fields, Generations

Array = NDArray[np.float64]
FRAMES, TOP = 12, 5
# Uneven time stamps, as cameras write them: the copy for review must keep them.
TICKS = np.cumsum([0, 100, 100, 130, 70, 100, 100, 100, 200, 100, 100, 100])
TIMES = TICKS / 1000.0
BOX = np.array([[x, y, z] for x in (0.0, 100.0) for y in (-10.0, 10.0) for z in (0.0, 20.0)])
SIDES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]])
MARKERS = np.array([[50.0, 10.0, 0.0], [100.0, 10.0, 0.0], [20.0, 10.0, 0.0]])


def bent(points: Array, fall: float) -> Array:
    """Displacement of points (n,3) mm that fall by `fall` mm at x = 100."""
    return np.stack([np.zeros(len(points)), np.zeros(len(points)), -fall * (points[:, 0] / 100) ** 2], axis=1)


def history(generations: int = 4) -> Generations:
    falls = 58.0 + 8.0 / np.arange(1, generations + 1)
    measured = bent(MARKERS, 58.0)
    measured[:, 1] = np.nan  # one camera does not see U2
    measured[2] = np.nan  # lost
    nodes = np.vstack([BOX, [[50.0, 0.0, 10.0]]])  # the last node is inside: no triangle has it
    return Generations(
        generation=np.arange(1, generations + 1),
        names=("C10", "creep: g 1"),  # a name is free text
        best=np.stack([0.2 + 0.1 / falls, 0.08 + 0.1 / falls], axis=1),
        rms_mm=falls - 58.0,
        nodes=nodes,
        triangles=SIDES,
        u=np.stack([bent(nodes, fall) for fall in falls]).astype(np.float32),
        point_names=("5848", "4401", "m3"),
        points=MARKERS,
        u_points=np.stack([bent(MARKERS, fall) for fall in falls]),
        u_measured=measured,
        film_time_s=float(TIMES[TOP]),
        film_frame=TOP,
    )


def along_film(generations: Generations, *, times: Array) -> Fields:
    falls = 58.0 * np.sin(np.linspace(0.1, 3.0, len(times)))
    measured = np.stack([bent(MARKERS, fall + 0.1) for fall in falls])
    measured[1, :] = np.nan  # a step at which nothing was seen
    return Fields(
        time_s=times,
        pressure=0.03 * falls / 58.0,
        u=np.stack([bent(generations.nodes, fall) for fall in falls]).astype(np.float32),
        u_points=np.stack([bent(MARKERS, fall) for fall in falls]),
        u_measured=measured,
    )


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "test.mp4"
    with av.open(path, "w") as target:
        stream = target.add_stream("libx264", rate=10, options={"crf": "18", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for number, tick in enumerate(TICKS):
            picture = np.full((96, 128), 60, dtype=np.uint8)
            picture[20:40, 8 * number : 8 * number + 20] = 220
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = int(tick), Fraction(1, 1000)
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    return path


def rows(path: Path, entity: str, column: str, timeline: str) -> dict[int, list[object]]:
    """What a file logs for `entity`: {value of the timeline (durations in ns): content of column}."""
    found: dict[int, list[object]] = {}
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = chunk.to_record_batch()
        if {timeline, column} <= set(table.schema.names):
            times = table.column(timeline).cast("int64").to_pylist()
            found.update(zip(times, table.column(column).to_pylist()))
    return found


FRAME = ("/film/frame", "VideoFrameReference:timestamp")
MESH = ("/model/mesh", "Mesh3D:vertex_positions")


def test_every_generation_shows_its_mesh_and_the_frame_at_top_pressure(film: Path, tmp_path: Path) -> None:
    data = history()
    path = tmp_path / "review.rrd"
    notes = write_review(
        path,
        film=film,
        frame_times_s=TIMES,
        generations=data,
        fields=along_film(data, times=TIMES),
        diagnosis_markdown="## creep",
        comparison=[{"marker": "4401", "rms_mm": 0.21}],
    )
    assert notes == []
    mesh, frame = rows(path, *MESH, "generation"), rows(path, *FRAME, "generation")
    assert list(mesh) == list(frame) == [1, 2, 3, 4]
    # 0.1 ms: time stamps pass through the ticks of a container, at most 1/15360 s.
    assert all(abs(stamp[0] * 1e-9 - TIMES[TOP]) < 1e-4 for stamp in frame.values())
    for number, state in enumerate(mesh.values()):
        # float32 of places up to 100 mm
        np.testing.assert_allclose(state, data.nodes[:8] + data.u[number][:8], atol=1e-4)


def test_curves_over_the_generations_are_those_given(tmp_path: Path) -> None:
    data, path = history(), tmp_path / "review.rrd"
    none = np.zeros(0)
    write_review(path, film=None, frame_times_s=none, generations=data, fields=None, diagnosis_markdown="")
    for entity, wanted in (
        ("/rms/best", data.rms_mm),
        ("/parameters/C10", data.best[:, 0]),
        (r"/parameters/creep\:\ g\ 1", data.best[:, 1]),
    ):
        found = rows(path, entity, "Scalars:scalars", "generation")
        np.testing.assert_array_equal([value[0] for value in found.values()], wanted, err_msg=entity)


def test_along_the_film_each_frame_and_the_model_are_shown(film: Path, tmp_path: Path) -> None:
    data = history()
    path = tmp_path / "review.rrd"
    fields = along_film(data, times=TIMES[::2])
    write_review(
        path, film=film, frame_times_s=TIMES, generations=data, fields=fields, diagnosis_markdown="creep"
    )
    frame, mesh = rows(path, *FRAME, "film_time"), rows(path, *MESH, "film_time")
    np.testing.assert_allclose(np.array(list(frame)) * 1e-9, TIMES, atol=1e-6)
    np.testing.assert_allclose([stamp[0] * 1e-9 for stamp in frame.values()], TIMES, atol=1e-4)
    np.testing.assert_allclose(np.array(list(mesh)) * 1e-9, TIMES[::2], atol=1e-6)
    rms = rows(path, "/rms/calibrated", "Scalars:scalars", "film_time")
    # 0.1 mm too low at the tip: (1, 1/4, 1/25) of it at the three markers, seen in U1 (right), U2 and U3.
    first, second = list(rms.values())[:2]
    assert first[0] == pytest.approx(0.1 * np.sqrt((1 + 1 / 16 + 0.04**2) / 9), rel=1e-6)
    assert np.isnan(second[0])


def test_layout_and_text_travel_in_the_file_and_ids_are_fresh(film: Path, tmp_path: Path) -> None:
    paths = [tmp_path / "a.rrd", tmp_path / "b.rrd"]
    for path in paths:
        write_review(
            path,
            film=film,
            frame_times_s=TIMES,
            generations=history(),
            fields=None,
            diagnosis_markdown="creep",
            comparison=[{"marker": "4401", "rms_mm": 0.21}],
            pictures={"error": b"\x89PNG one", "evidence": b"\x89PNG two"},
        )
    readers = [RrdReader(str(path)) for path in paths]
    assert all(len(reader.blueprints()) == 1 for reader in readers)
    assert len({str(reader.recordings()[0].recording_id) for reader in readers}) == 2
    chunks = [chunk.to_record_batch() for chunk in readers[0].stream().filter(content="/diagnosis")]
    text = chunks[0].column("TextDocument:text").to_pylist()[0][0]
    assert text.startswith("creep\n\n| marker | rms_mm |")
    assert "| 4401 | 0.21 |" in text
    for number, data in enumerate((b"\x89PNG one", b"\x89PNG two")):
        chunks = [c.to_record_batch() for c in readers[0].stream().filter(content=f"/pictures/{number}")]
        blob = next(c.column("EncodedImage:blob") for c in chunks if "EncodedImage:blob" in c.schema.names)
        assert bytes(blob.to_pylist()[0][0]) == data
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rrd", "b.rrd"]


def test_markers_that_were_not_seen_have_no_arrow(film: Path, tmp_path: Path) -> None:
    path = tmp_path / "review.rrd"
    data = history()
    write_review(
        path, film=film, frame_times_s=TIMES, generations=data, fields=None, diagnosis_markdown="creep"
    )
    arrows = rows(path, "/model/error", "Arrows3D:vectors", "generation")
    errors = np.array(list(arrows.values()))
    assert errors.shape == (4, 2, 3)
    # Measured - model: the tip fell 58 mm, the first generation 66; x1, as 8 mm is large in this scene.
    np.testing.assert_allclose(errors[0, 1], [0.0, 0.0, 8.0], atol=1e-4)
    dots = rows(path, "/model/measured", "Points3D:positions", "generation")
    np.testing.assert_allclose(dots[4][1], [100.0, 10.0, -58.0], atol=1e-4)


def test_without_film_and_model_the_rest_is_shown_on_both_timelines(tmp_path: Path) -> None:
    path = tmp_path / "review.rrd"
    notes = write_review(
        path,
        film=None,
        frame_times_s=np.zeros(0),
        generations=history(),
        fields=None,
        diagnosis_markdown="none needed",
    )
    assert [note.split(":")[0] for note in notes] == ["no film in this project"]
    assert len(rows(path, *MESH, "generation")) == 4
    assert len(rows(path, *MESH, "film_time")) == 1
    assert rows(path, *FRAME, "generation") == {}


def test_a_frame_beyond_the_film_is_refused_and_nothing_is_left(film: Path, tmp_path: Path) -> None:
    data = history()
    late = Generations(**{**vars(data), "film_frame": FRAMES})
    with pytest.raises(ValueError, match=r"first frame at top pressure is 12, but .* has 12 frames"):
        write_review(
            tmp_path / "review.rrd",
            film=film,
            frame_times_s=TIMES,
            generations=late,
            fields=None,
            diagnosis_markdown="",
        )
    assert list(tmp_path.iterdir()) == []


def test_times_that_do_not_fit_the_film_give_a_note(film: Path, tmp_path: Path) -> None:
    path = tmp_path / "review.rrd"
    notes = write_review(
        path,
        film=film,
        frame_times_s=TIMES[:-1],
        generations=history(),
        fields=None,
        diagnosis_markdown="creep",
    )
    assert any("12 frames but 11 times" in note for note in notes)
    np.testing.assert_allclose(np.array(list(rows(path, *FRAME, "film_time"))) * 1e-9, TIMES, atol=1e-4)


def test_the_copy_for_review_keeps_pictures_and_time_stamps(film: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mp4"
    before = os.sched_getscheduler(0)
    copy.write_bytes(encode_av1(film))
    threads = map(int, os.listdir("/proc/self/task"))
    assert {os.sched_getscheduler(thread) for thread in threads} == {before}  # root would be left real-time
    with av.open(copy) as stored:
        frames = list(stored.decode(video=0))
        assert stored.streams.video[0].codec_context.name in {"libdav1d", "av1"}
    np.testing.assert_allclose([frame.time for frame in frames], TIMES, atol=1e-4)
    # 8 grey: review quality; a swapped frame differs by 160 in the moving square.
    for number, frame in enumerate(frames):
        picture = frame.to_ndarray(format="gray")
        assert abs(float(picture[24:36, 8 * number + 4 : 8 * number + 16].mean()) - 220.0) < 8.0


def test_colours_run_from_end_to_end_and_stay_there() -> None:
    shades = colours(np.array([-1.0, 0.0, 60.0, 90.0]), top=60.0)
    assert (shades[[0, 1]] == RAMP[0]).all()
    assert (shades[[2, 3]] == RAMP[-1]).all()


def test_histories_come_back_equal_and_hold_no_pickle(tmp_path: Path) -> None:
    data = history()
    fields = along_film(data, times=TIMES)
    for stored, name in ((data, "generations.npz"), (fields, "fields.npz")):
        stored.save(tmp_path / name)
        again = type(stored).load(tmp_path / name)
        assert all(
            np.array_equal(value, vars(again)[key], equal_nan=not key.endswith("names"))
            for key, value in vars(stored).items()
        )
        assert type(again) is type(stored)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fields.npz", "generations.npz"]
    with pytest.raises(ValueError, match=saying("fields.npz", "'generation'")):
        Generations.load(tmp_path / "fields.npz")


def test_a_pickle_inside_a_history_is_not_read(tmp_path: Path) -> None:
    stored = {**vars(along_film(history(), times=TIMES)), "pressure": np.array([{}, None], dtype=object)}
    np.savez(tmp_path / "fields.npz", **stored)
    with pytest.raises(ValueError, match=saying("fields.npz", "pressure.npy")):
        Fields.load(tmp_path / "fields.npz")


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [("names", np.zeros(2), r"wanted tuple\[str"), ("u", np.array(["x"]), "an array holds <U1"), ("film_time_s", np.zeros(3), "wanted <class 'float'>"),
     ("u", np.zeros((3, 9, 3)), r"Generations\.u has shape"), ("generation", np.array(1), "an array holds")],
)  # fmt: skip
def test_a_history_with_an_array_of_another_kind_names_the_file(tmp_path: Path, name: str, value: np.ndarray, why: str) -> None:
    np.savez(tmp_path / "generations.npz", **{**vars(history()), name: value})
    with pytest.raises(ValueError, match=rf"generations\.npz: .*{why}.*; remove it and run its stage again"):
        Generations.load(tmp_path / "generations.npz")


def test_arrays_that_do_not_fit_each_other_are_refused() -> None:
    data = vars(history())
    with pytest.raises(ValueError, match=saying("Generations.u", r"\(3, 9, 3\)", r"\(4, 9, 3\)")):
        Generations(**{**data, "u": data["u"][:3]})
    with pytest.raises(ValueError, match="names node 9, but there are 9 nodes"):
        Generations(**{**data, "triangles": SIDES + 2})
