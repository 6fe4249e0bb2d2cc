"""Let a project's own programs run and its links be followed, after their reader has seen what they are."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin.project.folder import Project, Say
from twin.project.trust import (
    digest_of_link,
    digest_of_program,
    leads_out,
    named_files,
    remember,
    trust_file,
    trusted,
)


def run_trust(root: Path, say: Say, *, names: Sequence[str] = ()) -> dict[str, Any]:
    """Trust the effect files of a project and its links out of the folder, or only the named ones of them."""
    project = Project.open(root, strange=True)
    asked = _asked(project)
    unknown = [name for name in names if name not in asked]
    if unknown:
        raise ValueError(
            f"{unknown[0]}: neither an effect file nor a link of this project; wanted one of "
            f"{', '.join(asked) or 'none: there is nothing to trust'}"
        )
    wanted = {name: asked[name] for name in names or asked}
    before = trusted()
    for name, (digest, what) in wanted.items():
        say(f"{name}: {what}{', as before' if digest in before else ''}.")
    remember({digest: f"{project.root / name}: {what}" for name, (digest, what) in wanted.items()})
    say(f"Trusted, in {trust_file()}." if wanted else "There is nothing to trust: no own effects, no links.")
    return {"stage": "trust", "status": "done", "trusted": sorted(wanted)}


def _asked(project: Project) -> dict[str, tuple[str, str]]:
    """The digest of every program and link of a project that would have to be trusted, and what it is."""
    found = {}
    for name in project.config.model.effect_files:
        path = project.path(name)
        if path.is_file() and not leads_out(path, project.root):
            text = path.read_bytes()
            lines = text.count(b"\n") + (not text.endswith(b"\n"))
            found[name] = (digest_of_program(text), f"a program of {lines} lines, which may run as it is now")
    for path in named_files(project.root, project.config):
        if leads_out(path, project.root):
            target = f"a link to {path.resolve()}, which is followed"
            found[project.shown(path)] = (digest_of_link(path), target)
    return found
