"""The grammar of effects' names in twin.toml, on the command line, in verdicts and in rankings.

A label is a name, or a name and a law: `creep`, `creep:2`, `creep:wide`, `marker_slip:p3@10.1s`. A verdict
joins names by " + " where effects are missing together, and such groups by " or " where the data cannot tell
them apart: `creep + gravity or tube`. It may name a kind of stand-in beside them, in the words of `KINDS`.
"""

import re

NAME = re.compile(r"[a-z][a-z0-9_]*")
LABEL = re.compile(rf"{NAME.pattern}(:\S([^\n]*\S)?)?")
AND, OR = " + ", " or "
OPEN = "open_dimensions"  # the effect of [model.open]
KINDS = {
    "outside force": "an outside force",
    "friction": "friction on the finger",
    "twist": "a twist of the finger",
    "soft spot": "a soft spot",
    "fold": "a fold of a wall",
    "pressure course": "another course of the pressure",
    "drift": "a drift of the rig",
    "play": "play in the clamp",
    "camera": "an error of the camera",
    "slip": "a slipping marker",
}


def name_of(label: str) -> str:
    """The effect's name in a label.

    >>> name_of("creep:wide"), name_of("marker_slip:p3@10.1s")
    ('creep', 'marker_slip')
    """
    return label.partition(":")[0]


def checked(label: str) -> str:
    """The label; ValueError where it is none.

    >>> checked("creep:2")
    'creep:2'
    """
    if not LABEL.fullmatch(label):
        raise ValueError(
            "wanted the name of an effect, creep, or with its law, creep:2, creep:wide or "
            "marker_slip:p3@10.1s"
        )
    return label


def groups(text: str) -> tuple[tuple[str, ...], ...]:
    """Groups that the data cannot tell apart, named as in a verdict; each is a tuple of the labels that are
    missing together.

    >>> groups("creep + gravity or tube")
    (('creep', 'gravity'), ('tube',))
    """
    return tuple(tuple(group.split(AND)) for group in text.split(OR))


def checked_groups(text: str) -> str:
    """A text that names effects as a verdict does; ValueError where it does not."""
    for group in groups(text):
        for label in group:
            if kind_of(label) is None:
                checked(label)
    return text


def kind_of(words: str) -> str | None:
    """The kind of stand-in that a verdict's words name; None where they name none.

    >>> kind_of("an outside force"), kind_of("creep")
    ('outside force', None)
    """
    return next((kind for kind, phrase in KINDS.items() if words in (kind, phrase)), None)
