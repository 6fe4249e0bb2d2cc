"""Errors that many values share, and their fitted sizes -> which are larger than stated, in words."""

from collections.abc import Sequence

import numpy as np

from twin.judging.whitening import Whitener
from twin.targets import Array

BEYOND = 4.0  # sd: by noise alone, one of a hundred such errors in 160 measurements
SAID = 3  # of them in a sentence; all stand in comparison.json
# What an error belongs to, by the first part of its name; the other parts fill the braces.
WORDS = {
    "scale": "the scale of all lengths",
    "placement": "the place of marker {} along {}",
    "node": "the material point of marker {} along {}",
    "reference": "the rest position of {} in U{}",
    "hold": "marker {} in the hand in U{}",
    "settling": "what still moves in the hold",
    "frame": "the places of the frame markers",
    "sync": "the clock of the film",
    "readout": "the time that the camera takes to read a picture",
    "camera_clock": "the clock of camera {}",
    "codec": "the picture of marker {} in U{} (compression)",
    "calibration": "the calibration of the camera",
    "pose": "the finger's place in the frame",
    "height": "the height of marker {} above the frame markers' plane",
    "out_of_plane": "the motion of marker {} towards the camera",
    "law": "the law of {}",
    "mesh": "the error of the mesh",
    "wall": "{}, which no camera sees",
    "discretisation": "the error of the mesh",
    "gauge": "the pressure gauge at rest",
}


def subject(name: str) -> str:
    """The quantity that a mode of this name is an error of, in words.

    >>> subject("sync"), subject("placement:tip:x")
    ('the clock of the film', 'the place of marker tip along x')
    """
    name, _, film = name.partition("@")
    if film:
        return f"{subject(name)} in film {film}"
    kind, *rest = name.split(":")
    if kind == "reference" and rest:
        rest[0] = "all markers" if rest[0] == "shared" else f"marker {rest[0]}"
    try:
        return WORDS[kind].format(*rest)
    except (KeyError, IndexError):
        return f"the shared error {name}"


def beyond(w: Whitener, residual: Array) -> tuple[tuple[str, float], ...]:
    """Names of shared errors that a residual (s, p, 3) mm asks to be more than BEYOND sd, and their sizes in
    sd, the largest first."""
    amplitudes = w.amplitudes(residual)[: w.shared]
    order = [int(k) for k in np.argsort(-np.abs(amplitudes)) if abs(amplitudes[k]) > BEYOND]
    return tuple((w.names[k], float(amplitudes[k])) for k in order)


def in_words(rows: Sequence[tuple[str, float]], *, fits: bool) -> str:
    """A sentence on shared errors beyond what is stated of them; nothing where there are none.

    fits: whether the model agrees, which it then does only with them. Of errors that are called the same the
    largest counts.
    """
    if not rows:
        return ""
    largest: dict[str, float] = {}
    for name, size in rows:
        largest.setdefault(subject(name), size)
    (what, size), *others = list(largest.items())[:SAID]
    clauses = [f"{what} were off by {abs(size):.0f} sd"]
    clauses += [f"{what} by {abs(size):.0f} sd" for what, size in others]
    more = len(largest) - SAID
    clauses += [f"{more} more error{'s' * (more > 1)} by more than {BEYOND:.0f} sd"] if more > 0 else []
    listed = " and ".join(filter(None, [", ".join(clauses[:-1]), clauses[-1]]))
    return f" It {'agrees only' if fits else 'would not fit even'} if {listed}."
