"""Mistakes of strangers in files of other programs, in decks and in tests of the silicone: more for `mistakes`.

Each function below writes files into a folder and puts them through the commands that read them first: a table of
displacements and a tester's file through `twin init`, `check` and `measure`, a deck through `twin init`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fe import Material
from fe.homogeneous import nominal_stress
from twin import files
from twin.commands.check import run_check
from twin.commands.init import run_init
from twin.commands.measure import run_measure
from twin.messages import Say
from twin.project.folder import Project
from twin.project.toml import with_key
from twin.targets import Array

Try = Callable[[Path, Say], object]
Place = Callable[[Array], Array]
Stage = Callable[[Project, Say], object]

# -- displacements -------------------------------------------------------------------------------------------
TIME = np.arange(0.0, 12.0, 0.1)
PRESSURE = np.interp(TIME, [0, 3, 6, 8, 11, 12], [0, 0, 30, 30, 0, 0])  # kPa
LOST = slice(80, 90)
LOG_TIME = np.arange(-8.0, 24.0, 0.05)
FACTS = {"sd_mm": 0.02, "log": "raw/log.csv"}


def places() -> Array:
    """Places (s,2,3) mm of tip and middle, with a noise of 0.02 mm."""
    rest = np.array([[110.0, 0.0, 50.0], [60.0, 0.0, 50.0]])
    u = PRESSURE[:, None, None] * np.array([[-0.4, 0.0, -1.6], [-0.1, 0.0, -0.5]])
    return np.asarray(rest + u + 0.02 * np.random.default_rng(0).standard_normal(u.shape) * [1, 0, 1])


def log(head: str = "time_s,p [kPa]", *, late: float = 0.0) -> str:
    """The log of the pressure, kPa."""
    p = np.interp(LOG_TIME - late, TIME, PRESSURE)
    return head + "\n" + "".join(f"{t:.2f},{v:.4f}\n" for t, v in zip(LOG_TIME, p, strict=True))


def points(place: Array, *, lost: str | None = None, axes: str = "xz", unit: str = "mm") -> str:
    """The table of places; lost: how the tip is written where it was lost."""
    rows = [["time_s", *(f"{name}_{axis}_{unit}" for name in ("tip", "middle") for axis in axes)]]
    for k, t in enumerate(TIME):
        cells = [f"{v:.4f}" for v in place[k][:, [0, 2]].ravel()]
        if lost is not None and k in range(80, 90):
            cells[:2] = [lost] * 2
        rows.append([f"{t:.1f}", *cells])
    return "\n".join(",".join(row) for row in rows) + "\n"


def measured(
    name: str, text: str, course: str, keys: dict[str, Any], *, stages: Sequence[Stage] = (run_check, run_measure)
) -> Try:
    """Targets of a file, or of a folder `name` with the files of `text` parted by a line ==NAME."""

    def do(folder: Path, say: Say) -> None:
        source = folder / name
        for part in text.split("==")[1:] if "==" in text else [f"\n{text}"]:
            file, _, own = part.partition("\n")
            files.write_text(source / file if file else source, own)
        run_init(folder / "p", say, targets=source, nodes=["s0=4401"] if source.is_dir() else ())
        toml = folder / "p" / "twin.toml"
        own_keys = {**FACTS, **keys}
        changed = toml.read_text(encoding="utf-8")
        for key, value in own_keys.items():
            changed = changed if value is None else with_key(changed, "import", key, value)
        files.write_text(toml, changed)
        files.write_text(folder / "p" / "raw" / "log.csv", course)
        for stage in stages:
            stage(Project.open(folder / "p"), say)

    return do


def table(change: Place = lambda place: place, *, course: str = "", **how: Any) -> Try:
    """Targets of the table of changed places; how: of `points`, and keys of [import]."""
    of_points = {key: how.pop(key) for key in ("lost", "axes", "unit") if key in how}
    return measured("points.csv", points(change(places()), **of_points), course or log(), how)


def exchanged(place: Array) -> Array:
    place[50:60] = place[50:60, ::-1]
    return place


def held(place: Array, at: int = 40) -> Array:
    place[40:55, 0] = place[at, 0]
    return place


def jumped(place: Array) -> Array:
    place[50:60, 0] += 8.0
    return place


def upwards(place: Array) -> Array:
    return np.asarray(2 * place[:1] - place)


def dice(numbers: list[int], *, course: str = "") -> Try:
    """Targets of a folder of DICe whose files have these numbers, of pictures taken 20 a second."""
    head = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA\n"
    time = np.array(numbers) / 20.0
    z = -1.6 * np.interp(time, TIME, PRESSURE)
    text = "".join(
        f"==DICe_solution_{n:03d}.txt\n{head}0,550,250,{2 * u:.3f},{-5 * u:.3f},0.005\n"
        for n, u in zip(numbers, z, strict=True)
    )
    return measured("dice", text, course or log(), {"mm_per_px": 0.2, "fps": 20.0, "scale_sd": 0.001})


# -- decks ---------------------------------------------------------------------------------------------------
DECK = Path(__file__).resolve().parents[1] / "corpora" / "deck"
LAW = "*hyperelastic, mooney-rivlin\n 0.18D0, 0.06, 0.005"
LOAD = "*Dsload\nTube-1.Chamber, P, 0.08"
HEAD = "*Boundary\nRoot, 1, 3"


def deck(*changes: tuple[str, str]) -> Try:
    """A project of a tube's deck with texts replaced."""

    def do(folder: Path, say: Say) -> None:
        text = (DECK / "tube.inp").read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        files.write_text(folder / "own" / "tube.inp", text)
        files.write_text(folder / "own" / "mesh.inc", (DECK / "mesh.inc").read_text(encoding="utf-8"))
        run_init(folder / "p", say, deck=folder / "own" / "tube.inp", nodes=["tip=70001"])

    return do


