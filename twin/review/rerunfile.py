"""A recording that becomes a rerun file as a whole, or not at all.

rerun's own writer tells nobody that the disk is full, and may wait for ever: the file is made in memory.
"""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from twin import files


@contextmanager
def rerun_file(path: Path, views: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """The recording to log to; the file `path` holds it, with its views, when the block ends."""
    recording = rr.RecordingStream("softtwin", recording_id=uuid.uuid4())  # two files never mix in one viewer
    try:
        memory = recording.memory_recording()
        # active: in the bytes the views come after the data, for which a viewer has made its own by then
        recording.send_blueprint(views, make_active=True, make_default=True)
        yield recording
        files.write_bytes(path, memory.drain_as_bytes())
    finally:
        recording.disconnect()
