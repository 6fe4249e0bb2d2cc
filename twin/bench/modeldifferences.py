"""In what the models of two projects differ beside their effects: fingers, meshes and weight of one are not
those of the other, and neither are the constants."""

from hashlib import sha256

from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project


def other_models(a: Project, b: Project) -> tuple[str, ...]:
    """A sentence on what the models of two projects do not share; none where they are alike."""
    names, rows = (a.root.name, b.root.name), list[str]()
    first, second = ({**_dimensions(p), **_own(p)} for p in (a, b))
    for key in {**first, **second}:
        if first.get(key) != second.get(key):
            rows.append(f"{key} {_shown(first.get(key))} and {_shown(second.get(key))}")
    if _decks(a) != _decks(b):
        rows.append(f"the mesh {a.config.model.deck or 'built in'} and {b.config.model.deck or 'built in'}")
    if not rows:
        return ()
    return (
        f"{names[0]} and {names[1]} are not modelled alike: {', '.join(rows)}. If the fingers are alike, "
        "correct one "
        "of the two twin.toml: constants of different models cannot be compared.",
    )


def _dimensions(project: Project) -> dict[str, object]:
    """The kind of body and its dimensions, none of a deck's."""
    model = project.config.model
    return {} if model.dimensions is None else {"body": model.kind, **model.dimensions.model_dump()}


def _own(project: Project) -> dict[str, object]:
    """Its weight, what it meets, and what solves it."""
    model = project.config.model
    return {"density_kg_m3": model.density_kg_m3, "object": model.object, "engine": model.engine}


def _decks(project: Project) -> list[str]:
    """The digests of the files of a deck, wherever they lie."""
    return sorted(sha256(file.read_bytes()).hexdigest() for file in project.deck_files())


def _shown(value: object) -> str:
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def other_effects(a: Project, first: FitRecord, b: Project, second: FitRecord) -> list[str]:
    """What the models of two batches do not share, one sentence."""
    ours, theirs = first.effects, second.effects
    if ours == theirs:
        return []
    return [f"The models differ: {a.root.name} has {', '.join(ours) or 'no effect'}, {b.root.name} "
            f"{', '.join(theirs) or 'no effect'}. Constants of different models are not the "
            "same quantity."]  # fmt: skip