def law(text: str) -> Try:
    return deck((LAW, f"*Hyperelastic, {text}"))


# -- tests of the silicone -----------------------------------------------------------------------------------
STRAIN = np.linspace(0.0, 0.8, 161)
STRESS = nominal_stress(Material(C10=0.05, C01=0.02), STRAIN, "uniaxial")
KEPT = STRAIN <= 0.4
SIZE = "length_mm = 33\narea_mm2 = 12\n"


def pulled(strain: Array = STRAIN, stress: Array = STRESS, *, head: str = "Extension (mm),Load (N)",
           first: float = 0.0) -> str:  # fmt: skip
    """What a tester writes of a strip of 33 mm and 12 mm2."""
    rows = zip(first + 33 * strain, 12 * stress, strict=True)
    return head + "\n" + "".join(f"{x:.5g},{f:.6g}\n" for x, f in rows)


def specimen(text: str, keys: str = SIZE) -> Try:
    """A right table of displacements with this test of the silicone beside it."""

    def do(folder: Path, say: Say) -> None:
        measured("points.csv", points(places()), log(), {}, stages=())(folder, say)
        toml = folder / "p" / "twin.toml"
        one = '\n[[material_tests]]\nname = "pull"\nfile = "raw/pull.csv"\nkind = "uniaxial"\nsd_MPa = 0.001\nscale_percent = 2.0\n'
        files.write_text(toml, toml.read_text(encoding="utf-8") + one + keys)
        files.write_text(folder / "p" / "raw" / "pull.csv", text)
        run_check(Project.open(folder / "p"), say)

    return do


STEPS = np.repeat(np.arange(0.08, 0.84, 0.08), 20)
RELAXED = np.tile(1 - 0.15 * (1 - np.exp(-np.arange(20) / 4)), 10)

