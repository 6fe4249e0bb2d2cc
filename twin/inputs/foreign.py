"""Displacements in the format of another program, as targets of a new project."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.project import files
from twin.project.folder import Say
from twin.project.record import SourceRecord
from twin.targets import Targets

if TYPE_CHECKING:  # only who brings such a file pays for its readers
    from twin.formats.supplied import Supplied


@dataclass(frozen=True)
class Foreign:
    """Displacements in the format of another program: its name, and what the user states of the file."""

    form: str
    stated: "Supplied"


def foreign_of(
    form: str | None,
    *,
    sd_mm: float | None,
    fixed: Sequence[str] | None,
    origin_mm: str | None,
    **stated: Any,
) -> Foreign | None:
    """What the options of `twin init` say of another program's file, None without --format."""
    if form is None:
        if sd_mm is not None or stated["log"] is not None:
            raise ValueError(
                "--sd-mm and --log belong to --format, which is missing: name the program that wrote the "
                "file of --targets"
            )
        return None
    from twin.formats.supplied import Supplied, position_of

    if sd_mm is None:
        raise ValueError(
            "--sd-mm is missing: wanted the standard deviation of one position in mm, as the scatter of a "
            "point at rest shows it"
        )
    origin = None if origin_mm is None else position_of(origin_mm)
    return Foreign(form, Supplied(sd_mm=sd_mm, fixed=tuple(fixed or ()), origin_mm=origin, **stated))


def import_targets(targets: Path, foreign: Foreign, *, nodes: Mapping[str, int], say: Say) -> Targets:
    """The targets of another program's file. ValueError where it is not right, or something is not stated."""
    from twin.formats.catalogue import read_recorded
    from twin.formats.conversion import targets_of

    found = read_recorded(targets, foreign.form, foreign.stated.doubt)
    made, remarks = targets_of(found, foreign.stated, nodes=nodes)
    for sentence in remarks:
        say(sentence)
    peak, top = np.nanmax(np.abs(made.value)), made.pressure.max()
    say(
        f"{len(made.names)} points in {len(made.time)} steps: displacements up to {peak:.1f} mm, pressure up "
        f"to {top:.3g} MPa. The sd is {foreign.stated.sd_mm:g} mm, as stated."
    )
    return made


def source_of(targets: Path, foreign: Foreign) -> SourceRecord:
    """What source.json tells: where the targets come from, and what was stated of them."""
    stated = {key: str(v) if isinstance(v, Path) else v for key, v in asdict(foreign.stated).items()}
    paths = [path for path in (targets, foreign.stated.log) if path is not None]
    digests = {path.name: files.digest_of([path], root=path.parent) for path in paths}
    return SourceRecord(format=foreign.form, files=digests, stated=stated)
