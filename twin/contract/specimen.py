"""The small finger on which an effect is tried: one bellow under pressure that rises, rests and falls."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from calibrate import Parameter
from fe import Finger, Lattice, Path
from fe.mesh.mirror import mirrored
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Test, Theta
from twin.gravity import G
from twin.model.prediction import Model, respond
from twin.model.structure import base_case
from twin.targets import Array

LENGTH = 10 + 100 / 9  # mm, of one bellow and both caps
SMALL = Finger(length=LENGTH, bellows=1, tip_node=(LENGTH, 11.5, 0.0), middle_node=(4 + 50 / 9, 11.5, 0.0))
COARSE = Lattice(per_bellow=2, ring=False, centred=False)
TOP = 0.04  # MPa
_SOLVED: deque[tuple[Test, Array]] = deque(maxlen=8)  # the newest tests and their displacements
TIP_FORCE = 0.1  # N, of the half: without an outside force the clamp carries no moment


@dataclass(frozen=True)
class Specimen:
    """An effect, and the small finger with it."""

    effect: Effect
    at: Theta

    @cached_property
    def felt(self) -> dict[str, float]:
        """Values of all parameters at which the effect is felt; the base law's too."""
        law = {p.name: p.start for p in Elasticity().parameters if p.start is not None}
        return {**law, **felt_values(self.effect), **self.at}

    @cached_property
    def null(self) -> dict[str, float]:
        """The same where the effect is absent."""
        return {**self.felt, **{p.name: p.null for p in self.effect.parameters if p.null is not None}}

    @cached_property
    def test(self) -> Test:
        """The small test, of the whole finger where the effect asks for it."""
        half = small_test()
        return whole(half) if self.effect.breaks_symmetry(half) else half

    def model(self, test: Test | None = None, *, bare: bool = False) -> Model:
        """The model of the small test with the effect, or without, whose law is held: derivatives are to the
        effect's parameters alone. A new one, which has solved nothing."""
        law = Elasticity(fixed={p.name: self.felt[p.name] for p in Elasticity().parameters})
        effects = (law,) if bare else (law, self.effect)
        return Model(test or self.test, effects, np.array([0]))

    def solved(self, values: Theta, **how: Any) -> Array:
        """Displacements (s, p, 3) mm relative to the first output, by a solve from rest."""
        model = self.model(**how)
        test = model.put(values)
        return model.seen(_responded(test), test, values)

    def slopes(self, values: Theta) -> dict[str, Array]:
        """The derivative (s, p, 3) mm per unit of each parameter."""
        model = self.model()
        names = (p.name for p in model.parameters)
        return dict(zip(names, model.jacobian(model.theta(values)), strict=True))

    @cached_property
    def base(self) -> Array:
        """Displacements (s, p, 3) mm without the effect."""
        return _base(self.effect.breaks_symmetry(small_test()))

    @cached_property
    def absent(self) -> Array:
        """Displacements (s, p, 3) mm with the effect at its null."""
        return self.solved(self.null)

    @cached_property
    def present(self) -> Array:
        """Displacements (s, p, 3) mm where it is felt."""
        return self.solved(self.felt)


def felt_values(e: Effect) -> dict[str, float]:
    """A typical step from each null, the first grid entry, else what the narrower law makes of its own."""
    values = {p.name: _inside(p, p.null + p.step) for p in e.parameters if p.null is not None}
    laws = [law.label for law in e.laws()]
    narrower = e.laws()[laws.index(e.label) - 1] if e.label in laws[1:] else None
    started = e.start(felt_values(narrower)) if narrower is not None else {}
    middle = {p.name: (p.low + p.high) / 2 for p in e.parameters}
    entry = e.tries(small_test())[0]
    return {p.name: {**middle, **values, **started, **entry}[p.name] for p in e.parameters}


def _inside(p: Parameter, value: float) -> float:
    """A value within a parameter's bounds, as far from null on the other side where it lies beyond them."""
    assert p.null is not None
    return value if value <= p.high else max(2 * p.null - value, p.low)


@cache
def small_test() -> Test:
    """Half of the small finger under its weight's direction, with a dead force on its tip."""
    case = replace(base_case(finger=SMALL, lattice=COARSE), forces={"tip_face": np.array([0, 0, TIP_FORCE])})
    time = np.linspace(0.0, 4.0, 41)
    pressure = TOP * np.interp(time, [0.0, 0.5, 1.5, 3.0, 3.5], [0.0, 0.0, 1.0, 1.0, 0.3])
    path = Path(time, pressure, np.array([0.0, 1.0, 1.5, 3.0, 4.0]), gravity=G * np.array([0.6, 0.0, -0.8]))
    corners = [int(case.node_sets["tip_face"][k]) for k in (0, -1)]
    points = np.array([*case.nodes[corners], [20.0, 11.5, 30.0]])
    return Test(case, path, points, np.array([True, True, False]))


def _responded(test: Test) -> Array:
    """Displacements (s, p, 3) mm of a test's points, by a solve from rest, unless a test alike was solved:
    what acts on the camera or the log alone moves the finger as the base does."""
    found = next((u for known, u in _SOLVED if alike(known, test)), None)
    if found is None:
        found = respond(test, (), start=None)[0]
        _SOLVED.append((test, found))
    return found.copy()


@cache
def _base(entire: bool) -> Array:
    """Displacements (s, p, 3) mm of the half or the whole small finger without an effect."""
    bare = Specimen(Effect(), {})
    return bare.solved(bare.felt, test=whole(small_test()) if entire else None, bare=True)


def whole(test: Test) -> Test:
    """The test of the whole structure, from the test of its half."""
    return replace(test, case=mirrored(test.case))


def motion(test: Test) -> Array:
    """Displacements (s, p, 3) mm that tell all values apart, to try `after` with."""
    shape = (len(test.path.output), len(test.points), 3)
    return np.linspace(-1.0, 1.0, int(np.prod(shape))).reshape(shape)


# -- records of numbers --------------------------------------------------------------------------------------

def alike(a: Any, b: Any) -> bool:
    """True if two records, mappings, sequences or arrays are equal to the last bit.

    >>> alike({"u": np.array([1.0, np.nan])}, {"u": np.array([1.0, np.nan])}), alike((1.0,), (1.0, 2.0))
    (True, False)
    """
    if is_dataclass(a):
        return type(a) is type(b) and all(alike(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(alike(a[k], b[k]) for k in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)


def numbers(a: Any) -> Iterator[Array]:
    """Every number in a record, as arrays."""
    if is_dataclass(a):
        yield from (x for f in fields(a) for x in numbers(getattr(a, f.name)))
    elif isinstance(a, Mapping):
        yield from (x for value in a.values() for x in numbers(value))
    elif isinstance(a, tuple | list):
        yield from (x for value in a for x in numbers(value))
    elif isinstance(a, float) or (isinstance(a, np.ndarray) and a.dtype.kind == "f"):
        yield np.asarray(a)