MISTAKES: dict[str, tuple[Try, str]] = {
    "places in m under mm": (table(lambda place: 1e-3 * place), r"does not move: 0\.037 mm in the file.*are the units of pressure and lengths right"),
    "a table that bends up": (table(upwards), r"bends to -z.*turn the sign"),
    "points that exchange their places": (table(exchanged), r"points tip and middle exchange places at 5, 6 s"),
    "a log of another test": (table(course="time_s,p [kPa]\n" + "".join(f"{t:.2f},{10 * np.sin(t) ** 2 + 5:.3f}\n" for t in LOG_TIME)), r"motion|explains"),
    "a log that ends before": (table(course=log().partition("\n4.10")[0] + "\n"), r"log\.csv covers -8\.000 to "),
    "two units in a table": (measured("points.csv", points(places()).replace("middle_x_mm", "middle_x_cm"), log(), {}), r"all in one unit: found cm and mm"),
    "no sd": (table(sd_mm=None), r"wanted sd_mm"),
    "axes that mirror": (measured("points.csv", points(places()), log(), {"axes": "x,y,-z"}), r"mirror image"),
    "DICe's numbers in two forms": (
        measured("dice", "==DICe_solution_00.txt\nA\n==DICe_solution_1b.txt\nA\n", log(), {}), r"names of two forms"
    ),
    "numbers that are neither pictures nor times": (dice([0, 113, 255, 391]), r"neither count pictures nor are time stamps"),
    "DICe's pictures of another test": (dice([0, 20, 40, 60, 80, 600]), r"log\.csv covers .* the file 0\.000 to 30\.000 s"),
    "an unknown law": (law("van der waals\n0.2, 0.005"), r"VAN DER WAALS: wanted Mooney-Rivlin"),
    "two loads in another ratio": (deck((LOAD, LOAD + "\n*End step\n*Step, nlgeom\n*Static\n*Dsload, op=new\nTube-1.Inner, P, 0.08")), r"surface Tube-1\.Inner: not defined"),
    "an amplitude that is not there": (deck(("*Dsload", "*Dsload, amplitude=A")), r"AMPLITUDE=A: not defined above"),
    "a set that is not there": (deck((HEAD, "*Boundary\nRot, 1, 3")), r"set Rot: not defined above; wanted one of"),
    "times of an amplitude that fall": (
        deck(("*Boundary", "*Amplitude, name=A\n0., 0., 2., 1.\n1., 1.\n*Boundary"), ("*Dsload", "*Dsload, amplitude=A")),
        r"times that do not increase",
    ),
    "an exponent without E": (deck(("P, 0.08", "P, 8.0-2")), r"8\.0-2.*wanted finite numbers"),
    "a deck in m": (deck(("*Include", "** units: m, N, s\n*Include")), r"mm|m "),
    "a finger that is not held": (deck((HEAD, "*Boundary\nTube-1.Middle plane, YSYMM")), r"held|clamp"),
    "no pressure": (deck((LOAD, "")), r"pressure|\*DSLOAD"),
    "linear geometry": (deck((" nlgeom, inc=500", " inc=500")), r"\*STEP without NLGEOM"),
    "a tester's column without a unit": (specimen(pulled(head="Strain,Load (N)"), "area_mm2 = 12\n"), r"column 'Strain' has no unit of strain"),
    "kPa under MPa": (specimen(pulled(head="Extension (mm),Stress (MPa)", stress=1e3 / 12 * STRESS), "length_mm = 33\n"), r"likely kPa read as MPa"),
    "thousands marks": (
        specimen("Extension (um);Load (N)\n" + "".join(f"{330 * k:,};{0.05 * k:.3f}\n" for k in range(20))),
        r"',' seems to stand between thousands",
    ),
    "a sign of the load": (specimen(pulled(stress=-STRESS)), r"wanted stress that rises with strain"),
    "the number of a specimen that is not there": (specimen(pulled(), SIZE + "export_number = 3\n"), r"stands there 1 times; wanted 3"),
}  # fmt: skip

