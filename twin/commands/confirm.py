"""The stage confirm: whether a film that no fit has seen bears out the effects of the model."""

from typing import Annotated, Any, ClassVar

from pydantic import Field
from typer import Argument

from twin import files
from twin.bench.comparison import film_names, foretold
from twin.bench.effectchange import without
from twin.bench.engines import check_embedded
from twin.bench.fits import newest_fit
from twin.bench.priors import check_least_squares
from twin.bench.workbench import Workbench
from twin.diagnosis.diagnosisrecord import ForetoldFilm
from twin.judging.heldout import forecasts, unseen_blocks
from twin.messages import Say
from twin.project.folder import Project
from twin.records import Record
from twin.targets import Targets


class Confirmation(Record):
    """A film that no fit has seen, foretold without and with the effects of the model."""

    file: ClassVar[str] = "confirmation.json"
    effects: tuple[str, ...] = Field(description="of the model, as in twin.toml")
    film: ForetoldFilm = Field(description="as `held_out` of diagnosis.json")


def run_confirm(
    project: Project,
    say: Say,
    film: Annotated[str, Argument(
        metavar="FILM", help="a film that is held out: its name, or the number of its block")],
) -> dict[str, Any]:
    """The effects of the model as a film sees them that no fit has seen: confirmed, refuted, or not tested by
    it."""
    labels = project.config.model.effects
    if not labels:
        raise ValueError("model.effects of twin.toml is empty: nothing is to be confirmed; run twin add")
    check_embedded(project, "twin confirm")
    check_least_squares(project, "twin confirm")
    bench, fit = Workbench.of(project).of_film, newest_fit(project)
    block = _block(project, bench.targets, film)
    with project.new_run("confirm", extra={"effects": list(labels), "film": film}) as run:
        now = bench.judged_fit(bench.model(), fit, say)
        both = [without(bench, now, labels, say), now]
        a, b = (next(row for row in foretold(bench, judged) if row.block == block) for judged in both)
        p, q = (forecasts(judged, bench.targets)[block] for judged in both)
        record = Confirmation(effects=tuple(labels), film=ForetoldFilm.of(a, b, p, q))
        run.write(record)
        run.summary["headline"] = f"{', '.join(labels)}: {record.film.outcome}"
    say(f"{' and '.join(labels)}, {record.film.words}")
    say(f"Wrote {project.shown(run.folder)}/{record.file}")
    return {"stage": "confirm", "run": run.name} | files.plain(record)


def _block(project: Project, targets: Targets, film: str) -> int:
    """The block of a film, by its name or number; ValueError where it is not held out, or not measured."""
    names, held = film_names(project), unseen_blocks(targets)
    found = {name: b for b in held for name in (str(b), names.get(b, str(b)))}
    if film not in found:
        raise ValueError(
            f"film {film!r} is not held out, or not measured; wanted one of {', '.join(found) or 'none'}: "
            "hold one out with held_out = true, then run twin measure and twin calibrate"
        )
    return found[film]
