"""Writes the table of load paths and finer meshes of the short finger: python -m tests.twin.shortfinger, where
tests/twin/model/test_twin_fingertable.py says that a mesh or a law has changed."""

from benchmarks.kernel.fingertable import solved

import numpy as np

from tests.twin.conftest import COARSE, SHORT, TABLE
from twin.model.structure import of_finger

if __name__ == "__main__":
    np.savez_compressed(TABLE, **solved(of_finger(SHORT, COARSE)).arrays())
