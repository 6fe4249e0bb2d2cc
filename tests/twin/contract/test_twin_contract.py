"""`check_effect`: the library keeps every promise, and each kind of broken effect gets its sentence."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from calibrate import Parameter
from tests.few import few
from twin.contract.promises import check_effect
from twin.contract.specimen import alike, small_test
from twin.effects.families import Wide
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect, Order, Test, Theta
from twin.targets import Array

pytestmark = pytest.mark.usefixtures("solved_once")
# where their defaults show nothing on the short finger: the table lies 3 mm below it
AT = {label: {"contact.stiffness": 0.5, "contact.distance": 0.2} for label in ("contact", "contact:2")}
LAWS = [law for e in all_effects() for law in e.laws()]
FIRST = list({law.order: law for law in reversed(LAWS)}.values())  # one of each order; all take two minutes


@pytest.mark.parametrize("law", few(LAWS, FIRST), ids=lambda law: law.label)
def test_the_library_keeps_its_promises(law: Effect) -> None:
    assert check_effect(law, at=AT.get(law.label)) == ()


WIDE = [wide for e in all_effects() if (wide := e.wide()) is not None]


@pytest.mark.parametrize("wide", WIDE, ids=lambda e: e.label)
def test_the_widest_families_state_what_they_should(wide: Effect) -> None:
    assert check_effect(wide, solves=False) == ()


@pytest.mark.slow
@pytest.mark.parametrize("wide", [w for w in WIDE if w.label.endswith(":wide")], ids=lambda e: e.label)
def test_the_widest_families_keep_their_promises(wide: Effect) -> None:
    assert check_effect(wide) == ()


def test_what_is_made_by_a_grid_keeps_its_promises_and_is_named_again() -> None:
    slip, test = effect("marker_slip"), small_test()
    held = slip.at(slip.tries(test)[-1], test)
    assert held.label != slip.label
    assert effect(held.label).label == held.label
    assert [p.name for p in held.parameters] == ["marker_slip.along", "marker_slip.across"]
    assert check_effect(held, solves=False) == ()


class Push(Effect):
    """A good one, from which the broken ones are made."""

    name, order = "push", Order.GAUGE_GAIN
    sentence = "the pressure is higher than recorded"
    parameters: tuple[Parameter, ...] = (Parameter("push.gain", 0.0, 1.0, "", null=0.0, typical=0.1),)

    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, theta["push.gain"])


def pushed(test: Test, gain: float) -> Test:
    return replace(test, path=replace(test.path, pressure=test.path.pressure * (1 + gain)))


def test_a_good_effect_keeps_them_all() -> None:
    assert check_effect(Push()) == ()


class Misnamed(Push):
    parameters = (Parameter("gain", 0.0, 1.0, "", null=0.0),)


class Mute(Push):
    sentence = ""


class Always(Push):
    parameters = (Parameter("push.gain", 0.0, 1.0, ""),)


class Aside(Push):
    parameters = (Parameter("push.gain", 0.0, 1.0, "", null=-1.0),)


class Hidden(Push):
    parameters = (*Push.parameters, Parameter("push.angle", 0.0, 1.0, "rad"))


class Astray(Push):
    parameters, grid = Hidden.parameters, ({"push.angle": 2.0, "push.place": 1.0},)


class Mislabelled(Push):
    label = "shove"  # type: ignore[assignment]


class Elsewhere(Push):
    def wide(self) -> Effect:
        return Other()


class Other(Push):
    name = "other"


class Shorter(Push):
    """A wide family that cannot be begun from the narrow law."""

    def wide(self) -> Effect:
        return Begun()


class Begun(Wide, Push):
    parameters = (Parameter("push.c0", 0.0, 1.0, "", null=0.0), Parameter("push.c1", 0.0, 1.0, "", null=0.0))

    def start(self, theta: Theta) -> Theta:
        return {**self.rest(theta), "push.c0": theta.get("push.gain", 0.0)}


class Narrower(Push):
    def wider(self) -> Effect:
        return Push()


class Unstarted(Push):
    def wider(self) -> Effect:
        return Hidden()


class Stuck(Push):
    def __init__(self) -> None:
        self.turn = lambda x: x


class Meddling(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        test.points[0] += 1e-9
        return test


class Fickle(Push):
    calls = 0

    def before(self, test: Test, theta: Theta) -> Test:
        type(self).calls += 1
        return pushed(test, theta["push.gain"] * type(self).calls)


class Smearing(Push):
    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        u *= 1 + theta["push.gain"]
        return u


class Blurred(Push):
    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        return u + theta["push.gain"] * np.random.default_rng().normal(size=u.shape)


class Shortened(Push):
    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        return u[:-1]


class Rooted(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, math.sqrt(theta["push.gain"]))


class Unknown(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        force = theta["push.gain"]
        return pushed(test, math.nan if force > 1 else force)


class Leftover(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, theta["push.gain"] + 1e-6)


class Idle(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return test


class Doubled(Push):
    def before(self, test: Test, theta: Theta) -> Test:  # by the moment of the half, not of the whole
        assert test.case.clamp is not None
        clamp = replace(test.case.clamp, compliance=1e-2 * theta["push.gain"])
        return replace(test, case=replace(test.case, clamp=clamp))


class Clipped(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, max(theta["push.gain"], 0.0))


class Stepped(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, round(theta["push.gain"], 4))


class Broken(Push):
    def before(self, test: Test, theta: Theta) -> Test:
        return pushed(test, theta["push.strength"])


@pytest.mark.parametrize(
    ("effect", "sentence"),
    [
        (Misnamed(), r"parameter 'gain': wanted a name of the form push\.<parameter>"),
        (Mute(), "it has no name or no sentence"),
        (Always(), "its first parameter has no null"),
        (Aside(), r"parameter 'push\.gain': its null -1 lies outside its bounds"),
        (Hidden(), r"push\.angle has no value in an entry of its grid"),
        (Astray(), r"its grid has push\.angle = 2 rad, outside the parameter's bounds"),
        (Astray(), r"its grid names 'push\.place', which is none of its parameters"),
        (Mislabelled(), "its label 'shove' names none of its laws"),
        (Elsewhere(), "its widest family 'other' has another name"),
        (Shorter(), r"start\(\) of its widest family 'push:wide' does not give one value for each parameter"),
        (Narrower(), "its wider law 'push' does not hold all of its parameters and more"),
        (Unstarted(), r"start\(\) of its wider law 'push' does not give a value for each parameter"),
        (Stuck(), "it cannot be sent to a worker process"),
        (Meddling(), r"before\(\) changes the test that it is given"),
        (Fickle(), r"before\(\) gives another result the second time"),
        (Smearing(), r"after\(\) changes the displacements that it is given"),
        (Blurred(), r"after\(\) gives another result the second time"),
        (Shortened(), "it changes the number of steps or points"),
        (Rooted(), r"at push\.gain just beyond its bound 0 it raises ValueError: math domain error"),
        (Unknown(), r"at push\.gain just beyond its bound 1 it gives nan"),
        (Leftover(), r"at its null it changes the displacements by .* mm, wanted those of the base bit for bit"),
        (Idle(), r"at push\.gain = 0\.1 it changes the displacements by 0 mm"),
        (Doubled(), r"half and whole model differ by .* mm; return True from breaks_symmetry"),
        (Clipped(), r"at push\.gain = 0 the derivative is off by 50% of a difference of whole solves"),
        (Stepped(), r"at push\.gain = 0\.1 the derivative is off by 100% of a difference of whole solves"),
        (Broken(), r"KeyError: 'push\.strength' \(while it was tried: `before` and `after` are pure"),
    ],
    ids=lambda x: type(x).__name__ if isinstance(x, Effect) else "",
)
def test_a_broken_promise_has_its_sentence(effect: Effect, sentence: str) -> None:
    found = check_effect(effect)
    assert any(re.match(f"effect 'push': {sentence}", s) for s in found), found


def test_records_that_differ_anywhere_are_not_alike() -> None:
    a = {"x": (1.0, np.array([1.0, np.nan])), "y": Push.parameters}
    assert alike(a, {"x": (1.0, np.array([1.0, np.nan])), "y": Push.parameters})
    for b in (
        {**a, "x": (1.0, np.array([1.0, 2.0]))},
        {**a, "x": (1.0,)},
        {"x": a["x"]},
        {**a, "y": (replace(Push.parameters[0], high=2.0),)},
    ):
        assert not alike(a, b)
