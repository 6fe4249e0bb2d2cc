"""Machine code that is kept on the disk belongs to the law as it stands now."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fe

# W of one element of one node at u = (0.1, 0, 0) mm: F is stretched by 1.1 along x, and the law has C10 alone.
ENERGY = """
import numpy as np
from fe.kernel.compiled import MeshArrays, energies
G = np.array([1.0, 0.0, 0.0]).reshape(1, 1, 3, 1)
one = np.ones((1, 1))
mesh = MeshArrays(G, np.empty((0, 1, 3, 3)), one, one.reshape(1, 1, 1), np.zeros((1, 1), np.int64))
W = np.empty((1, 1))
energies(mesh, np.array([[0.1, 0.0, 0.0]]), np.array([[0.2, 0, 0, 0, 0, 0, 0, 0.0]]), 0, 1, W)
print(W[0, 0])
"""


def energy_in(folder: Path, code: str = ENERGY) -> float:
    """What the loops of a copy of `fe` give, in a process of its own."""
    command, environment = [sys.executable, "-c", code], {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


@pytest.mark.slow
def test_a_law_that_has_changed_is_compiled_anew(tmp_path: Path) -> None:
    shutil.copytree(Path(fe.__file__).parent, tmp_path / "fe", ignore=shutil.ignore_patterns("__pycache__"))
    before = energy_in(tmp_path)
    law = tmp_path / "fe" / "terms.py"
    text = law.read_text()
    assert text.count("W = (c[C10] + ") == 1
    law.write_text(text.replace("W = (c[C10] + ", "W = (2.0 * c[C10] + "))
    assert energy_in(tmp_path) == 2 * before != 0.0


@pytest.mark.slow
def test_what_was_kept_may_name_a_class_that_is_no_more(tmp_path: Path) -> None:
    shutil.copytree(Path(fe.__file__).parent, tmp_path / "fe", ignore=shutil.ignore_patterns("__pycache__"))
    before = energy_in(tmp_path)
    named = [p for p in (tmp_path / "fe").rglob("*.py") if "MeshArrays" in p.read_text()]
    assert named
    for path in named:
        path.write_text(path.read_text().replace("MeshArrays", "MeshRecord"))
    assert energy_in(tmp_path, ENERGY.replace("MeshArrays", "MeshRecord")) == before
