"""Checks without the model, where several explanations fit equally well.

A gauge is checked, a finger weighed, a marker looked at: each explanation shows something else. `choice`
plans films of the same finger, by what its models would show in them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from twin.effects.labels import AND, kind_of, name_of
from twin.effects.library import all_effects
from twin.effects.markerslip import MarkerSlip
from twin.effects.protocol import Effect


@dataclass(frozen=True)
class Witness:
    """A test that needs no model: what is done, and of each explanation that shows in it what is seen."""

    test: str
    shows: tuple[tuple[str, str], ...]

    @property
    def words(self) -> str:
        """The test, and what it decides: "weigh the finger (gravity, where it has a weight at all)"."""
        seen = "; ".join(f"{label}, where {what}" for label, what in self.shows)
        return f"{self.test} ({seen})"


NOTHING = ""  # where an effect does not show though others of its kind do
PEEL = "look at the markers in the film, one by one"
# The quickest first. What is seen where an effect, or anything of a kind, is the right explanation.
CHECKS: tuple[tuple[str, Mapping[str, str]], ...] = (
    (
        PEEL,
        {
            "slip": "one moves on the finger",
            "marker_slip": "it moves on the finger",
            "marker_standoff": "they stand off it",
        },
    ),
    (
        "disconnect the supply line at rest and see whether the finger moves",
        {"tube": "it moves", "outside force": "something else moves it, and the line does not"},
    ),
    (
        "read the gauge without pressure, before and after the film",
        {"pressure_offset": "it does not read zero"},
    ),
    (
        "weigh both castings",
        {"wall_thickness": "the one with the thicker walls is heavier"},
    ),
    (
        "weigh the finger, or turn it over and film it again",
        {"gravity": "it is as heavy as was fitted, and hangs the other way"},
    ),
    (
        "film a ruler and a plumb line in the finger's plane",
        {"camera_scale": "the ruler has another length", "camera_rotation": "the line is not upright"},
    ),
    (
        "take new pictures of the board where the finger moves, or add a second camera",
        {
            "camera": "the displacements change with the new calibration",
            "camera_tilt": "they change most towards the tip or the top",
            "camera_breathing": "the finger comes nearer to the camera as it bends",
        },
    ),
    (
        "switch a lamp with the valve, in view of the camera",
        {"time_shift": "lamp and pressure log differ"},
    ),
    (
        "check the gauge against a second one or a water column, at rest and at three pressures",
        {
            "pressure course": "they differ",
            "pressure_gain": "they differ by the same factor",
            "pressure_offset": "they differ by the same amount",
            "pressure_lag": NOTHING,
            "time_shift": NOTHING,
        },
    ),
    (
        "film two markers on the clamp",
        {
            "clamp": "they turn in proportion to the load",
            "play": "they turn suddenly",
            "drift": "they move with time",
        },
    ),
    (
        "film the unloaded finger for two minutes, before and after the course of pressure",
        {
            "creep": "it comes back slowly afterwards",
            "mullins": "it rests as before, and each new cycle repeats the last one",
            "drift": "it moves before, too",
            "thermal": "it rests as before, and each new cycle differs from the last one",
        },
    ),
    (
        "film another course of the pressure, ten times slower",
        {
            "pressure_lag": "the difference goes away",
            "creep": "the difference grows under load",
            "pressure course": "the difference goes with the course",
            "pressure_gain": NOTHING,
            "pressure_offset": NOTHING,
            "time_shift": NOTHING,
        },
    ),
    ("tap the tip of the finger at rest, and film it", {"inertia": "it swings on", "pressure_lag": NOTHING}),
    ("measure the temperature at the finger during a film", {"thermal": "it changes"}),
    (
        "lift the finger off everything below and beside it, and film it again",
        {"contact": "it bends further", "friction": "way up and way down agree better"},
    ),
    (
        "lay the unloaded finger on a flat table, on its side",
        {"precurvature": "it is not straight", "twist": "it is twisted"},
    ),
    (
        "film the finger from the front, along its axis",
        {
            "eccentric_core_y": "it bends aside as the pressure rises",
            "twist": "it turns about its axis",
            "outside force": "it is pulled aside at rest, too",
            "tube": NOTHING,
        },
    ),
    (
        "press the finger along its length with the same weight, and watch its walls at top pressure",
        {
            "soft spot": "it gives way at one place",
            "ballooning": "a wall bulges at one place",
            "fold": "a wall folds or buckles",
        },
    ),
    (
        "pull a strip of the same silicone, twice and with a hold",
        {
            "modulus": "it is stiffer or softer by as much",
            "constants": "its curve is another",
            "stiffening": "its curve bends off the Mooney-Rivlin law",
            "mullins": "the second pull is softer",
            "creep": "its force falls in the hold",
        },
    ),
    (
        "weigh a piece of the silicone in air and in water",
        {"compressibility": "it is lighter than silicone without bubbles"},
    ),
    (
        "cut the finger across at three places, after all films, and measure its walls",
        {
            "wall_thickness": "they are all thicker or thinner",
            "wall_taper": "they differ from base to tip",
            "eccentric_core": "top and bottom differ",
            "eccentric_core_y": "left and right differ",
            "ballooning": "they are thin at one place",
            "strain_limiting_layer": "there is a layer in the bottom",
            "hoop_reinforcement": "fibres or a sleeve lie around it",
        },
    ),
)


def witnesses(labels: Sequence[str], *, users: Sequence[Effect] = ()) -> tuple[Witness, ...]:
    """Tests that tell explanations apart which fit equally well, the one to do first first; none for fewer
    than two, and none where no test of the list shows a difference.

    labels: as a verdict names them, of effects (`creep:2`, `tube + gravity`) or kinds of stand-in (`camera`,
    "an error of the camera"). own: effects of the user's own files. Of the list, the test that separates the
    most pairs, then the one that separates the most of the others, and so on; of equals the one in which more
    of them show.
    """
    generic = {e.name: e.generic for e in (*all_effects(), *users)}
    rows = [(test, {label: _seen(label, shows, generic) for label in labels}) for test, shows in CHECKS]
    open_pairs, out = set(combinations(labels, 2)), []
    while open_pairs:
        test, seen = max(rows, key=lambda row: (len(_parted(row[1], open_pairs)), _count(row[1])))
        parted = _parted(seen, open_pairs)
        if not parted:
            break
        open_pairs -= parted
        shows = tuple((label, what) for label, what in seen.items() if what)
        out.append(Witness(_at_marker(test, labels), shows))
    return tuple(out)


def in_words(tests: Sequence[Witness]) -> str:
    """The checks in a sentence; "" without one."""
    if not tests:
        return ""
    begin, *others = (w.words for w in tests)
    return f"To tell them apart without the model, {'; then '.join([begin, *others])}."


def _seen(label: str, shows: Mapping[str, str], generic: Mapping[str, str]) -> str:
    """The observation of a test where a label is right; of effects together, of each of them."""
    sights = []
    for effect in label.split(AND):
        kind, name = kind_of(effect), name_of(effect)
        sights += [
            shows.get(kind, NOTHING) if kind else shows.get(name, shows.get(generic.get(name, ""), NOTHING))
        ]
    return " and ".join(dict.fromkeys(filter(None, sights)))


def _parted(seen: Mapping[str, str], pairs: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """The pairs of labels that a test tells apart."""
    return {(a, b) for a, b in pairs if seen[a] != seen[b]}


def _at_marker(test: str, labels: Sequence[str]) -> str:
    """The test, with the markers and times that labels hold."""
    slips = [MarkerSlip().named(effect) for label in labels for effect in label.split(AND)]
    held = [f"marker {e.marker} in the film at {e.time:.3g} s" for e in slips if isinstance(e, MarkerSlip)]
    return f"look at {' and '.join(held)}" if held and test == PEEL else test


def _count(seen: Mapping[str, str]) -> int:
    """The number of labels that show in a test."""
    return sum(map(bool, seen.values()))
