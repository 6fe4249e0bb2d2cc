"""What to do about keywords of a deck that are not supported: the smallest edit that helps."""

from collections.abc import Iterable
from pathlib import Path

from fe.deck.keywords import Keyword

BODY = "the pressure must act on *SURFACE of the chamber's faces, by *DSLOAD"
REMEDIES = {
    "CONTACT PAIR": "remove it: walls that touch are not in a deck's model",
    "CONTACT": "remove it: walls that touch are not in a deck's model",
    **dict.fromkeys(
        ("SURFACE INTERACTION", "SURFACE BEHAVIOR", "FRICTION", "CONTACT INCLUSIONS",
         "CONTACT PROPERTY ASSIGNMENT"),
        "remove it with its contact",
    ),
    "SHELL GENERAL SECTION": "use *SHELL SECTION with a thickness and *ELASTIC",
    "USER MATERIAL": "state *HYPERELASTIC",
    "ELCOPY": "write the elements out",
    "ORIENTATION": "remove it, with ORIENTATION= of its section: materials are isotropic",
    "EMBEDDED ELEMENT": "replace the embedded sheet by shells tied to a face (*TIE), or remove it",
    "REBAR LAYER": "replace it by a sheet: *SHELL SECTION with thickness, modulus and *TIE",
    "FLUID CAVITY": f"remove it; {BODY}",
    "FLUID BEHAVIOR": f"remove it; {BODY}",
    "PHYSICAL CONSTANTS": "remove it: nothing here depends on them",
    "DYNAMIC": "replace it by *STATIC: inertia is not solved for",
    "TRANSFORM": "state *BOUNDARY along x, y, z",
    "SYSTEM": "state nodes in one global frame",
    "HYPERFOAM": "state *HYPERELASTIC with D1",
    "PLASTIC": "remove it: the material stays elastic",
    "SPRING": "remove it, or hold its nodes by *BOUNDARY",
    "CONNECTOR SECTION": "remove it, or tie the surfaces by *TIE",
    "DISTRIBUTING": "replace it by *KINEMATIC, or load the nodes themselves by *CLOAD",
    "INITIAL CONDITIONS": "remove it: the structure is free of stress at rest",
}


def refused(unknown: Iterable[Keyword], deck: Path, readers: Iterable[str]) -> ValueError:
    """The error that names keywords with their lines, and what to do about each kind."""
    named = list(unknown)
    kinds = dict.fromkeys(k.name for k in named)
    told = [f"*{name}: {REMEDIES[name]}" for name in kinds if name in REMEDIES]
    if len(told) < len(kinds):
        others = "the others" if told else "them"
        told.append(f"remove {others} or express {others} by {', '.join('*' + n for n in readers)}")
    return ValueError(
        f"{deck}: not supported: {', '.join(f'*{k.name} ({_where(k, deck)})' for k in named)}; wanted a "
        f"deck without; {'; '.join(told)}"
    )


def _where(k: Keyword, deck: Path) -> str:
    return f"line {k.place.line}" + ("" if k.place.file == deck else f" of {k.place.file}")
