"""Protocols of the virtual laboratory: film A, and P1 to P5, each a part of the next.

P1: the tip marker over one ramp. P2: five markers, the same ramp. P3: two cycles at two rates with holds.
P4: P3 in three directions of gravity, of which the last is held out, the finger weighed. P5: P4 with three
markers off the axis and four fixed ones. In P1 to P3 the finger has no weight, and none is stated. `fast` is
for what a film shows after fast steps: five markers at 60 frames a second, the finger weighed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fe import Finger, Path
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.gravity import G
from twin.targets import Array

Corners = Sequence[tuple[float, float]]  # (seconds, kPa) corners, with straight lines between them

FILM_A: Corners = (  # of the reference study, scaled to a top pressure of 30 kPa
    (0.0, 0.0),
    (2.0, 0.0),
    (4.0, 18.0),
    (10.0, 18.0),
    (12.0, 30.0),
    (22.0, 30.0),
    (25.0, 0.0),
    (34.0, 0.0),
    (34.2, 24.0),
    (38.2, 24.0),
    (38.4, 0.0),
    (42.4, 0.0),
)
TOP = 0.03  # MPa
CORNERS = (  # (s, share of the top pressure) of one recording: a slow cycle with a hold, then a fast one
    (0.0, 0.0), (2.0, 0.0), (10.0, 1.0), (19.0, 1.0), (27.0, 0.0), (33.0, 0.0), (34.2, 0.8), (41.0, 0.8),
    (42.2, 0.0), (50.0, 0.0),
)  # fmt: skip
STEPPED = (  # the same of the recording with fast steps: after a slow rise one up, and one down
    (0.0, 0.0), (2.0, 0.0), (4.0, 0.45), (4.4, 0.45), (4.5, 0.6), (5.9, 0.6), (6.0, 0.4), (7.4, 0.4),
)  # fmt: skip
FAST_HZ, FAST_LOG_HZ = 60.0, 200.0  # of its film and log
PERIOD = 60.0  # s from one recording to the next: the finger is turned while it rests
WAYS = ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))  # of gravity: upright, upside down, hanging
RAMP = 10.0  # s, the end of the ramp of P1 and P2
LOG_HZ = 5.0
REST = (0.5, 1.0, 1.5)
FIRST = (2.5, 3.0, 3.75, 4.5, 5.25, 6.0, 6.75, 7.5, 8.25, 9.0, 9.5, 10.0)
LATER = (1.0, 3.0, 4.5, 6.0, 7.5, 9.0)
AFTER = (11.0, 13.0, 15.5, 18.5, 21.0, 23.0, 25.0, 26.5, 28.5, 32.0, 33.6, 34.0, 35.0, 37.0, 40.5, 41.6, 43.5,
         47.5)  # fmt: skip


@dataclass(frozen=True)
class Bench:
    """The measuring side: film rate (1/s), log rate, ripple of the regulator (MPa), noise of gauge (MPa)
    and picture.

    sd (mm) and rho (lag 1) are the picture's noise per marker and axis; static_frames are filmed at rest
    before.
    """

    film_hz: float = 10.0
    log_hz: float = 50.0
    ripple_MPa: float = 1.5e-4
    gauge_sd_MPa: float = 5e-5
    sd: float = 0.0015
    rho: float = 0.3
    common: float = 0.3  # correlation between the markers of one frame, from the shared axes
    static_frames: int = 320
    placement_sd_mm: float = 0.3
    scale_sd: float = 0.001


def pressure(protocol: Corners, time: Array, *, ripple: float) -> Array:
    """True pressure (t,) MPa of a protocol at times (t,) s, with the regulator's ripple in MPa while it is
    on."""
    corner, kpa = np.array(protocol).T
    p = np.interp(time, corner, kpa * 1e-3)
    swing = np.sin(2 * np.pi * 0.7 * time) + 0.5 * np.sin(2 * np.pi * 1.9 * time + 1.0)
    return p + ripple * swing * np.clip(p / 0.005, 0.0, 1.0)


def path(bench: Bench, *, protocol: Corners = FILM_A) -> Path:
    """The true pressure in MPa over a film, by default film A, and the film's frame times in s."""
    end = protocol[-1][0]
    time = np.arange(0.0, end + 0.5 / bench.log_hz, 1 / bench.log_hz)
    true = pressure(protocol, time, ripple=bench.ripple_MPa)
    return Path(time, true, np.arange(0.0, end, 1 / bench.film_hz))


# -- P1 to P5 ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Protocol:
    """A protocol: its name, recordings, whether it ends with the ramp, how many markers lie along the lower
    edge, off the axis and on the rig, and whether it has fast steps."""

    name: str
    recordings: int
    ramp: bool
    along: int
    off_axis: int
    fixed: int
    fast: bool = False

    @property
    def held_out(self) -> int | None:
        """The recording that no fit sees: the last of several."""
        return self.recordings - 1 if self.recordings > 1 else None

    @property
    def weighed(self) -> bool:
        """True where the finger has weight, which the model includes."""
        return self.fast or self.recordings > 1

    @property
    def steps(self) -> Array:
        """Output times (s,) s."""
        if self.fast:
            return np.arange(1, round(STEPPED[-1][0] * FAST_HZ)) / FAST_HZ
        early = [t for t in (*REST, *FIRST, *AFTER) if not self.ramp or t <= RAMP]
        rest = [PERIOD * k + t for k in range(1, self.recordings) for t in (*LATER, *AFTER)]
        return np.array([*early, *rest])

    @property
    def block(self) -> np.ndarray:
        """The recording (s,) of each step."""
        return (self.steps // PERIOD).astype(np.int64)

    @property
    def ways(self) -> Array:
        """The direction of gravity (b, 3) of each recording."""
        return np.array(WAYS[: self.recordings])

    @property
    def course(self) -> Path:
        """The true pressure and gravity over time, with the steps as output times."""
        corners, log_hz = (STEPPED, FAST_LOG_HZ) if self.fast else (CORNERS, LOG_HZ)
        end = RAMP + 0.5 if self.ramp else PERIOD * (self.recordings - 1) + corners[-1][0]
        time = np.round(np.arange(0.0, end + 0.5 / log_hz, 1 / log_hz), 6)
        corner, share = np.array(corners).T
        pressure = TOP * np.interp(time % PERIOD, corner, share)
        turned = 0.5 * (PERIOD - AFTER[-1] - LATER[0])  # half way between the last step and the next
        turn = np.minimum(((time + turned) // PERIOD).astype(int), self.recordings - 1)
        weight = self.weighed * G * self.ways[turn]
        return Path(time, pressure, self.steps, gravity=weight, settled=self.weighed)


PROTOCOLS = {
    p.name: p
    for p in (
        Protocol("P1", 1, True, 1, 0, 0),
        Protocol("P2", 1, True, 5, 0, 0),
        Protocol("P3", 1, False, 5, 0, 0),
        Protocol("P4", 3, False, 5, 0, 0),
        Protocol("P5", 3, False, 5, 3, 4),
        Protocol("fast", 1, False, 5, 0, 0, fast=True),
    )
}


def places(body: Body | Finger) -> Mapping[str, tuple[float, float, float]]:
    """Positions in mm for markers on a body: along its lower side (the tip last), and off1 .. off it."""
    return (BuiltIn.of(body) if isinstance(body, Finger) else body).places
