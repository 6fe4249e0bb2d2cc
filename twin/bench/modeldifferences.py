"""What two projects differ in: body, mesh, weight, object, engine and effects; and films that they share."""

from collections.abc import Iterable, Iterator
from fnmatch import fnmatch
from hashlib import sha256

from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project


def other_models(a: Project, b: Project) -> tuple[str, ...]:
    """A sentence on the settings in which the models of two projects differ; none where they agree."""
    names, rows = (a.root.name, b.root.name), list[str]()
    ours, theirs = ({**_dimensions(p), **_own(p)} for p in (a, b))
    for key in {**ours, **theirs}:
        if ours.get(key) != theirs.get(key):
            rows.append(f"{key} {_shown(ours.get(key))} and {_shown(theirs.get(key))}")
    if _decks(a) != _decks(b):
        rows.append(f"the mesh {a.config.model.deck or 'built in'} and {b.config.model.deck or 'built in'}")
    if not rows:
        return ()
    return (
        f"{names[0]} and {names[1]} are not modelled alike: {', '.join(rows)}. If the fingers are alike, "
        "correct one "
        "of the two twin.toml: constants of different models cannot be compared.",
    )


def same_films(projects: Iterable[Project]) -> Iterator[str]:
    """Sentences on films, or other programs' files, whose equal bytes several batches are measured from."""
    known: dict[str, str] = {}  # by digest, the batch that had it first
    for project in projects:
        name, source, foreign = project.root.name, project.source(), project.config.imports
        stated = [*(c.film for c in project.config.cameras), *(table.file for table in foreign)]
        runs = {source.run, *(film.run for film in source.films)} - {None, ""}
        for run in sorted(project.root / "runs" / str(run) for run in runs):
            for file, digest in project.info(run).inputs.items():
                if not any(fnmatch(file, film) or file.startswith(f"{film}/") for film in stated):
                    continue
                if (first := known.setdefault(digest, name)) != name:
                    yield (f"{first} and {name} are measured from the same film, of equal bytes ({file}): "
                           "they are one measurement. Is one of them a copy by mistake?")  # fmt: skip
                    break


def _dimensions(project: Project) -> dict[str, object]:
    """The kind of body and its dimensions, none of a deck's."""
    model = project.config.model
    return {} if model.dimensions is None else {"body": model.kind, **model.dimensions.model_dump()}


def _own(project: Project) -> dict[str, object]:
    """Density, rigid object and engine of a project."""
    model = project.config.model
    return {"density_kg_m3": model.density_kg_m3, "object": model.object, "engine": model.engine}


def _decks(project: Project) -> list[str]:
    """The digests of the files of a deck, wherever they lie."""
    return sorted(sha256(file.read_bytes()).hexdigest() for file in project.deck_files())


def _shown(value: object) -> str:
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def other_effects(a: Project, fit_a: FitRecord, b: Project, fit_b: FitRecord) -> list[str]:
    """A sentence on the effects in which the models of two batches differ; none where they agree."""
    ours, theirs = fit_a.effects, fit_b.effects
    if ours == theirs:
        return []
    return [f"The models differ: {a.root.name} has {', '.join(ours) or 'no effect'}, {b.root.name} "
            f"{', '.join(theirs) or 'no effect'}. Constants of different models are not the "
            "same quantity."]  # fmt: skip
