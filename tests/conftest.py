"""What every test shares: strict floating point, pictures off screen, and tools that may be absent."""

import gc
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")  # before anything imports matplotlib
# One thread each, as `twin` has: two workers share the machine, and a child must add in the order of its parent.
os.environ.setdefault("OMP_NUM_THREADS", "1")  # before anything imports numpy
os.environ.setdefault("MKL_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

# A division by zero, an overflow, an underflow or an invalid value fails the test that makes it.
np.seterr(all="raise")

ROOT = Path(__file__).resolve().parents[1]
HINTS = {
    "chromium": "Chromium is not installed (apt package chromium)",
    "nicegui": "NiceGUI is not installed (pip install nicegui)",
    "ccx": "CalculiX is not installed (apt package calculix-ccx)",
    "pdftotext": "poppler is not installed (apt package poppler-utils)",
    "pdftoppm": "poppler is not installed (apt package poppler-utils)",
    "egl": "pyvista cannot draw off screen (apt packages libegl1 libegl-mesa0 libgl1-mesa-dri)",
}
COMPILING = pytest.StashKey["subprocess.Popen[bytes]"]()
EGL_PROBE = "import pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Sphere()); p.screenshot()"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the element loops once, while the workers look for tests: each would compile them all."""
    if getattr(session.config.option, "numprocesses", None) and not hasattr(session.config, "workerinput"):
        session.config.stash[COMPILING] = subprocess.Popen([sys.executable, "-m", "tests.compile_loops"], cwd=ROOT)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any) -> None:
    """No test begins before the loops are compiled."""
    assert node.config.stash[COMPILING].wait() == 0, "tests.compile_loops failed"


# Files of more than 12 s of processor, longest first: begun last, one alone would keep one worker busy.
LONGEST = ("predict_fast", "setup", "sensitivity", "chain", "contract", "timesteps", "standins", "diagnose",
           "engine_chain", "material", "refitting", "faults", "nearfit", "verdicts", "recalibrate", "chambers",
           "decks", "standoffs", "reduced", "shape", "mistakes", "effects", "pick", "gravity", "adjoint", "weight",
           "two_cameras", "other_law", "felupe")  # fmt: skip


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; the workers take the files in this order (--no-loadscope-reorder)."""
    rank = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem.split("_", 2)[-1], len(rank)))
    gc.freeze()  # what is loaded stays: the collector need not look through half a million objects again


@pytest.fixture(scope="session", autouse=True)
def own_settings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of settings of the tests' own: what they trust, no user of this computer does."""
    folder = tmp_path_factory.mktemp("settings")
    os.environ["XDG_CONFIG_HOME"] = str(folder)  # for child processes, too
    return folder


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


PROBES = {
    "chromium": lambda: shutil.which("chromium") is not None,
    "nicegui": lambda: find_spec("nicegui") is not None,
    "ccx": lambda: shutil.which("ccx") is not None,
    "pdftoppm": lambda: shutil.which("pdftoppm") is not None,
    "pdftotext": lambda: shutil.which("pdftotext") is not None,
    "egl": _probe_egl,
}


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


