"""What every test shares: strict floating point, pictures off screen, and tools that may be absent."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")  # before anything imports matplotlib

import numpy as np
import pytest

# A division by zero, an overflow, an underflow or an invalid value fails the test that makes it.
np.seterr(all="raise")

ROOT = Path(__file__).resolve().parents[1]
HINTS = {
    "ccx": "CalculiX is not installed (apt package calculix-ccx)",
    "egl": "pyvista cannot draw off screen (apt packages libegl1 libegl-mesa0 libgl1-mesa-dri)",
}
EGL_PROBE = "import pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Sphere()); p.screenshot()"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings: $SOFTTWIN_DATA, else ../shared/data beside the checkout; else skip."""
    folder = Path(os.environ.get("SOFTTWIN_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "README.md").is_file():
        pytest.skip(f"real recordings are absent: no {folder.name}/README.md (set SOFTTWIN_DATA)")
    return folder


def _probe_egl() -> bool:
    # In a process of its own: VTK ends it by a segmentation fault where EGL is missing.
    environment = {**os.environ, "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    command = [sys.executable, "-c", EGL_PROBE]
    return subprocess.run(command, env=environment, capture_output=True, timeout=120).returncode == 0


PROBES = {"ccx": lambda: shutil.which("ccx") is not None, "egl": _probe_egl}


@pytest.fixture(scope="session")
def require() -> Callable[[str], None]:
    """`require("ccx")` or `require("egl")`: skip where it is absent, fail where SOFTTWIN_REQUIRE names it."""
    known: dict[str, bool] = {}

    def check(tool: str) -> None:
        if tool not in known:
            known[tool] = PROBES[tool]()
        if known[tool]:
            return
        if tool in os.environ.get("SOFTTWIN_REQUIRE", "").split():
            pytest.fail(f"{HINTS[tool]}, and SOFTTWIN_REQUIRE asks for it")
        pytest.skip(HINTS[tool])

    return check
