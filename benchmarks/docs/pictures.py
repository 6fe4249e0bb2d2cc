"""Makes the pictures of docs/ that show figures: a review, what each effect does, where nodes lie.

    python benchmarks/docs/pictures.py [softtwin-demo] [--only NAME ...]

    name     picture in docs/pictures             made from
    review   review.jpg, review-<view>.jpg        review.rrd of the demo, one picture of each named view
    overlay  overlay.png                          overlay.png of the demo's measure run, made smaller
    report   report.jpg                           report.html of the demo (needs chromium)
    effects  effects/<name>.png, one an effect    a finger of three bellows on a coarse mesh, two minutes
    nodes    nodes.png                            the built-in finger
    frame    frame.png                            `twin print --frame a4` (needs poppler)
    setup    setup.jpg                            `twin setup` (needs chromium and nicegui)
    look     look.png                             `twin look` of a finger with other dimensions
    read     read.png                             `twin look` of a deck of two parts, a second
    explore  explore.png                          `twin explore` as docs/exploring.md has it, two minutes
    pareto   pareto.png                           `twin pareto` after `twin demo --quick`, two minutes
    contact  contact.png                          the built-in finger, nominal constants, on a cylinder
    protocols  protocols.png                      pressure over time in P1 to P5

The first three tell figures of the demo; `figures.py` writes those of the pages from the same project, and
its `--check` fails where a page or a picture is of another run. `review` needs a Vulkan driver; without a
graphics card Mesa's will do (Debian: apt-get install mesa-vulkan-drivers). The drawings flow.svg and
rig.svg are made by hand.
"""

import argparse
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT

import matplotlib
import matplotlib.collections

matplotlib.use("Agg")
from benchmarks.docs.figures import drawn
from benchmarks.docs.reference import edge_nodes
from benchmarks.kernel.actuatordecks import write as actuators

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import ConvexHull

from fe import Finger, Lattice, Material, finger_case, solve
from fe import Path as Course
from fe.element import triangles
from tests.browser import Browser
from twin.drawing.meshpictures import as_read
from twin.drawing.touchplot import draw_touch
from twin.effects.library import all_effects
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Test
from twin.model.objects import RigidObject
from twin.model.prediction import Model
from twin.model.structure import base_case, of_deck
from twin.review.arrangement import VIEWS
from twin.targets import Array
from twin.virtual.protocols import CORNERS, PERIOD, PROTOCOLS

TO = ROOT / "docs" / "pictures"
SHORT = Finger(
    length=10 + 100 / 3, bellows=3, tip_node=(10 + 100 / 3, 11.5, 0.0), middle_node=(4 + 50 / 3, 11.5, 0.0)
)
SIZE = 5  # typical steps of an effect's first parameter, or as much as is plausible
FIRST_OF_GRID = ("contact",)  # a table that the short finger reaches; others: the middle of their grid
BLUE, RED = "#1f6fb4", "#c0392b"
LINES = (  # name, point, component, colour, style
    ("tip U3", 0, 2, RED, "-"),
    ("tip U1", 0, 0, BLUE, "-"),
    ("middle U3", 1, 2, "#2e8b57", "--"),
)
SIDEWAYS = ("tip U2", 0, 1, "#7d3c98", ":")


# -- the demo ----------------------------------------------------------------------------------------------


MENU = 32  # px at the top of a screenshot: the viewer's own menu
SHOTS = {  # view, its picture, and where on its timeline: the last of it, or film time in s
    "test": ("review.jpg", 13.0),
    "search": ("review-search.jpg", None),
    "where it fails": ("review-where.jpg", 34.4),
    "effects": ("review-effects.jpg", None),
}


def review(demo: Path) -> None:
    """The viewer in each of its named views."""
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # rerun
    with tempfile.TemporaryDirectory() as folder:
        for view, png in screenshots(newest(demo, "review.rrd"), Path(folder)).items():
            _smaller(png, TO / SHOTS[view][0], width=1200, above=MENU)


