"""A project folder, opened in a notebook or a script of your own."""

from pathlib import Path

from twin.project.folder import Project
from twin.stages.workbench import Workbench


def open_project(folder: Path | str) -> Workbench:
    """The targets, the structure and the model of the project in a folder; nothing in it is changed.

    `.targets` are the measured displacements, `.model()` is the model with the effects of twin.toml, and
    `twin.stages.fits.newest_fit(bench.project)` its newest fit. ValueError says what the folder lacks.
    """
    return Workbench.of(Project.open(folder))
