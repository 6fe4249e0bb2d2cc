"""An effect -> the promises of its contract that it breaks, one sentence each.

`UNSOLVED` and `SOLVED` list them in the order in which they are tried.
"""

import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from multiprocessing.reduction import ForkingPickler

import numpy as np

from calibrate import Parameter
from twin.contract.specimen import Specimen, alike, felt_values, motion, numbers, small_test, whole
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.effects.requirements import Requirement
from twin.model.prediction import STEP
from twin.targets import Array

AGREE = 1e-6  # mm: whole solves, with history or on another mesh, differ by less
FELT = 1e-5  # mm: a smaller change is too near to that
SHARE = 0.02  # of a typical step, or of the value, over which whole solves are differenced to one side
SLOPE = 0.05  # of the largest derivative: what the curvature over that step, or a touch, may make of it


def check_effect(effect: Effect, *, at: Theta | None = None, solves: bool = True) -> tuple[str, ...]:
    """One sentence for each promise that an effect breaks; empty where it keeps them all.

    at: values of parameters at which it is tried on a short finger, where its defaults show nothing there.
    Default: its first grid entry, and a typical step from null. solves: False leaves out the promises that
    need a finite-element solve; these take some seconds, with history about 15.
    """
    specimen = Specimen(effect, dict(at or {}))
    for promise in (*UNSOLVED, *SOLVED) if solves else UNSOLVED:
        broken = tuple(_tried(promise, specimen))
        if broken:
            return tuple(f"effect {effect.name!r}: {sentence}" for sentence in broken)
    return ()


# -- what it declares ----------------------------------------------------------------------------------------


def declared(specimen: Specimen) -> Iterator[str]:
    """Name, sentence, parameters and grid."""
    e = specimen.effect
    if not e.name or not e.sentence:
        yield "it has no name or no sentence; give both, the sentence says what is physically meant"
    for p in e.parameters:
        if p.name.partition(".")[0] != e.name or not p.name.partition(".")[2]:
            yield f"parameter {p.name!r}: wanted a name of the form {e.name}.<parameter>"
        if p.null is not None and not p.low <= p.null <= p.high:
            yield f"parameter {p.name!r}: its null {_value(p, p.null)} lies outside its bounds"
    if not e.parameters or e.parameters[0].null is None:
        yield "its first parameter has no null; put first the one that switches the effect on"
    yield from _grid(e, specimen.test)


def _grid(e: Effect, test: Test) -> Iterator[str]:
    tried, by_name = e.tries(test), {p.name: p for p in e.parameters}
    for entry in tried:
        for name, value in entry.items():
            if name not in by_name:
                yield f"its grid names {name!r}, which is none of its parameters"
            elif not by_name[name].low <= value <= by_name[name].high:
                yield f"its grid has {name} = {_value(by_name[name], value)}, outside the parameter's bounds"
    if e.label == e.name:  # a wider law starts from the narrower
        for p in e.parameters:
            if p.null is None and not all(p.name in entry for entry in tried):
                yield f"{p.name} has no value in an entry of its grid; give those at which it is to be tried"


def _value(p: Parameter, value: float) -> str:
    return f"{value:g} {p.unit}".rstrip()


def consistent(specimen: Specimen) -> Iterator[str]:
    """Labels, wider laws and where these start; and that it can be sent to a worker process."""
    e, wider = specimen.effect, specimen.effect.wider()
    named = e.named(e.label)
    labels = [law.label for law in e.laws()] + ([named.label] if named else [])
    if not re.fullmatch(rf"{e.name}(:\S+)?", e.label) or e.label not in labels:
        yield f"its label {e.label!r} names none of its laws, wanted {e.name} or, for a wider one, {e.name}:2"
    if wider is not None:
        names = {p.name for p in wider.parameters}
        if wider.name != e.name or not {p.name for p in e.parameters} < names:
            yield f"its wider law {wider.label!r} does not hold all of its parameters and more"
        elif {k for k in wider.start(felt_values(e)) if k.startswith(f"{e.name}.")} != names:
            yield f"start() of its wider law {wider.label!r} does not give a value for each parameter"
    yield from _widest(e)
    try:
        ForkingPickler.dumps(e)
    except Exception as error:  # whatever a user's object does when it is written out
        yield f"it cannot be sent to a worker process ({error}); keep to numbers, texts and arrays"


def _widest(e: Effect) -> Iterator[str]:
    wide = e.wide()
    if wide is None:
        return
    names, named = {p.name for p in wide.parameters}, e.named(wide.label)
    if wide.name != e.name or (wide.label not in [w.label for w in e.laws()] and named is None):
        yield f"its widest family {wide.label!r} has another name, or named() does not know its label"
    elif {k for k in wide.start(felt_values(e)) if k.startswith(f"{e.name}.")} != names:
        yield f"start() of its widest family {wide.label!r} does not give one value for each parameter"


# -- its maps ------------------------------------------------------------------------------------------------