def screenshots(rrd: Path, folder: Path, *, width: int = 1600) -> dict[str, Path]:
    """A picture of each named view of the file `rrd`, by view."""
    from rerun.experimental import ViewerClient

    made = {}
    with ViewerClient.spawn(headless=True, port=_free_port(), hide_welcome_screen=True) as viewer:
        viewer.open(str(rrd.resolve()))
        while viewer.get_state().loading:
            time.sleep(0.05)
        for view, (name, at) in SHOTS.items():
            viewer.set_blueprint(_opened(viewer.get_blueprint().blueprint, view), of="recording")
            if at is None:
                viewer.set_time(VIEWS[view], sequence=_last(rrd, VIEWS[view]), play_state="paused")
            else:
                viewer.set_time(VIEWS[view], duration=at, play_state="paused")
            time.sleep(8.0)  # the viewer does not say when the film's frame is decoded
            made[view] = folder / f"{name}.png"
            made[view].write_bytes(_shot(viewer, width))
    return made


def _shot(viewer: Any, width: int, *, tries: int = 6) -> bytes:
    """What the viewer shows; drawn without a graphics card on a busy machine, it may need several tries."""
    for _ in range(tries - 1):
        try:
            return bytes(viewer.take_screenshot(max_size=width))
        except TimeoutError:
            time.sleep(5.0)
    return bytes(viewer.take_screenshot(max_size=width))


def _opened(blueprint: dict[str, Any], view: str) -> dict[str, Any]:
    """The layout with another view opened."""
    containers = {k: x["ContainerBlueprint"] for k, x in blueprint.items() if "ContainerBlueprint" in x}
    own = next(k for k, x in containers.items() if x.get("display_name") == view)
    tabs = next(x for x in containers.values() if x["container_kind"] == "Tabs")
    tabs["active_tab"] = own.removeprefix("/")
    return blueprint


def _last(rrd: Path, timeline: str) -> int:
    """The last number of a timeline that counts."""
    from rerun.chunk import RrdReader

    chunks = RrdReader(str(rrd)).stream().filter(content="/film/frame")
    tables = [chunk.to_record_batch() for chunk in chunks]
    columns = [t.column(timeline).cast("int64") for t in tables if timeline in t.schema.names]
    return int(max(max(column.to_pylist()) for column in columns))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def overlay(demo: Path) -> None:
    """The frame of the largest motion with every marker's path and uncertainty."""
    _smaller(newest(demo, "overlay.png"), TO / "overlay.png", width=900)


def report(demo: Path) -> None:
    """The one-page report as a browser shows it."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        raise SystemExit("report: chromium is not installed; Debian: apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder:
        png = Path(folder) / "report.png"
        command = [browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1000,1560",
                   f"--screenshot={png}", newest(demo, "report.html").resolve().as_uri()]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        _smaller(png, TO / "report.jpg", width=700)


def newest(demo: Path, name: str) -> Path:
    """The newest file of that name in the runs of a project."""
    found = sorted(demo.glob(f"runs/*/{name}"))
    if not found:
        raise SystemExit(f"{demo}: no runs/*/{name} in it; run `make demo` first, or name another folder")
    return found[-1]


def _smaller(source: Path, target: Path, *, width: int, above: int = 0) -> None:
    """Write a picture at this width in px, without the rows above; the suffix tells whether without loss."""
    picture = cv2.imread(str(source))
    assert picture is not None
    picture = picture[above:]
    height = round(picture.shape[0] * width / picture.shape[1])
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    png = target.suffix == ".png"
    how = [cv2.IMWRITE_PNG_COMPRESSION, 9] if png else [cv2.IMWRITE_JPEG_QUALITY, 88]
    cv2.imwrite(str(target), small, how)


# -- effects -----------------------------------------------------------------------------------------------


def effects(demo: Path) -> None:
    """What every effect of the library does to tip and middle, and what of that a refit leaves."""
    del demo
    model, theta = _short_model()
    slopes, present = model.jacobian(theta), model.predict(theta)
    for effect in all_effects():
        change = _with(model, effect, model.named(theta)) - present
        _draw_effect(effect, model.test.path, change, after_refit(change, slopes), _largest(present))


def _with(model: Model, effect: Effect, base: dict[str, float]) -> Array:
    """Displacements (s, p, 3) mm with an effect; other parameters come from its grid, or are null."""
    grid = effect.tries(model.test)
    tried = grid[0 if effect.name in FIRST_OF_GRID else len(grid) // 2]
    null = {p.name: p.null for p in effect.parameters if p.null is not None}
    having = model.with_effect(effect)
    return having.predict(having.theta({**base, **null, **tried, effect.parameters[0].name: size_of(effect)}))


def _largest(u: Array) -> float:
    return float(np.abs(u).max())


def size_of(effect: Effect) -> float:
    """How much of an effect's first parameter is drawn."""
    first = effect.parameters[0]
    high = first.high if first.plausible is None else first.plausible[1]
    return min(SIZE * first.step, high)


