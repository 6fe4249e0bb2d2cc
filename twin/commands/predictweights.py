"""What hangs on a finger whose motion is predicted: texts of the command line into loads, and what to say."""

from collections.abc import Sequence

import numpy as np

from twin.calibrated.predictions import WantedCourse
from twin.targets import Load, PointKind, Targets

MORE = 1.001  # times the heaviest weight of the test: it was not tested


def loads_of_words(targets: Targets, texts: Sequence[str]) -> tuple[Load, ...] | None:
    """The weights of texts POINT=GRAMS or X,Y,Z=GRAMS; None without any: those of the first block. ValueError
    where the point is none of the targets', or these know no direction of gravity or no common rest."""
    if not texts:
        return None
    if targets.gravity is None:
        raise ValueError(
            f"--weight {texts[0]}: the targets have no direction of gravity; wanted gravity under [model] of "
            "twin.toml, and density_kg_m3, so that the finger has its own weight, too"
        )
    if targets.rests.any() and 0 not in targets.released:
        raise ValueError(
            f"--weight {texts[0]}: every block of the targets is relative to its own rest, to which a weight "
            "has pulled the finger already; wanted one [reference] for all in targets.toml"
        )
    return tuple(_load(targets, text) for text in texts)


def _load(targets: Targets, text: str) -> Load:
    at, _, grams = text.rpartition("=")
    names = [p.name for p in targets.points if p.kind is not PointKind.FIXED]
    try:
        weight = float(grams)
        place = at if at in names else tuple(float(x) for x in at.split(","))
    except ValueError:
        place = ()
    if not (isinstance(place, str) or len(place) == 3) or not 0 < weight < np.inf:
        raise ValueError(
            f"--weight {text!r}: wanted a point ({', '.join(names)}) or x,y,z in mm, and the grams that hang "
            f"there, such as {names[0]}=20"
        )
    return Load(0, place, weight_g=weight)


def weight_notes(targets: Targets, course: WantedCourse) -> list[str]:
    """A sentence on a weight that is heavier than those that were tested."""
    hung = sum(load.weight_g or 0.0 for load in course.loads or ())
    blocks = {load.block for load in targets.loads}
    grams = [sum(load.weight_g or 0.0 for load in targets.loads if load.block == b) for b in blocks]
    tested = max(grams, default=0.0)
    if hung <= MORE * tested:
        return []
    told = f"more than the {tested:.4g} g" if tested else "nothing"
    return [f"{hung:.4g} g hang on it, and {told} in the test: nobody has seen the silicone's law there."]
