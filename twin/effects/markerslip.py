"""Effects of the markers: where on the finger a tag sits, and how far off it."""

import re
from dataclasses import replace

import numpy as np

from calibrate import Parameter
from fe.element import Integers
from fe.mesh.mirror import middle_plane
from twin.effects.phrases import felt, listed, number, way
from twin.effects.protocol import Effect, Order, Slip, Test, Theta, symmetric
from twin.targets import Array

TIMES = 20  # at which a slip is looked for, over all of a film
CLOSER = 25  # and then between two of these
SIDE = 0.8  # of half the finger's width from its middle plane: a marker further out sits on a side face
# A tag of 5 mm that slipped by a tenth of its size is seen by eye (judgement); glue gives way by less.
LIKELY = 0.5  # mm
UP = np.array([0.0, 0.0, 1.0])
WAYS = (
    ("along the finger towards the tip", "along the finger towards the clamp"),
    ("across it (up on a side face, to +y elsewhere)", "across it (down on a side face, to -y elsewhere)"),
)


class MarkerSlip(Effect):
    """A tag slips on the finger, once: from a time on it sits `along` mm further to the tip, and `across` mm
    across the finger (up on a side face, to +y elsewhere), as the finger lies undeformed.

    What is seen moves with the finger's surface, s (e + du/de): turned and stretched with it. Marker and time
    are looked for on a grid and then held: `marker_slip:p3@10s` has the two lengths alone. marker: its name,
    time: in s on the film's clock, both or none.
    """

    name, order = "marker_slip", Order.SLIP
    sentence, generic = "a marker has slipped on the finger", "slip"
    held = "marker_slip:p3@10.1s"

    def __init__(self, marker: str = "", time: float = 0.0) -> None:
        self.marker, self.time = marker, float(time)
        lengths = symmetric(
            "marker_slip.along", "marker_slip.across", most=3.0, unit="mm", step=0.05, likely=LIKELY
        )
        free = (
            Parameter("marker_slip.marker", 0.0, 1e4, "", typical=1.0),
            Parameter("marker_slip.time", -1e6, 1e6, "s", typical=1.0),
        )
        self.parameters = lengths if marker else (*lengths, *free)

    @property
    def label(self) -> str:
        return f"{self.name}:{self.marker}@{self.time:.6g}s" if self.marker else self.name

    def named(self, label: str) -> Effect | None:
        match = re.fullmatch(rf"{self.name}:(.+)@([-+]?\d+\.?\d*(?:e[-+]?\d+)?)s", label)
        return MarkerSlip(match[1], float(match[2])) if match else None

    def tries(self, test: Test) -> tuple[Theta, ...]:
        if self.marker:
            return ({},)
        return _grid(np.flatnonzero(test.moving), between(test.path.output, TIMES))

    def closer(self, entry: Theta, test: Test) -> Effect | None:
        """The same with the times between the neighbours of an entry of `tries`, at that entry's marker."""
        return None if self.marker else _Closer(entry)

    def at(self, entry: Theta, test: Test) -> Effect:
        if self.marker:
            return self
        marker = test.markers[round(entry["marker_slip.marker"])]
        return MarkerSlip(marker, float(f"{entry['marker_slip.time']:.6g}"))

    def before(self, test: Test, theta: Theta) -> Test:
        row, time = self._which(test, theta)
        slips = tuple(
            Slip(row, time, theta[f"marker_slip.{component}"], axis)
            for component, axis in zip(("along", "across"), _surface(test, row), strict=True)
        )
        return replace(test, slips=(*test.slips, *slips))

    def told(self, values: Theta) -> str:
        sizes = [values[f"{self.name}.{k}"] for k in ("along", "across")]
        parts = [f"{number(mm)} mm {way(mm, *ends)}" for mm, ends in zip(sizes, WAYS, strict=True)]
        much = listed([parts[k] for k in felt(sizes)]) or "0 mm"
        if self.marker:
            return f"marker {self.marker} slipped by {much} at {self.time:.3g} s"
        return f"a marker slipped by {much} at {values[f'{self.name}.time']:.3g} s"

    def _which(self, test: Test, theta: Theta) -> tuple[int, float]:
        """The row of the marker among the test's points, and the time in s."""
        if not self.marker:
            row = round(theta["marker_slip.marker"])
            return min(max(row, 0), len(test.points) - 1), theta["marker_slip.time"]
        return _row(self, test, self.marker), self.time