def after_refit(change: Array, slopes: Array) -> Array:
    """What of a change (s, p, 3) mm is left when C10 and C01 are fitted to it; slopes (2, s, p, 3) mm/MPa."""
    a = slopes.reshape(len(slopes), -1).T
    return change - (a @ np.linalg.lstsq(a, change.ravel(), rcond=None)[0]).reshape(change.shape)


def _short_model() -> tuple[Model, Array]:
    """Two cycles with holds, weight pulling down, on a finger of three bellows; tip and middle are seen."""
    corners = np.array([(0, 0), (2, 0), (4, 18), (10, 18), (12, 30), (20, 30), (23, 0), (30, 0), (30.4, 24),
                        (34, 24), (34.4, 0), (40, 0)])  # fmt: skip
    times = np.arange(0.0, 40.01, 0.05)
    pressure = 1e-3 * np.interp(times, *corners.T)
    course = Course(times, pressure, times, gravity=np.array([0.0, 0.0, -9810.0]))
    case = finger_case(Material(0.214, 0.083), finger=SHORT, lattice=Lattice(per_bellow=4, centred=False))
    points = np.array([SHORT.tip_node, SHORT.middle_node])
    test = Test(case, course, points, np.ones(2, bool))
    return Model(test, (Elasticity(),), np.arange(10)), np.array([0.214, 0.083])


def _draw_effect(effect: Effect, course: Course, change: Array, left: Array, motion: float) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(8.0, 2.3), layout="constrained")
    first = effect.parameters[0]
    title = f"{first.name} = {size_of(effect):.2g} {first.unit}".rstrip()
    sideways = [SIDEWAYS] if _largest(change[..., 1]) > 0.3 * _largest(change) else []
    lines = [*LINES, *sideways]
    for name, point, component, colour, style in lines:
        axes[0].plot(course.output, change[:, point, component], colour, ls=style, lw=1.4, label=name)
        axes[1].plot(course.output, left[:, point, component], colour, ls=style, lw=1.4)
    _axis(axes[0], f"change by {title}", course, _largest(change), motion)
    seen = max(_largest(left), 0.02 * _largest(change))  # smaller than that, a line on the axis
    _axis(axes[1], "left when C10, C01 are refitted", course, seen, motion)
    axes[0].legend(
        fontsize=7, frameon=False, ncols=len(lines), loc="upper left", handlelength=1.5, columnspacing=1.0
    )
    figure.savefig(TO / "effects" / f"{effect.name}.png", dpi=100, metadata={"Software": None})
    plt.close(figure)


def _axis(axes: Axes, title: str, course: Course, largest: float, motion: float) -> None:
    """Title, units, the pressure as a grey ground; a scale no finer than 1e-4 of the finger's motion."""
    reach = max(1.6 * largest, 1e-4 * motion)
    pressure = np.interp(course.output, course.time, course.pressure)
    axes.fill_between(
        course.output, -reach, -reach + 2 * reach * pressure / pressure.max(), color="#eceff1", lw=0
    )
    axes.set(xlim=(0, course.output[-1]), ylim=(-reach, reach), title=title)
    axes.title.set_fontsize(9)
    axes.set_xlabel("s (grey: pressure)", fontsize=8)
    axes.set_ylabel("mm", fontsize=8)
    axes.tick_params(labelsize=7)


