"""All that is planted, in the small drawn project and in files of other programs, and what commands say of it."""

import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.messages import Lines
from tests.strangers import logs, mistakes, others, recordings, statements
from tests.strangers.planting import Plant
from tests.strangers.studio import make
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.project.folder import Project


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
    """All that is planted, of all tables."""
    wrong = mistakes.MISTAKES | statements.MISTAKES | logs.MISTAKES | recordings.MISTAKES
    doubtful = statements.DOUBTFUL | logs.DOUBTFUL | recordings.DOUBTFUL
    return Planted(wrong, doubtful, mistakes.RIGHT | logs.RIGHT | recordings.RIGHT)


def is_told(one: Told, sentence: str) -> bool:
    """Whether a doubtful project passed with a remark of this pattern."""
    return not one.refused and any(re.search(sentence, remark) for remark in one.remarks)


def all_told(plants: Mapping[str, Plant]) -> list[Told]:
    """What the program said of each, in a small project drawn for them."""
    with tempfile.TemporaryDirectory() as place:
        base = make(Path(place) / "base")
        return [told(name, plant, base=base, folder=Path(place)) for name, plant in plants.items()]


def others_told(tries: Mapping[str, others.Try]) -> list[Told]:
    """What the program said of each file of another program, deck or test of the silicone."""
    told = []
    for name, put in tries.items():
        said = Lines()
        with tempfile.TemporaryDirectory() as place:
            try:
                put(Path(place), said)
                sentence = ""
            except ValueError as error:
                sentence = str(error)
        told.append(Told(name, bool(sentence), "init, check or measure" if sentence else "nothing", sentence, tuple(said)))
    return told


def wrong_figures() -> dict[str, Any]:
    """`planted`: mistakes and doubtful things; `accepted_wrong`: those that passed, or without a word;
    `told_wrong_cause`: those of which something else was said; and the sentence of each."""
    planted = everything()
    refused = all_told({name: plant for name, (plant, _) in planted.mistakes.items()})
    refused += others_told({name: put for name, (put, _) in others.MISTAKES.items()})
    doubted = all_told({name: plant for name, (plant, _) in planted.doubtful.items()})
    doubted += others_told({name: put for name, (put, _) in others.DOUBTFUL.items()})
    cause = {name: sentence for name, (_, sentence) in {**planted.mistakes, **others.MISTAKES}.items()}
    doubt = {name: sentence for name, (_, sentence) in {**planted.doubtful, **others.DOUBTFUL}.items()}
    accepted = [t.name for t in refused if not t.refused]
    other = [t.name for t in refused if t.refused and not re.search(cause[t.name], t.sentence)]
    untold = [t for t in doubted if not is_told(t, doubt[t.name])]
    accepted += [t.name for t in untold if not t.remarks and not t.refused]
    other += [t.name for t in untold if t.name not in accepted]
    return {
        "planted": len(refused) + len(doubted), "accepted_wrong": len(accepted), "accepted": accepted,
        "told_wrong_cause": len(other), "told_wrong": other,
        "sentences": {t.name: t.sentence or " ".join(t.remarks) for t in [*refused, *doubted]},
    }  # fmt: skip


def refused_right() -> dict[str, str]:
    """Unusual projects that are right, each with the sentence it was refused with, "" where it passed."""
    return {t.name: t.sentence for t in [*all_told(everything().right), *others_told(others.RIGHT)]}