class MarkerStandoff(Effect):
    """Tags on pins, heads or thick tape: the markers stand `mm` mm off the structure, above it (towards +z),
    and turn with it.

    A marker is seen h (e_z + du/dz) beside its point of the structure, from the first picture on. Laws:
    `marker_standoff`, of all markers alike, and `marker_standoff:one`, of one, which is looked for and then
    held: `marker_standoff:p3`. marker: its name, ONE, or "" for all.
    """

    name, order, held = "marker_standoff", Order.SLIP, "marker_standoff:p3"
    sentence = "markers stand off the surface, and turn with it"
    ONE = "one"

    def __init__(self, marker: str = "") -> None:
        self.marker = marker
        # pins and printed tags on foam are 1 to 2 mm high (judgement)
        height = symmetric("marker_standoff.mm", most=5.0, unit="mm", step=0.1, likely=2.0)
        free = (Parameter("marker_standoff.marker", 0.0, 1e4, "", typical=1.0),)
        self.parameters = (*height, *free) if marker == self.ONE else height

    @property
    def label(self) -> str:
        return f"{self.name}:{self.marker}" if self.marker else self.name

    def laws(self) -> tuple[Effect, ...]:
        return (self, MarkerStandoff(self.ONE))

    def wider(self) -> Effect | None:
        return None if self.marker else MarkerStandoff(self.ONE)

    def named(self, label: str) -> Effect | None:
        name, _, marker = label.partition(":")
        return MarkerStandoff(marker) if name == self.name and marker else None

    def tries(self, test: Test) -> tuple[Theta, ...]:
        rows = np.flatnonzero(test.moving) if self.marker == self.ONE else ()
        return tuple({"marker_standoff.marker": float(row)} for row in rows) or ({},)

    def at(self, entry: Theta, test: Test) -> Effect:
        row = entry.get("marker_standoff.marker")
        return self if row is None else MarkerStandoff(test.markers[round(row)])

    def before(self, test: Test, theta: Theta) -> Test:
        slips = [Slip(row, -np.inf, theta["marker_standoff.mm"], UP) for row in self._rows(test, theta)]
        return replace(test, slips=(*test.slips, *slips))

    def told(self, values: Theta) -> str:
        mm = values["marker_standoff.mm"]
        who = f"marker {self.marker} stands" if self.marker not in ("", self.ONE) else (
            "a marker stands" if self.marker else "the markers stand"
        )  # fmt: skip
        turns = "turn with it" if not self.marker else "turns with it"
        return f"{who} {number(mm)} mm {way(mm, 'above', 'below')} the surface, and {turns}"

    def _rows(self, test: Test, theta: Theta) -> list[int]:
        """The rows of the markers among the test's points."""
        if self.marker == self.ONE:
            return [min(max(round(theta["marker_standoff.marker"]), 0), len(test.points) - 1)]
        if self.marker:
            return [_row(self, test, self.marker)]
        return [int(row) for row in np.flatnonzero(test.moving)]


class _Closer(MarkerSlip):
    """The slip of one marker, looked for at the times about one."""

    def __init__(self, entry: Theta) -> None:
        super().__init__()
        self.entry = dict(entry)

    def tries(self, test: Test) -> tuple[Theta, ...]:
        coarse, here = between(test.path.output, TIMES), self.entry["marker_slip.time"]
        near = int(np.abs(coarse - here).argmin())
        low, high = coarse[max(near - 1, 0)], coarse[min(near + 1, len(coarse) - 1)]
        inside = test.path.output[(test.path.output >= low) & (test.path.output <= high)]
        return _grid(np.array([round(self.entry["marker_slip.marker"])]), between(inside, CLOSER))


def between(output: Array, most: int) -> Array:
    """Times (k,) s midway between neighbouring outputs (s,) s, at most `most` of them, evenly chosen.

    >>> between(np.arange(6.0), 3)
    array([0.5, 2.5, 4.5])
    """
    if len(output) < 2:
        return np.asarray(output[:1], float)
    half = (output[1:] + output[:-1]) / 2
    return np.asarray(half[np.unique(np.linspace(0, len(half) - 1, most).round().astype(int))], float)


def _grid(rows: Integers, times: Array) -> tuple[Theta, ...]:
    return tuple(
        {"marker_slip.marker": float(r), "marker_slip.time": float(f"{t:.6g}")} for t in times for r in rows
    )


def _row(effect: Effect, test: Test, marker: str) -> int:
    """The row of a marker among the test's points; ValueError where it has none of that name."""
    if marker not in test.markers:
        names = ", ".join(n for n, m in zip(test.markers, test.moving, strict=True) if m)
        raise ValueError(f"effect {effect.label!r}: no marker {marker!r}; wanted one of {names}")
    return test.markers.index(marker)


def _surface(test: Test, row: int) -> tuple[Array, Array]:
    """The directions along and across the finger in the surface that a marker sits on."""
    y, middle = test.case.nodes[:, 1], middle_plane(test.case)
    aside = abs(float(test.points[row, 1]) - middle) > SIDE * float(np.abs(y - middle).max())
    return np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]) if aside else np.array([0.0, 1.0, 0.0])