# -- nodes -------------------------------------------------------------------------------------------------


def nodes(demo: Path) -> None:
    """The side face of the built-in finger with the labels of nodes that a marker may show."""
    del demo
    case = finger_case(Material(0.214, 0.083))
    faces = case.surfaces["outside"]
    corners = np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)
    places = case.nodes[corners]
    seen = [_outline(face[:, [0, 2]]) for face in places[np.argsort(places[..., 1].mean(axis=1))]]
    figure, axes = plt.subplots(figsize=(10.0, 3.7), layout="constrained")
    axes.add_collection(
        matplotlib.collections.PolyCollection(seen, facecolor="#cfd8dc", edgecolor="#90a4ae", lw=0.3)
    )
    for x, label in edge_nodes():
        named = {4401: " tip", 5848: " middle"}.get(label, "")
        axes.plot(x, 0, "o", ms=3.5, color=RED if named else BLUE)
        axes.text(
            x,
            -1.5,
            f"{label}{named}",
            rotation=90,
            ha="center",
            va="top",
            fontsize=8,
            color=RED if named else "k",
        )
    axes.set(xlim=(-3, 114), ylim=(-15, 24), xlabel="x, mm from the clamp", ylabel="z, mm", aspect="equal")
    figure.savefig(TO / "nodes.png", dpi=110, metadata={"Software": None})
    plt.close(figure)


def protocols(demo: Path) -> None:
    """Pressure over time in the protocols of the virtual laboratory, those of one course together."""
    del demo
    figure, axes = plt.subplots(figsize=(9.0, 2.5), layout="constrained")
    shown = (("P5", "P4 and P5", "#b0bec5", 1.5), ("P3", "P3", BLUE, 1.5), ("P1", "P1 and P2", "k", 3.0))
    for name, label, colour, width in shown:
        course = PROTOCOLS[name].course
        axes.plot(course.time, 1e3 * course.pressure, color=colour, lw=width, label=label)
    for number, way in enumerate(("upright", "upside down", "hanging")):
        axes.text(PERIOD * number + 0.5 * CORNERS[-1][0], 32.0, way, ha="center")
    axes.set(xlabel="time, s", ylabel="pressure, kPa", ylim=(-1, 37))
    figure.legend(loc="outside right center")
    figure.savefig(TO / "protocols.png", dpi=110, metadata={"Software": None})
    plt.close(figure)


def look(demo: Path) -> None:
    """What `twin look` draws of the finger of docs/your-own-test.md."""
    del demo
    text = (TO.parent / "your-own-test.md").read_text(encoding="utf-8")
    pieces = [p.partition("```")[0] for p in text.split("```toml\n")[1:]]
    own = next(p for p in pieces if "[model.finger]" in p)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "my-finger"
        root.mkdir()
        chosen = '\n[project]\nname = "my-finger"\n[calibrate]\nobjective_points = ["tip"]\n'
        (root / "twin.toml").write_text(own + chosen, encoding="utf-8")
        subprocess.run(
            [sys.executable, "-c", "from twin.cli import main; main()", "look", "-p", str(root)], check=True
        )
        _smaller(newest(root, "finger.png"), TO / "look.png", width=850)


