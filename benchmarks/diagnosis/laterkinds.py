"""Hidden kinds of the folder `kinds`, one file each, by people who do not know the rule.

A file of some twenty lines holds one `twin.virtual.hidden.Kind` as `KIND`: another law of an effect of the
library (`law="other"`, `physics` its name), or none of it (`law="unknown"`, with its `mechanism`, and as
`STAND_INS` the kinds of stand-ins that would say it, names, or how names begin, with an underscore). A kind
of `part` `path` or `picture` needs nothing else; one of `static` or `history` is solved first, by
`python benchmarks/diagnosis/snapshots.py --later --pack`. They are the group `later` of `identify.py`.
"""

import importlib.util
from pathlib import Path
from types import ModuleType

from twin.virtual.hidden import Kind

FOLDER = Path(__file__).with_name("kinds")


def read(folder: Path = FOLDER) -> list[ModuleType]:
    """The files of a folder, by name; ValueError of one that holds no kind, or one that has another name."""
    found = []
    for file in sorted(folder.glob("*.py")):
        spec = importlib.util.spec_from_file_location(f"kind_{file.stem}", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        kind = getattr(module, "KIND", None)
        if not isinstance(kind, Kind) or kind.name != file.stem:
            raise ValueError(f"{file}: wanted KIND = Kind(name={file.stem!r}, ...)")
        found.append(module)
    return found


_FILES = read()
KINDS_LATER: dict[str, Kind] = {file.KIND.name: file.KIND for file in _FILES}
STAND_INS_LATER: dict[str, tuple[str, ...]] = {  # as `identify.STAND_INS_OF`, for those that are unknown
    file.KIND.name: file.STAND_INS for file in _FILES if hasattr(file, "STAND_INS")
}

__all__ = ["KINDS_LATER", "STAND_INS_LATER"]
