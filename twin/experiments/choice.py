"""Experiments that tell effects apart which explain the data equally well: for each the separation in sds
that it would bring, and its minutes.

Every effect is taken for the truth in turn, at its fitted values, and the others mimic it as well as they can
on the data there are and on the new ones together (`mimicry`). New films come with the errors of this one;
what is measured by itself (a weight, the gauge) is a single value with its sd.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from fe.mesh.points import nearest
from twin.effects.protocol import Unsolvable
from twin.experiments.plannederrors import Outlook, Rows, measured, separation
from twin.experiments.plannedfilms import Film, Shown, heavy, remembers, responses
from twin.gravity import is_heavy
from twin.judging.whitening import Whitener
from twin.model.prediction import Model
from twin.targets import Array, Targets

APART = 5.0  # sds that tell two effects apart beyond doubt
SURE = 3.0  # sds below which a test promises too little to be worth its time
MOST = 3  # effects that are compared; each costs a solve
MORE = 3  # markers that are added at one place, of as many places
HIGHER = 1.2  # of the top pressure
DOWN = np.array([0.0, 0.0, -1.0])
WEIGHING = 5.0  # minutes


@dataclass(frozen=True, kw_only=True)
class Filming:
    """An experiment that films the finger with its present markers, and its minutes."""

    film: Film
    minutes: float


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """An experiment that measures quantities without a film: sds of the parameters that it tells, in their
    units, of those in `of_top` in shares of the top pressure."""

    name: str
    minutes: float
    sd: Mapping[str, float]
    of_top: tuple[str, ...] = ()


def _cycles() -> tuple[tuple[float, float], ...]:
    slow = [(2.0 + 20.0 * k + t, p) for k in range(2) for t, p in ((0.0, 0.0), (10.0, 1.0))]
    fast = [(42.0 + 2.0 * k + t, p) for k in range(4) for t, p in ((0.0, 0.0), (1.0, 1.0))]
    return ((0.0, 0.0), *slow, *fast, (50.0, 0.0), (55.0, 0.0))


AGAIN = "repeat the film"
FILMS = (
    Filming(film=Film(name=f"{AGAIN} as it was"), minutes=5.0),
    Filming(
        film=Film(
            name="film a step to the top pressure within 0.1 s at 30 frames/s",
            corners=((0.0, 0.0), (1.0, 0.0), (1.1, 1.0), (6.0, 1.0), (6.1, 0.0), (10.0, 0.0)),
            hz=30.0,
        ),
        minutes=5.0,
    ),
    Filming(
        film=Film(
            name="hold the top pressure for 60 s",
            corners=((0.0, 0.0), (2.0, 0.0), (4.0, 1.0), (64.0, 1.0), (66.0, 0.0), (96.0, 0.0)),
            hz=4.0,
        ),
        minutes=6.0,
    ),
    Filming(
        film=Film(name="film two cycles of 20 s and four of 2 s", corners=_cycles(), hz=10.0), minutes=5.0
    ),
    Filming(film=Film(name="film it upside down", gravity=(0.0, 0.0, 1.0)), minutes=10.0),
    Filming(film=Film(name="film it hanging, tip down", gravity=(1.0, 0.0, 0.0)), minutes=10.0),
    Filming(film=Film(name="film it lying flat as drawn", gravity=(0.0, 0.0, -1.0)), minutes=10.0),
    Filming(film=Film(name=f"film up to {HIGHER:g} times the top pressure", top=HIGHER), minutes=5.0),
)
MEASUREMENTS = (
    Measuring(name="weigh the finger", minutes=WEIGHING, sd={"gravity.density": 2e-11}),
    Measuring(
        name="check the pressure gauge against a second one",
        minutes=10.0,
        sd={"pressure_gain.gain": 2e-3, "pressure_offset.offset": 2e-3},
        of_top=("pressure_offset.offset",),
    ),
    Measuring(name="film a ruler in the finger's plane", minutes=5.0, sd={"camera_scale.scale": 1e-3}),
    Measuring(
        name="film a board that stands level in the finger's plane",
        minutes=10.0,
        sd={"camera_tilt.aside": 5e-3, "camera_tilt.up": 5e-3, "camera_rotation.angle": 2e-3},
    ),
    Measuring(name="film a lamp that switches with the valve", minutes=10.0, sd={"time_shift.s": 0.02}),
    Measuring(
        name="detach the supply line at rest and see whether the finger moves",
        minutes=5.0,
        sd={"tube.up": 5e-3, "tube.along": 5e-3},
    ),
)


@dataclass(frozen=True)
class Member:
    """One of several effects that explain the data equally well: its model at its fit, theta (d,)."""

    model: Model
    theta: Array


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A test that could be made next: how far apart it brings the two that it separates least, in sds, and
    how long it takes."""

    experiment: str
    sigmas: float
    minutes: float

    @property
    def words(self) -> str:
        """The test with its cost and what it brings."""
        return f"{self.experiment} ({self.minutes:.0f} minutes): {_number(self.sigmas)} sigma apart"


