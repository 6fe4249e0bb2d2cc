"""The user's own effects: Python files of a project that twin.toml names under [model] effect_files.

Nothing else runs them. Each public class in them that is an Effect joins the library of that project.
"""

from collections.abc import Sequence
from pathlib import Path

from twin.effects.library import all_effects
from twin.effects.origin import Origin
from twin.effects.protocol import Effect


def own_effects(root: Path, names: Sequence[str]) -> tuple[Effect, ...]:
    """The effects that files of a project folder define, in the order of the files and of their classes.

    names: paths relative to `root`. ValueError names the file, and its line where Python stops in it, for a
    file that is missing, not in the folder, or without an effect, and for a name that is taken.
    """
    owners: dict[str, str] = dict.fromkeys((e.name for e in all_effects()), "the library")
    effects = []
    for name in names:
        for effect in _effects_of(origin_of(root, name)):
            if effect.name in owners:
                raise ValueError(
                    f"{name}: effect {effect.name!r} has the name of one in {owners[effect.name]}; wanted a "
                    "name of its own; rename it and its parameters"
                )
            owners[effect.name] = name
            effects.append(effect)
    return tuple(effects)


def origin_of(root: Path, name: str) -> Origin:
    """The file with its present text. ValueError where it cannot be read, or lies outside the project
    folder."""
    path = (root / name).resolve()
    if not path.is_relative_to(root.resolve()):
        raise ValueError(f"model.effect_files: {name} lies outside the project folder; copy it into effects/")
    if not path.is_file():
        raise ValueError(
            f"model.effect_files: {name}: no such file in {root}; wanted a Python file that defines an "
            "effect; copy it there or correct twin.toml"
        )
    try:
        return Origin(name, path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise ValueError(f"model.effect_files: {name} is not text; wanted Python in UTF-8") from None


def _effects_of(origin: Origin) -> list[Effect]:
    """The effects of one file, made without arguments."""
    module = origin.module()
    classes = [
        c
        for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, Effect) and c.__module__ == module.__name__
    ]
    for c in classes:
        c.origin = origin
    public = [c for c in classes if c.name and not c.__name__.startswith("_")]
    if not public:
        raise ValueError(
            f"{origin.path}: no effect in it; wanted a class such as `class Cable(Effect):` with a name, "
            "`from twin import Effect` above it"
        )
    return [_made(c, origin) for c in public]


def _made(c: type[Effect], origin: Origin) -> Effect:
    try:
        return c()
    except TypeError as error:
        raise ValueError(
            f"{origin.path}: {c.__name__}() cannot be made without arguments ({error}); give them defaults"
        ) from error