def pure(specimen: Specimen) -> Iterator[str]:
    """`before` and `after` are pure: equal results for equal arguments, which they leave unchanged."""
    e, values, u = specimen.effect, specimen.felt, motion(specimen.test)
    test, kept_u = deepcopy(specimen.test), u.copy()
    result = e.before(test, values)
    if not alike(test, specimen.test):
        yield "before() changes the test that it is given; make a new one by dataclasses.replace"
    elif not alike(result, e.before(test, values)):
        yield "before() gives another result the second time; it must depend on its arguments only"
    seen = e.after(u, test, values)
    if not alike(u, kept_u):
        yield "after() changes the displacements that it is given; make a new array"
    elif not alike(seen, e.after(u, test, values)):
        yield "after() gives another result the second time; it must depend on its arguments only"
    if np.shape(seen) != u.shape or result.points.shape != test.points.shape:
        yield "it changes the number of steps or points; wanted the same shape (steps, points, 3)"


def defined(specimen: Specimen) -> Iterator[str]:
    """The maps give numbers a little beyond each bound, where derivatives are taken."""
    u = motion(specimen.test)
    for p in specimen.effect.parameters:
        for bound, sign in ((p.low, -1), (p.high, 1)):
            beyond = {**specimen.felt, p.name: bound + sign * STEP * p.step}
            where = f"at {p.name} just beyond its bound {_value(p, bound)}"
            try:
                test = specimen.effect.before(specimen.test, beyond)
                seen = specimen.effect.after(u, test, beyond)
            except Unsolvable:
                continue  # it says so itself
            except Exception as error:  # whatever a user's map raises
                yield f"{where} it raises {type(error).__name__}: {error}; wanted maps that are defined there"
                continue
            if any(np.isnan(x).any() for x in (seen, *numbers(test))):
                yield f"{where} it gives nan; wanted maps that are defined there"


# -- what is solved ------------------------------------------------------------------------------------------


def nothing_at_null(specimen: Specimen) -> Iterator[str]:
    """At null a prediction is the base's: bit for bit, or within 1e-6 mm for an effect of history."""
    off = float(np.abs(specimen.absent - specimen.base).max())
    history = Requirement.HISTORY in specimen.effect.requires
    if off > (AGREE if history else 0.0):
        exact = 'bit for bit (within 1e-6 mm with requires = ("history",))'
        how = "within 1e-6 mm" if history else exact
        yield f"at its null it changes the displacements by {off:.2g} mm, wanted those of the base {how}"


def something_beyond(specimen: Specimen) -> Iterator[str]:
    """It changes the displacements where it should be felt."""
    off = float(np.abs(specimen.present - specimen.absent).max())
    if off < FELT:
        values = ", ".join(f"{p.name} = {specimen.felt[p.name]:g}" for p in specimen.effect.parameters)
        yield (
            f"at {values} it changes the displacements by {off:.2g} mm; wanted {FELT:g} mm: name values that "
            "are felt on the short finger by at={...}"
        )


def symmetric(specimen: Specimen) -> Iterator[str]:
    """Half and whole model agree, unless it says that it breaks the symmetry."""
    half = small_test()
    if specimen.effect.breaks_symmetry(half):
        return
    off = float(np.abs(specimen.solved(specimen.felt, test=whole(half)) - specimen.present).max())
    if off > AGREE:
        yield (
            f"half and whole model differ by {off:.2g} mm; return True from breaks_symmetry (the whole is "
            "then modelled), or give what belongs to the whole, such as a moment, times test.share"
        )


def sloped(specimen: Specimen) -> Iterator[str]:
    """Each derivative is the difference of whole solves, where the effect is felt and at its null."""
    yield from _sloped_at(specimen, specimen.felt, specimen.present)
    if specimen.effect.smooth:
        yield from _sloped_at(specimen, specimen.null, specimen.absent)


def _sloped_at(specimen: Specimen, values: dict[str, float], u: Array) -> Iterator[str]:
    """The same at values of the parameters, where the displacements are u (s, p, 3) mm."""
    ours, share = specimen.slopes(values), SLOPE * (1 if specimen.effect.smooth else 2)
    for p in specimen.effect.parameters:
        x = values[p.name]
        h = SHARE * (min(p.step, abs(x)) if x else p.step) * (1 if x < p.high else -1)
        theirs = (specimen.solved({**values, p.name: x + h}) - u) / h
        size, off = float(np.abs(theirs).max()), float(np.abs(ours[p.name] - theirs).max())
        if off > share * size + AGREE / abs(h):
            yield (
                f"at {p.name} = {_value(p, x)} the derivative is off by {off / max(size, 1e-300):.0%} of a "
                f"difference of whole solves, wanted {share:.0%}; make the maps smooth (no clipping at a "
                "bound), or state smooth = False"
            )


Promise = Callable[[Specimen], Iterator[str]]
UNSOLVED: tuple[Promise, ...] = (declared, consistent, pure, defined)
SOLVED: tuple[Promise, ...] = (nothing_at_null, something_beyond, symmetric, sloped)


def _tried(promise: Promise, specimen: Specimen) -> Iterator[str]:
    """The sentences of one promise, and one more where the effect stops it by an exception."""
    try:
        yield from promise(specimen)
    except Exception as error:  # a user's map may raise anything
        yield f"{type(error).__name__}: {error} (while it was tried: {(promise.__doc__ or '').rstrip('.')})"
