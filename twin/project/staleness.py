"""Changes of a project since a run was made: files, tables of twin.toml, versions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from twin import files
from twin.project.folder import Project, versions
from twin.project.trust import leads_out, links

# The effects of a fit stand in fit.json: twin.toml gets them after the fit. Names of own effect files say
# nothing of what they hold, which the digests do.
ELSEWHERE = {("model", "effects"), ("model", "effect_files")}
# How a job runs changes no figure; which program solves does.
RUNNING = {("model", f"engine_{key}") for key in ("cpus", "jobs", "memory", "command")}
NEEDED = ("softtwin",)  # of the recorded versions, those of the code that makes the figures


def changes(
    project: Project, folder: Path, *, tables: Sequence[str], present: Sequence[Path], but: Sequence[str] = ()
) -> list[str]:
    """Changes since the run in `folder` was made, one clause each; [] without any.

    tables: names of the tables of twin.toml that it depends on.   present: the files and folders that it
    would read now, next to those that it has recorded.   but: recorded files that do not count.
    """
    info = project.info(folder)
    if not {"inputs", "config"} <= info.model_fields_set:
        return ["its run.json does not say what it was made from"]
    recorded = {name: digest for name, digest in info.inputs.items() if name not in but}
    return [
        *_changed_files(project, recorded, present),
        *_changed_tables(project, info.config.model_dump(mode="json", exclude_unset=True), tables),
        *_changed_versions(info.versions),
    ]


def _changed_files(project: Project, recorded: Mapping[str, str], present: Sequence[Path]) -> list[str]:
    now = files.digest_of([path for path in present if path.exists()], root=project.root)
    elsewhere = [project.path(name) for name in recorded if name not in now]
    now |= files.digest_of([path for path in elsewhere if _may_read(project, path)], root=project.root)
    changed = [name for name in recorded if name in now and now[name] != recorded[name]]
    return [
        *(f"{name} has changed since" for name in changed),
        *(f"{name} is gone" for name in recorded.keys() - now.keys()),
        *(f"{name} is new" for name in now.keys() - recorded.keys()),
    ]


def _may_read(project: Project, path: Path) -> bool:
    """True for an existing file that is the project's own, or a trusted link."""
    if not path.is_file():
        return False
    if not leads_out(path, project.root):
        return True
    return path in [project.path(link.name) for link in links(project.root, project.config)]


def _changed_tables(project: Project, was: Mapping[str, Any], tables: Sequence[str]) -> list[str]:
    now = project.config.model_dump(mode="json")
    clauses = []
    for name in [table for table in tables if table in was]:  # a run states the tables it depends on
        for key, value in _keys(now.get(name)).items():
            before = _keys(was.get(name)).get(key, value)  # a key that older versions did not have
            if before != value and (name, key) not in ELSEWHERE | RUNNING:
                where = f"[{name}] {key}" if key else f"[[{name}]]"
                clauses.append(f"{where} of twin.toml has changed since")
    return clauses


def _keys(table: Any) -> Mapping[str, Any]:
    """The keys of a table; an array of tables and a missing table count as one value."""
    return table if isinstance(table, Mapping) else {"": table}


def _changed_versions(was: Mapping[str, str]) -> list[str]:
    now = versions()
    return [
        f"{name} was {was[name]} and is {now[name]}"
        for name in NEEDED
        if name in was and name in now and was[name] != now[name]
    ]
