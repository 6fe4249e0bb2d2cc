"""All that is planted in the small drawn project, and what `twin check`, `camera` and `measure` say of it."""

import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.strangers import mistakes, recordings
from tests.strangers.planting import Plant
from tests.strangers.studio import make
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.project.folder import Project


class Lines(list[str]):
    """A say that keeps its lines."""

    def __call__(self, text: str, /) -> None:
        self.append(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        pass


@dataclass(frozen=True)
class Told:
    """What the program said of one project."""

    name: str
    refused: bool
    by: str  # "check", "camera", "measure", or "nothing"
    sentence: str  # the error, or all remarks
    remarks: tuple[str, ...] = ()


STAGES = {"check": run_check, "camera": run_camera, "measure": run_measure}


def told(name: str, plant: Plant, *, base: Path, folder: Path, stages: Sequence[str] = tuple(STAGES)) -> Told:
    """What the stages say of a copy of the right project with a mistake in it, up to the first that refuses.

    Raises AssertionError where targets are written all the same.
    """
    root, said = folder / "".join(c if c.isalnum() else "-" for c in name), Lines()
    shutil.copytree(base, root)
    try:
        plant(root)
        for by in stages:
            sentence = _refusal(STAGES[by], root, said)
            if sentence and (root / "targets").exists():
                raise AssertionError(f"{name}: refused, but targets are written")
            if sentence:
                return Told(name, True, by, sentence, tuple(said))
    finally:
        shutil.rmtree(root)
    return Told(name, False, "nothing", "", tuple(said))


def _refusal(stage: Callable[..., object], root: Path, say: Lines) -> str:
    """What a stage refuses a project with, "" where it does not."""
    try:
        stage(Project.open(root), say)
    except ValueError as error:
        return str(error)
    return ""


@dataclass(frozen=True)
class Planted:
    """All that is planted: what must be refused, what must be told, and what must pass."""

    mistakes: Mapping[str, tuple[Plant, str]]
    doubtful: Mapping[str, tuple[Plant, str]]
    right: Mapping[str, Plant]

    @property
    def plants(self) -> dict[str, Plant]:
        named = {name: plant for name, (plant, _) in {**self.mistakes, **self.doubtful}.items()}
        return {**named, **self.right}


def everything() -> Planted:
    """All that is planted, of both tables."""
    wrong, right = mistakes.MISTAKES | recordings.MISTAKES, mistakes.RIGHT | recordings.RIGHT
    return Planted(wrong, recordings.DOUBTFUL, right)


def is_told(one: Told, sentence: str) -> bool:
    """Whether a doubtful project passed with a remark of this pattern."""
    return not one.refused and any(re.search(sentence, remark) for remark in one.remarks)


def figures(only: str = "", *, tell: bool = False) -> dict[str, Any]:
    """Mistakes that were accepted and right inputs that were refused, of those whose names hold a text, each
    with its sentence; tell: print each as it comes."""
    with tempfile.TemporaryDirectory() as place:
        base, every_one, all_of = make(Path(place) / "base"), list[Told](), everything()
        for name, plant in all_of.plants.items():
            if only not in name:
                continue
            every_one.append(told(name, plant, base=base, folder=Path(place)))
            if tell:
                one = every_one[-1]
                print(f"{name} [{one.by}]: {one.sentence or 'passes ' + ' '.join(one.remarks)}", flush=True)
    wrong = [t for t in every_one if t.name in all_of.mistakes]
    right = [t for t in every_one if t.name in all_of.right]
    doubtful = [t for t in every_one if t.name in all_of.doubtful]
    untold = [t.name for t in doubtful if not is_told(t, all_of.doubtful[t.name][1])]
    return {
        "planted": len(wrong), "accepted_wrong": sum(not t.refused for t in wrong),
        "doubtful": len(doubtful), "untold": untold,
        "right": len(right), "refused_right": sum(t.refused for t in right),
        "sentences": {t.name: t.sentence for t in wrong},
        "refused": {t.name: t.sentence for t in right if t.refused},
    }  # fmt: skip