DOUBTFUL: dict[str, tuple[Try, str]] = {
    "a frame rate of 12.5 for 10": (
        measured("points.csv", points(places()).replace("time_s", "frame"), log(), {"fps": 12.5}),
        r"seems to run 0\.80 times as long as the test",
    ),
    **{f"a lost point as {word}": (table(lost=word), r"10 positions count as not seen") for word in ("0.0000", "-1", "-9999", "1e20")},
    "a place that is held": (table(held), r"tip has exactly one place in rows 40 to 54"),
    "a place at rest amid motion": (table(lambda place: held(place, 0)), r"exactly at its first place in rows 40 to 54"),
    "another mark for a while": (table(jumped), r"tip jumps by 9\.\d* mm at 5 s"),
    "y up": (table(axes="xy"), r'write axes = "x,-z,y" under \[import\]'),
    "a log that is 0.4 s late": (table(course=log(late=0.4)), r"0\.[34]\d* s (before|later|earlier)|start_s"),
    "a setpoint for a log": (table(course=log("time_s,p_set [kPa]")), r"asked for, not what a gauge measured"),
    "a pressure of an amplitude": (
        deck(("*Boundary", "*Amplitude, name=A\n0., 0., 0.5, 0.5,\n1., 1.,\n*Boundary"), ("*Dsload", "*Dsload, amplitude=A")),
        r"at its largest value, 1\.",
    ),
    "a compressible silicone": (law("mooney-rivlin\n0.18, 0.06, 0.49"), r"bulk modulus is 8\.5 times its shear modulus"),
    "skin elements": (deck(("*Boundary", "*Element, type=CPS4, elset=Skin\n900001, 11, 14, 17, 20\n*Boundary")), r"Elements CPS4"),
    "a position of the crosshead": (specimen(pulled(head="Position (mm),Load (N)", first=33.0)), r"begins at 33 mm: a position"),
    "slip in the grips": (specimen(pulled(stress=np.where(KEPT, STRESS, 0.7 * STRESS))), r"falls by 29 ?% at a strain of 40 %.* slipped"),
    "a torn specimen": (specimen(pulled(stress=np.where(KEPT, STRESS, 0.0))), r"the specimen tore"),
    "rows newest first": (specimen(pulled(STRAIN[::-1], STRESS[::-1])), r"newest first.* turned round"),
    "two specimens": (specimen("Specimen 1\n" + pulled() + "\nSpecimen 2\n" + pulled(stress=1.1 * STRESS)), r"2 specimens"),
    "held strains": (specimen(pulled(STEPS, RELAXED * np.interp(STEPS, STRAIN, STRESS))), r"held \d+ times, .*relaxation"),
}  # fmt: skip

RIGHT: dict[str, Try] = {
    "a table of places": table(),
    **{f"a lost point as {word!r}": table(lost=word) for word in ("", "NaN", "-", "n/a")},
    "a table in cm": measured("points.csv", points(0.1 * places(), unit="cm"), log(), {}),
    "axes as twin.toml has them": measured("points.csv", points(places(), axes="xy"), log(), {"axes": "x,-z,y"}),
    "semicolons and decimal commas": measured("points.csv", points(places()).replace(",", ";").replace(".", ","), log(), {}),
    "every fifth picture of DICe": dice(list(range(0, 240, 5))),
    "pictures of DICe that are missing": dice([n for n in range(0, 240, 2) if not 80 < n < 90]),
    "a deck": deck(),
    "an empty C01": law("mooney-rivlin\n0.18, , 0.005"),
    "the polynomial by default": law("N=1\n0.18, 0.06, 0.005"),
    "a comma at the end": law("mooney-rivlin\n0.18, 0.06, 0.005,"),
    "a second step with another pressure": deck((LOAD, LOAD + "\n*End step\n*Step, nlgeom\n*Static\n*Dsload\nTube-1.Chamber, P, 0.09")),
    "a tester's file": specimen(pulled()),
    "a tester's file with lines above": specimen("Rate 1;450\n\n" + pulled(head="Extension;Load\n(mm);(N)").replace(",", ";")),
}  # fmt: skip


def everything() -> dict[str, Try]:
    """All of these."""
    wrong = {name: put for name, (put, _) in {**MISTAKES, **DOUBTFUL}.items()}
    return {**wrong, **RIGHT}
