"""The simulators that take a finger, with the version that the files were checked with."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from twin import files
from twin.assets import mujocochain, sectiontable
from twin.assets.rod import Rod
from twin.targets import Array

Tips = Callable[[Path, Array, float], Array]  # folder, pressures (k,) MPa, force N -> (k, 3) mm


@dataclass(frozen=True, kw_only=True)
class RodSimulator:
    """A program that takes a finger. package: its distribution, "" where none is needed; tested: its version
    that the files were checked with; written: the files by name; tips: what it says with them; cannot: what
    it cannot express of the rod."""

    name: str
    package: str = ""
    tested: str = ""
    written: Callable[[Rod], dict[str, str]]
    tips: Tips
    cannot: tuple[str, ...] = ()

    @property
    def installed(self) -> str:
        """The version that is installed; "" where there is none, or none is needed."""
        try:
            return version(self.package) if self.package else ""
        except PackageNotFoundError:
            return ""

    @property
    def runs(self) -> bool:
        """True where its files can be run here."""
        return not self.package or bool(self.installed)


def rod_in(folder: Path) -> Rod:
    """The rod of a folder's rod.json."""
    return Rod.of(files.read_json(folder / "rod.json"))


def _of_table(folder: Path, pressures: Array, force: float) -> Array:
    return sectiontable.tips(rod_in(folder), pressures, force)


def _of_mujoco(folder: Path, pressures: Array, force: float) -> Array:
    return mujocochain.tips(folder, pressures, force)


def _of_elastica(folder: Path, pressures: Array, force: float) -> Array:
    from twin.assets import elasticarod

    return elasticarod.tips(folder, pressures, force)


def _of_newton(folder: Path, pressures: Array, force: float) -> Array:
    from twin.assets import newtonchain

    return newtonchain.tips(folder, pressures, force)


def _with_script(name: str, script: str) -> Callable[[Rod], dict[str, str]]:
    """What writes rod.json and a module of this room as a script by its name."""

    def written(rod: Rod) -> dict[str, str]:
        text = files.read_text(Path(__file__).with_name(script))
        return {"rod.json": rod.json(), name: text}

    return written


DAMPING = "damping: a slow film does not tell it; what is written brings the finger to rest"
SIMULATORS = {
    s.name: s
    for s in (
        RodSimulator(name="table", written=sectiontable.written, tips=_of_table),
        RodSimulator(
            name="mujoco", package="mujoco", tested="4.0.0", written=mujocochain.written, tips=_of_mujoco,
            cannot=(
                DAMPING, "a stiffness that changes with the pressure: each joint has that at half of it",
                "a bend that is no cubic of the pressure",
            ),
        ),
        RodSimulator(
            name="newton", package="newton", tested="1.8.0",
            written=_with_script("finger_newton.py", "newtonchain.py"), tips=_of_newton,
            cannot=(DAMPING, "bending across the plane and torsion: its joints have none"),
        ),
        RodSimulator(
            name="pyelastica", package="pyelastica", tested="1.0.0",
            written=_with_script("finger_pyelastica.py", "elasticarod.py"), tips=_of_elastica,
            cannot=(
                DAMPING, "bending across the plane, torsion and shear: their stiffness was not calibrated",
            ),
        ),
    )
}  # fmt: skip
