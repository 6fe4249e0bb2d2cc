"""Let a project's own programs run and its links be followed, after their reader has seen what they are."""

from pathlib import Path
from typing import Any

from twin.messages import Say
from twin.project.folder import Project
from twin.project.trust import check_programs, links, programs, remember, trust_file, trusted


def run_trust(root: Path, say: Say) -> dict[str, Any]:
    """Trust the effect files of a project as they are now, and its links out of the folder."""
    project, before = Project.open(root, strange=True), trusted()
    check_programs(project.root, project.config)
    items = [*programs(project.root, project.config.model.effect_files), *links(project.root, project.config)]
    for item in items:
        say(f"{item.name}: {item.what}{', trusted before' if item.digest in before else ''}.")
    remember(project.root, items)
    say(f"Trusted, in {trust_file()}." if items else "There is nothing to trust: no own effects, no links.")
    return {"stage": "trust", "status": "done", "trusted": sorted(item.name for item in items)}
