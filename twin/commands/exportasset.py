"""`twin export mujoco` and its like: the calibrated finger as files of a simulator, with a card."""

from typing import Any

from twin import files
from twin.assets.card import carded, of_film, page
from twin.assets.sections import followed, line_of
from twin.assets.simulators import SIMULATORS
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.project.folder import Project


def export_asset(project: Project, say: Say, name: str, *, ramp_s: float, hold_s: float) -> dict[str, Any]:
    """The finger's files for a simulator, and card.json with card.md, its page."""
    check_embedded(project, f"twin export {name}")
    simulator, bench = SIMULATORS[name], Workbench.of(project)
    record = files.read(FitRecord, fit_file(project))
    film = of_film(bench.targets, line_of(bench)[0])
    inputs = [project.targets_folder, *project.deck_files()]
    extra = {"form": name, "ramp_s": ramp_s, "hold_s": hold_s}
    with project.new_run("export", inputs=inputs, extra=extra) as run:
        found = followed(bench, record, film.pressure, say, ramp_s=ramp_s, hold_s=hold_s)
        texts = simulator.written(found.rod)
        for file, text in texts.items():
            run.write_text(file, text)
        tips = lifted = None
        if simulator.runs:
            tips = simulator.tips(run.folder, film.pressure, 0.0)
            middle = len(tips) // 2
            (held,) = simulator.tips(run.folder, film.pressure[middle : middle + 1], found.force)
            lifted = held - tips[middle]
        card = carded(
            simulator, found, film, tips, lifted,
            record=record, effects=bench.model().effects, names=tuple(texts),
        )  # fmt: skip
        run.write(card)
        run.write_text("card.md", page(card))
        run.summary["headline"] = f"The calibrated finger for {name}. {card.sentence}"
    say(card.sentence)
    if bench.targets.shares:
        say("Its chambers carry the pressure as in the first film.")
    for label, why in card.missing.items():
        say(f"Without {label}: {why}.")
    say(f"Wrote {project.shown(run.folder)}/{', '.join(texts)}; card.md says how well it follows.")
    return {
        "stage": "export", "run": run.name, "form": name, "file": next(iter(texts)),
        "tip_error": card.tip_error, "film_error": card.film_error, "cover": card.cover,
        "load_error": card.load.error,
    }  # fmt: skip
