"""The effect that a name or a label asks for, in the law that the newest diagnosis kept for it."""

from twin.bench.fits import fresh
from twin.bench.workbench import own_of
from twin.effects.library import effect
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect
from twin.project import files
from twin.project.folder import Project
from twin.project.trust import programs, remember


def law_of(project: Project, name: str) -> tuple[Effect, dict[str, float]]:
    """The effect, and where the newest diagnosis began the fit that it gave out for it."""
    name = named_effect(project, name)
    path, own = fresh(project, ("diagnose",), "diagnosis.json"), own_of(project)
    data = files.read_json(path) if path else {}
    kept = path.with_name("kept.json") if path else None
    laws = {label.partition(":")[0]: label for label in (data.get("law") or "").split(" + ")}
    if name in laws and kept and kept.exists():
        return effect(laws[name], own=own), files.read_json(kept)["start"]
    return effect(name, own=own), {}


def named_effect(project: Project, name: str) -> str:
    """The name of an effect, or that of the effect in a Python file of the project: naming the file on the
    command line trusts it. ValueError where twin.toml does not name it, or it does not define one effect."""
    if not name.endswith(".py"):
        return name
    known = project.config.model.effect_files
    if name not in known:
        raise ValueError(
            f"{name}: not an effect file of this project, which has {', '.join(known) or 'none'}; name it "
            "under [model] effect_files of twin.toml"
        )
    remember(project.root, programs(project.root, [name]))
    found = [effect.name for effect in own_effects(project.root, (name,))]
    if len(found) != 1:
        raise ValueError(f"{name} defines {', '.join(found)}: name one of them instead of the file")
    return found[0]
