"""All stand-ins for a test, plain explanations that are no effects of the library."""

import numpy as np

from twin.effects.markerslip import between
from twin.effects.protocol import Test
from twin.effects.standin import Span, StandIn
from twin.effects.standinforces import Fold, Friction, LateForce, OutsideForce, SoftSpot, Twist
from twin.effects.standinmotions import ClampPlay, MarkerJump, MarkerPeel, MountingDrift, WrongPicture
from twin.effects.standinpressure import PressureCourse, PressureCurve, PressureWay

FORCES = (0.35, 0.6, 0.8, 1.0)  # of the length from the clamp
GROWING = LATE = RUBBING = ASIDE = (0.6, 1.0)
SPOTS = (0.1, 0.3, 0.5, 0.7, 0.9)
FOLDS = (0.2, 0.5, 0.8)
MARKERS, TIMES = 8, 2  # slips: of so many markers at so many times


def stand_ins(test: Test) -> tuple[StandIn, ...]:
    """All stand-ins for a test, about 120 amplitudes at most; those aside and the twists need all of the
    finger."""
    span, ways = Span.of(test), ("along", "up")
    rows = np.flatnonzero(test.moving)
    if len(rows):
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, MARKERS).round().astype(int))]
    markers, times = [test.markers[row] for row in rows], between(test.path.output, TIMES + 2)[1:-1]
    return (
        *(OutsideForce(place, ways) for place in FORCES),
        *(OutsideForce(place, ways, growing=True) for place in GROWING),
        *(LateForce(place, span) for place in LATE),
        *(OutsideForce(place, ("aside",)) for place in ASIDE),
        *(Friction(place, span, fading=fading) for fading in (False, True) for place in RUBBING),
        Twist(),
        Twist(growing=True),
        *(SoftSpot(place) for place in SPOTS),
        *(Fold(place, span) for place in FOLDS),
        PressureCurve(span),
        PressureCourse(span),
        PressureWay(span),
        MountingDrift(span),
        ClampPlay(span),
        WrongPicture(),
        *(MarkerJump(marker, times) for marker in markers),
        *(MarkerPeel(marker, span) for marker in markers),
    )
