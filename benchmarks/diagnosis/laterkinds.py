"""Hidden kinds that are written after the rule was frozen, by someone who has not read it.

Each is a `twin.virtual.hidden.Kind` of a name that `KINDS` has not: another law of an effect of the library
(`law="other"`, `physics` its name) or none of it (`law="unknown"`). A kind of `part` `path` or `picture`
needs nothing else; one of `static` or `history` is solved first, by
`python benchmarks/diagnosis/snapshots.py --later --pack`. They are the group `later` of `identify.py`.
"""

from twin.virtual.hidden import Kind

KINDS_LATER: dict[str, Kind] = {}
STAND_INS_LATER: dict[str, tuple[str, ...]] = {}  # as `identify.STAND_INS_OF`, for those that are unknown

__all__ = ["KINDS_LATER", "STAND_INS_LATER"]