def next_experiments(
    members: Sequence[Member], targets: Targets, w: Whitener
) -> tuple[Experiment, ...]:
    """The experiments of the list for effects that these data cannot tell apart, the one to do first first.

    First those that separate by APART sds, the quickest first; then the others, the most telling first.
    members: at most MOST of them are used. w: the whitener of the targets. One solve for each member serves
    all films.
    """
    if len(members) < 2:
        return ()
    bench = _Bench.of(members[:MOST], targets, w)
    return ranked([*bench.films(), *bench.more(), *bench.measurements()])


def ranked(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Experiments in the order in which they are to be done: the quick ones that decide, then by separation.

    >>> rows = [Experiment(experiment="hold", sigmas=3.0, minutes=6.0),
    ...         Experiment(experiment="weigh", sigmas=8.0, minutes=5.0)]
    >>> [e.experiment for e in ranked(rows)]
    ['weigh', 'hold']
    """

    def use(e: Experiment) -> tuple[bool, float, float]:
        return e.sigmas < APART, e.minutes * (e.sigmas >= APART), -e.sigmas

    return tuple(sorted(experiments, key=use))


def in_words(rows: Sequence[Experiment]) -> str:
    """The next experiment in a sentence, with the separation by others; "" without one."""
    if not rows:
        return ""
    best = max(rows, key=lambda e: e.sigmas)
    if best.sigmas < SURE:
        return f"no test of the list tells them apart; the most telling one is to {best.words}"
    others = dict.fromkeys([e for e in (*rows[1:2], *rows[-1:]) if e is not rows[0]])
    return "; ".join([rows[0].words, *(f"to {e.experiment} would give {_number(e.sigmas)}" for e in others)])


def _number(sigmas: float) -> str:
    return f"{sigmas:.0f}" if sigmas >= 10 else f"{sigmas:.1f}"


@dataclass(frozen=True)
class _Bench:
    """The tied models and the errors by which every experiment is judged."""

    members: Sequence[Member]
    outlook: Outlook
    here: dict[tuple[int, int], Rows]  # the rows that the data at hand give for a truth and a mimic
    filmings: tuple[Filming, ...]
    weighed: bool  # whether the weight is known, or is to be measured before the finger is turned
    extra: Array  # (k, 3) mm, places of markers that could be added
    shown: tuple[list[Shown], ...]  # what each member shows in each film

    @staticmethod
    def of(members: Sequence[Member], targets: Targets, w: Whitener) -> "_Bench":
        """With the films that every member can be solved for."""
        models, thetas = [m.model for m in members], [m.theta for m in members]
        u, du = ([f(m, x) for m, x in zip(models, thetas)] for f in (Model.predict, Model.jacobian))
        outlook = Outlook(targets, w, u[0])
        here = {(a, b): outlook.here(u[a] - u[b], du[b]) for a, b in permutations(range(len(members)), 2)}
        down = DOWN if targets.gravity is None else targets.gravity[0]
        weighed = targets.gravity is not None and any(_weighs(m) for m in models)
        acting = models if weighed else [heavy(m, down) for m in models]
        films = tuple(f for f in FILMS if f.film.gravity is None or np.dot(f.film.gravity, down) < 0.9)
        if any(remembers(m.put(m.named(x)).case) for m, x in zip(models, thetas)):
            films = films[:1]  # each would be a solve along its history
        lower = tuple(f for f in films if f.film.top <= 1.0)
        extra = _between(models[0], w)
        for filmings in (films, lower):
            try:
                plans = [f.film for f in filmings]
                responses_of = tuple(responses(m, x, plans, extra) for m, x in zip(acting, thetas))
            except Unsolvable:
                continue
            return _Bench(members, outlook, here, filmings, weighed, extra, responses_of)
        return _Bench(members, outlook, here, (), weighed, extra, tuple([] for _ in members))

    def films(self) -> Iterator[Experiment]:
        """The experiments that film the finger with its present markers."""
        for k, filming in enumerate(self.filmings):
            name, minutes = filming.film.name, filming.minutes
            if filming.film.gravity is not None and not self.weighed:
                name, minutes = f"weigh the finger and {name}", minutes + WEIGHING
            sigmas = self._filmed(k, self.outlook.w.components)
            yield Experiment(experiment=name, minutes=minutes, sigmas=sigmas)

    def more(self) -> Iterator[Experiment]:
        """The experiments that repeat the film and see more of the finger."""
        components = self.outlook.w.components
        axes, x, count = np.unique(components[:, 1]), self.extra[:, 0], self.outlook.u.shape[1]
        for start in range(0, len(x) if self.filmings else 0, MORE):
            points = np.arange(start, start + MORE)
            added = np.array([(count + p, i) for p in points for i in axes])
            name = f"{AGAIN} with {MORE} more markers at x = {x[points[0]]:.0f} to {x[points[-1]]:.0f} mm"
            sigmas = self._filmed(0, np.concatenate([components, added]))
            yield Experiment(experiment=name, minutes=15.0, sigmas=sigmas)
        if 1 not in axes and self.filmings:
            added = np.array([(p, 1) for p in self._marked])
            sigmas = self._filmed(0, np.concatenate([components, added]))
            name = f"{AGAIN} with a second camera that sees U2"
            yield Experiment(experiment=name, minutes=40.0, sigmas=sigmas)

    def measurements(self) -> Iterator[Experiment]:
        """The experiments that measure something that any member has for a parameter."""
        top = float(self.outlook.targets.log_pressure.max())
        for m in MEASUREMENTS:
            names = [p.name for member in self.members for p in member.model.parameters]
            sd = {n: s * (top if n in m.of_top else 1.0) for n, s in m.sd.items() if n in names}
            if sd:
                rows = {pair: [self._told(*pair, n, s) for n, s in sd.items()] for pair in self.here}
                yield Experiment(experiment=m.name, minutes=m.minutes, sigmas=self._least(rows))

    @property
    def _marked(self) -> NDArray[np.int64]:
        """The markers on the finger that are data."""
        points = np.unique(self.outlook.w.components[:, 0])
        return points[self.members[0].model.test.moving[points]]

    def _filmed(self, k: int, components: NDArray[np.int64]) -> float:
        """The separation by film number k, seen at components (c, 2)."""
        ahead = self.outlook.ahead
        return self._least(
            {(a, b): [ahead(self.shown[a][k], self.shown[b][k], components)] for a, b in self.here}
        )

    def _told(self, truth: int, mimic: int, name: str, sd: float) -> Rows:
        """The row of a parameter that is measured by itself."""
        a, b = (_value(self.members[k], name) for k in (truth, mimic))
        names = [p.name for p in self.members[mimic].model.parameters]
        column = names.index(name) if name in names else None
        return measured(a, b, sd=sd, column=column, parameters=len(names))

    def _least(self, new: Mapping[tuple[int, int], list[Rows]]) -> float:
        """The smallest separation of any truth from any mimic, with new rows for each such pair."""
        return min(self._separation(b, [self.here[a, b], *rows]) for (a, b), rows in new.items())

    def _separation(self, mimic: int, rows: list[Rows]) -> float:
        m = self.members[mimic]
        low, high = (np.array([getattr(p, end) for p in m.model.parameters]) for end in ("low", "high"))
        inside = np.clip(m.theta, low, high)
        return separation(rows, low=low - inside, high=high - inside)


def _weighs(model: Model) -> bool:
    """True if a model knows or fits the finger's weight."""
    return is_heavy(model.test.case) or any(e.name == "gravity" for e in model.effects)


def _value(member: Member, name: str) -> float:
    """A parameter's fitted value, or where a member lacks it 0, the null of what is measured by itself."""
    return member.model.named(member.theta).get(name, 0.0)


def _between(model: Model, w: Whitener) -> Array:
    """Places (k, 3) mm on the finger for more markers: along the line of those that it has."""
    marked = np.unique(w.components[:, 0])
    points = model.test.points[marked[model.test.moving[marked]]]
    points = points[np.argsort(points[:, 0])]
    if len(points) < 2 or np.ptp(points[:, 0]) <= 0:
        return np.zeros((0, 3))
    x = np.linspace(points[0, 0], points[-1, 0], 2 * MORE * MORE + 1)[1::2]
    line = np.stack([np.interp(x, points[:, 0], points[:, k]) for k in range(3)], axis=1)
    return np.array([nearest(model.test.case, place) for place in line])