def frame(demo: Path) -> None:
    """The sheet of `twin print --frame a4`."""
    del demo
    twin = [sys.executable, "-c", "from twin.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "my-batch"
        subprocess.run([*twin, "init", str(root)], check=True)
        subprocess.run([*twin, "print", "--frame", "a4", "-p", str(root)], check=True)
        sheet, drawn_to = newest(root, "frame.pdf"), str(TO / "frame")
        subprocess.run(["pdftoppm", "-r", "72", "-png", "-gray", "-singlefile", sheet, drawn_to], check=True)


def setup(demo: Path) -> None:
    """The page of `twin setup`, once its check has run."""
    del demo
    twin = [sys.executable, "-c", "from twin.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        root, port = Path(folder) / "my-batch", str(_free_port())
        shutil.copytree(ROOT / "datasets" / "quick", root)
        command = [*twin, "setup", str(root), "--port", port]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            while "Open http" not in (line := server.stdout.readline()):
                assert line, "the page is not served"
            with Browser(Path(folder) / "profile", width=1400, height=1160) as browser:
                browser.open(f"http://127.0.0.1:{port}")
                browser.until("Once it is written")
                picture = cv2.cvtColor(browser.photograph(), cv2.COLOR_RGB2BGR)
        finally:
            server.send_signal(signal.SIGINT)
            server.communicate(timeout=60)
        cv2.imwrite(str(TO / "setup.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 80])


def contact(demo: Path) -> None:
    """What `twin predict --object` draws, but for the interval, of the built-in finger with nominal
    constants."""
    del demo
    thing, top = RigidObject.of("cylinder:d=40,x=70,z=-30"), 0.03
    case = thing.beside(base_case())
    found = solve(case, Course(np.array([0.0, 1.0]), np.array([0.0, top]), np.linspace(0.0, 1.0, 13)))
    picture = draw_touch(
        np.linspace(0.0, 1e3 * top, 13), np.linalg.norm(found.contact_force, axis=1), None,
        label="pressure, kPa", nodes=case.nodes, u=found.fields([12])[0],
        triangles=triangles(case.face_nodes("outside")), obstacle=thing.shape, given_way=np.zeros(3),
    )  # fmt: skip
    (TO / "contact.png").write_bytes(picture)


def read(demo: Path) -> None:
    """What `twin look` draws of a deck of two tied parts."""
    del demo
    with tempfile.TemporaryDirectory() as folder:
        deck = actuators(Path(folder))["twolayers"]
        case = of_deck(deck, silicone=("upper-1.body",)).case
        whole = Path(folder) / "read.png"
        whole.write_bytes(as_read(case, title=f"raw/{deck.name}: what the model takes from it"))
        _smaller(whole, TO / "read.png", width=850)


def explore(demo: Path) -> None:
    """What `twin explore` of docs/exploring.md draws."""
    del demo
    text = (TO.parent / "exploring.md").read_text(encoding="utf-8")
    command = text.partition("cd my-finger\ntwin ")[2].partition("```")[0].replace("\\\n", " ").split()
    twin = [sys.executable, "-c", "from twin.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "my-finger"
        subprocess.run([*twin, "init", str(root)], check=True)
        subprocess.run([*twin, *command, "-p", str(root)], check=True)
        _smaller(newest(root, "explore-effects.png"), TO / "explore.png", width=1000)


def pareto(demo: Path) -> None:
    """What `twin pareto` draws of the quick demo."""
    del demo
    twin = [sys.executable, "-c", "from twin.cli import main; main()"]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "softtwin-quick"
        subprocess.run([*twin, "demo", "--quick", str(root)], check=True)
        subprocess.run([*twin, "pareto", "-p", str(root)], check=True)
        _smaller(newest(root, "pareto.png"), TO / "pareto.png", width=850)


def _outline(points: Array) -> Array:
    """The convex outline (k, 2) of a face's nodes; of a face seen on edge its two ends."""
    if np.linalg.matrix_rank(points - points[0], tol=1e-6) < 2:
        return np.array([points.min(axis=0), points.max(axis=0)])
    return points[ConvexHull(points).vertices]


PICTURES: dict[str, Callable[[Path], None]] = {
    "review": review, "overlay": overlay, "report": report, "effects": effects, "nodes": nodes,
    "look": look, "read": read, "explore": explore, "pareto": pareto, "protocols": protocols,
    "contact": contact, "frame": frame, "setup": setup,
}  # fmt: skip


def main() -> None:
    arguments = argparse.ArgumentParser(description="Make the pictures of docs/ that show figures.")
    arguments.add_argument(
        "demo", type=Path, nargs="?", default=Path("softtwin-demo"), help="project that the demo made"
    )
    arguments.add_argument("--only", nargs="+", choices=list(PICTURES), default=list(PICTURES))
    given = arguments.parse_args()
    (TO / "effects").mkdir(parents=True, exist_ok=True)
    for name in given.only:
        PICTURES[name](given.demo)
        drawn(given.demo, name)
        print(f"{name}: made")


if __name__ == "__main__":
    main()
