"""Two recordings in one file: everything of both is there, each below its name, and the views are named."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from twin.batches.side import VIEWS, entity, write_merged

NAMES = ("batch 07 é", "batch-08/0003-calibrate")


def recording(path: Path, value: float) -> Path:
    stream = rr.RecordingStream("softtwin")
    stream.save(path)
    stream.log("rms/calibrated", rr.SeriesLines(names="calibrated model"), static=True)
    for k in range(3):
        stream.set_time("film_time", duration=0.5 * k)
        stream.log("rms/calibrated", rr.Scalars(value + k))
        stream.log("film/frame", rr.Image(np.full((4, 6, 3), 40, np.uint8)))
    stream.log("diagnosis", rr.TextDocument(f"value {value}"), static=True)
    stream.disconnect()
    return path


def columns(path: Path, where: str, name: str) -> list[object]:
    tables = [chunk.to_record_batch() for chunk in RrdReader(str(path)).stream().filter(content=where)]
    return [x for table in tables if name in table.schema.names for x in table.column(name).to_pylist()]


@pytest.fixture
def merged(tmp_path):
    sides = {name: recording(tmp_path / f"{k}.rrd", 10.0 * k) for k, name in enumerate(NAMES)}
    write_merged(tmp_path / "both.rrd", recordings=sides)
    return tmp_path / "both.rrd"


def test_everything_of_both_is_there_below_its_name(merged):
    for k, name in enumerate(NAMES):
        assert columns(merged, entity(name, "rms/calibrated"), "Scalars:scalars") == [[10.0 * k + j] for j in range(3)]
        assert columns(merged, entity(name, "diagnosis"), "TextDocument:text") == [[f"value {10.0 * k}"]]
        assert len(columns(merged, entity(name, "film/frame"), "Image:buffer")) == 3
        named = columns(merged, entity(name, "rms/calibrated"), "SeriesLines:names")
        assert named[-1] == [f"{name}: calibrated model"]


def test_it_is_one_recording_with_its_views(merged, tmp_path):
    reader = RrdReader(str(merged))
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    tables = [chunk.to_record_batch() for chunk in reader.stream(store=reader.blueprints()[0])]
    named = [x for t in tables for n in t.schema.names if n.endswith("display_name") for x in t.column(n).to_pylist()]
    assert set(VIEWS) <= {name for names in named for name in names}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["0.rrd", "1.rrd", "both.rrd"]
