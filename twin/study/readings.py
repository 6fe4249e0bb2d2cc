"""A finger and an objective -> where one could read more displacements, and several readings at once."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fe import Case
from twin.laws.law import Constants
from twin.study.separability import Known, Outcomes, Spot, knowledge
from twin.targets import Array, Targets

Mask = NDArray[np.bool_]
ALONG = 8  # spots along the line on which the markers sit


class Several(Known):
    """Several readings that could be added at once, and what is known with them."""

    words: str
    count: int


def spots(case: Case, targets: Targets, rows: Sequence[int]) -> tuple[Spot, ...]:
    """The points of these rows of the targets, and nodes along the finger on the line through the first."""
    places = targets.places(case.position)
    own = [Spot(name=targets.names[r], node=targets.points[r].node or 0, place=places[r]) for r in rows]
    known = {spot.node for spot in own}
    more = [row for row in _along(case, own[0].place) if int(case.labels[row]) not in known]
    return (
        *own,
        *(
            Spot(name=f"x = {case.nodes[r, 0]:.0f} mm", node=int(case.labels[r]), place=case.nodes[r])
            for r in more
        ),
    )


def _along(case: Case, place: Array) -> list[int]:
    """Rows of nodes, evenly along x, that have y and z of a place; none where few nodes do."""
    near = 1e-6 * float(np.ptp(case.nodes, axis=0).max())
    line = np.flatnonzero((np.abs(case.nodes[:, 1:] - place[1:]) < near).all(axis=1))
    if len(line) < ALONG:
        return []
    x = case.nodes[line, 0]
    wanted = np.linspace(x.min(), x.max(), ALONG + 1)[1:]
    return list(dict.fromkeys(int(line[np.argmin(np.abs(x - v))]) for v in wanted))


def plans(
    shown: Outcomes,
    *,
    information: Array,
    constants: Constants,
    sd_mm: float,
    names: Sequence[str],
    component: int,
    top: float,
) -> list[Several]:
    """What is known with several readings more, none beyond the top pressure in MPa, the least work first.

    information (2, 2): of what is there. names: the points that are read already, the first spots; component:
    their direction.
    """
    return [
        Several(words=words, count=int(seen.sum()),
                **knowledge(information + shown.information(seen, sd_mm), constants, sd_mm))
        for words, seen in _asked(shown, names, component, top)
    ]  # fmt: skip


def _asked(shown: Outcomes, names: Sequence[str], component: int, top: float) -> list[tuple[str, Mask]]:
    """In words what is read, and a mask (s, p, 3) of it."""

    def readings(*where: Sequence[int]) -> Mask:
        seen = np.zeros(shown.u.shape, bool)
        seen[np.ix_(*(np.array(w, int) for w in where))] = True
        return seen

    steps = [int(s) for s in np.flatnonzero(shown.pressure <= top * (1 + 1e-9))]
    own, every = range(len(names)), range(len(shown.spots))
    seen = sorted({0, 2, component})  # a camera that looks along y sees x and z
    others = [i for i in seen if i != component]
    at = f"{len(steps)} pressures up to {1e3 * top:.3g} kPa"
    points, more = " and ".join(names), f"{len(every)} points"
    read, both, other = (_directions(i) for i in ([component], seen, others))
    return [
        (f"{other} of {points} at the same pressure", readings(steps[-1:], own, others)),
        (f"{read} of {points} at {at}", readings(steps[:-1], own, [component])),
        (f"{both} of {points} at {at}", readings(steps, own, seen)),
        (f"{both} of {more} at {at}", readings(steps, every, seen)),
    ]


def _directions(components: Sequence[int]) -> str:
    return " and ".join(f"U{i + 1}" for i in components)