# -- a deck that no code of the project has made -----------------------------------------------------------
# Node orders and faces as the Abaqus Analysis User's Guide draws them ("Three-dimensional solid element
# library"), in half steps of a cell along x, y, z.
HEX = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
       (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
       (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]  # fmt: skip
HEX_FACES = {"S1": "1234", "S2": "5876", "S3": "1562", "S4": "2673", "S5": "3784", "S6": "4851"}
TET_FACES = {"S1": "123", "S2": "142", "S3": "243", "S4": "341"}
# Six tetrahedra around the diagonal from corner 1 to 7, by the hexahedron's corners.
SIX = ["1237", "1347", "1487", "1857", "1567", "1627"]
HEAD = """\
*Heading
 a tube in half, clamped at x = 0, thicker below: it bends to -z
** made by hand
*PART, NAME=Tube
*Include, input=mesh.inc
*Solid section, elset="All of it", material=Ecoflex
,
*End Part
*Assembly, name=Assembly
*Instance, name=Tube-1, part=Tube
*End Instance
*Nset, nset=Root, instance=Tube-1
 Tube-1.ROOT
"""
TAIL = """\
*End Assembly
*Material, name=ECOFLEX
*hyperelastic, mooney-rivlin
 0.18D0, 0.06, 0.005
*Boundary
Root, 1, 3
Middle plane, YSYMM
*Step, name=Inflation,
 nlgeom, inc=500
*STATIC
0.05, 1., 1e-06, 0.1
*Dsload
Tube-1.Chamber, P, {pressure}
*Output, field, variable=PRESELECT
*End step
"""


def write_tube(folder: Path, kind: str, *, pressure: float = 0.08, cells: int = 10) -> Path:
    """`tube.inp` and `mesh.inc` in a folder: a half tube 50 mm long of elements `kind`, with a round bend in
    its walls; node 70001 is the lower edge of its tip, 70002 a third of the way back."""
    x = np.concatenate([[0], np.linspace(4, 45, cells - 1), [50]])
    y, z = np.array([0, 2, 3, 4]), np.array([0, 4, 5, 6, 7])
    grid = [np.interp(np.arange(2 * len(v) - 1) / 2, np.arange(len(v)), v) for v in (x, y, z)]
    tets, corners_only = kind.startswith(("C3D10", "C3D4")), kind.startswith(("C3D8", "C3D4"))
    elements, void = [], set()
    for i, j, k in np.ndindex(len(x) - 1, 3, 4):
        if 0 < i < len(x) - 2 and j < 2 and 0 < k < 3:
            void.add((i, j, k))
            continue
        at = [(2 * i + a, 2 * j + b, 2 * k + c) for a, b, c in HEX]
        if not tets:
            elements.append(at[:8] if corners_only else at)
            continue
        for four in SIX:
            c = [np.array(at[int(n) - 1]) for n in four]
            middles = [(c[a] + c[b]) // 2 for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
            elements.append([tuple(int(v) for v in p) for p in (c if corners_only else (*c, *middles))])
    used = sorted({p for e in elements for p in e})
    label = {p: 11 + 3 * n for n, p in enumerate(used)}  # with gaps
    last = 2 * (len(x) - 1), 6, 0
    label[last], label[(2 * round((len(x) - 1) * 2 / 3), 6, 0)] = 70001, 70002
    text = ["*NODE, nset=Everything"]
    for p in used:
        px, py, pz = (g[n] for g, n in zip(grid, p))
        bulge = 0.6 * np.sin(np.pi * px / 50) ** 2 * pz / 7  # curved faces, but for the flat bottom
        text.append(f"{label[p]:8d}, {px:.7f}, {py * (1 + 0.1 * bulge):.7f}, {pz + bulge:.7f}")
    text.append(f"*Element, type={kind.lower()}, elset=Body")
    for n, e in enumerate(elements):
        row = [str(501 + n), *(str(label[p]) for p in e)]
        text += [", ".join(row[:11]) + ",", ", ".join(row[11:])] if len(row) > 11 else [", ".join(row)]
    text += ["*Elset, elset=\"All of it\", generate", f"501, {500 + len(elements)}, 1"]
    sets = {"ROOT": [label[p] for p in used if p[0] == 0], "Middle plane": [label[p] for p in used if p[1] == 0]}
    for name, members in sets.items():
        text += [f"*NSET, Nset={name}"] + [", ".join(map(str, members[m : m + 9])) for m in range(0, len(members), 9)]
    faces = TET_FACES if tets else HEX_FACES
    inner = {(2 * i + a, 2 * j + b, 2 * k + c) for i, j, k in void for a, b, c in HEX}
    plane = {p for p in inner if p[1] == 0}
    surface = []
    for name, digits in faces.items():
        own = [501 + n for n, e in enumerate(elements)
               if (on := {e[int(d) - 1] for d in digits}) <= inner and not on <= plane]  # fmt: skip
        if own:
            text += [f"*Elset, elset=_Chamber_{name}, internal", *(f" {n}," for n in own)]
            surface.append(f"_Chamber_{name}, {name}")
    text += ["*Surface, type=ELEMENT, name=Chamber", *surface]
    (folder / "mesh.inc").write_text("\n".join(text) + "\n")
    deck = folder / "tube.inp"
    deck.write_text(HEAD + TAIL.format(pressure=pressure))
    return deck


@pytest.fixture(scope="session")
def tube_deck() -> Callable[..., Path]:
    """`tube_deck(folder, kind, pressure=, cells=)`: see `write_tube`."""
    return write_tube
