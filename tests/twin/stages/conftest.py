"""What the tests of the stages share."""

from collections.abc import Iterator

import pytest

from twin.stages import caches, diagnosing


@pytest.fixture(scope="session")
def one_process() -> Iterator[None]:
    """All work in this process: on a finger so small, starting others costs more than they save."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(caches, "WORKERS", 1)
        patch.setattr(diagnosing, "WORKERS", 1)
        yield
