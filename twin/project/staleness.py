"""Changes of a project since a run was made: files, tables of twin.toml, format."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from twin import files
from twin.project.folder import Project
from twin.project.record import changed_files, changed_format, changed_place, changed_tables
from twin.project.trust import leads_out, links

# The effects of a fit stand in fit.json: twin.toml gets them after the fit. Names of own effect files say
# nothing of what they hold, which the digests do.
ELSEWHERE = {("model", "effects"), ("model", "effect_files")}
# How a job runs changes no figure; which program solves does.
RUNNING = {("model", f"engine_{key}") for key in ("cpus", "jobs", "memory", "command", "timeout_s")}


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
    now, was = project.config.model_dump(mode="json"), info.config.model_dump(mode="json", exclude_unset=True)
    states = {name: now[name] for name in tables if name in was and name in now}  # a run states what it reads
    stated = project.config.model_dump(mode="json", exclude_defaults=True)
    return [
        *changed_format(info),
        *changed_files(recorded, _files(project, recorded, present)),
        *(changed_place(*k) for k in changed_tables(was, states, stated) if k not in ELSEWHERE | RUNNING),
    ]


def _files(project: Project, recorded: Iterable[str], present: Sequence[Path]) -> Mapping[str, str]:
    """The digests of the present files, and of the recorded ones that are still there."""
    now = files.digest_of([path for path in present if path.exists()], root=project.root)
    elsewhere = [project.path(name) for name in recorded if name not in now]
    return now | files.digest_of([path for path in elsewhere if _may_read(project, path)], root=project.root)


def _may_read(project: Project, path: Path) -> bool:
    """True for an existing file that is the project's own, or a trusted link."""
    if not path.is_file():
        return False
    if not leads_out(path, project.root):
        return True
    return path in [project.path(link.name) for link in links(project.root, project.config)]
