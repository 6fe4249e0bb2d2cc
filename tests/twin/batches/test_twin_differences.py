"""What a second finger differs in from the model of the first, on models linear in their parameters."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.messages import says
from tests.twin.diagnosis.toy import Toy, smooth_field, targets, toy_effect
from twin.batches.castings import sentences
from twin.batches.differences import CONSTANTS, MODULUS, Differing, differing

BASE = smooth_field(1)
FIELDS = {"base": BASE, "alpha": smooth_field(10), "beta": smooth_field(11), "mimic": smooth_field(10)}
EFFECTS = tuple(toy_effect(name) for name in ("alpha", "beta"))
SD = 0.002  # MPa of the constant, by the first film


@dataclass(frozen=True, eq=False)
class Silicone(Toy):
    """A toy whose only parameter of the base is a modulus."""

    @property
    def law(self) -> Any:
        return SimpleNamespace(moduli=("base.C",))


def asked(*, stiffer: float = 0.0, alpha: float = 0.0, beta: float = 0.0, first: float = 0.0, seed: int = 0) -> Differing:
    """What a finger differs in that has a modulus larger by `stiffer` MPa and so much of two effects, from one
    of 1.3 MPa with `first` mm of alpha."""
    truth = (1.3 + stiffer) * BASE[0] + (first + alpha) * FIELDS["alpha"][0] + beta * FIELDS["beta"][0]
    model: Any = Silicone(FIELDS, effects=EFFECTS[:1] if first else ())
    values = {"base.C": 1.3} | ({"alpha.a0": first} if first else {})
    uncertain = np.diag([SD**2, 0.001**2][: len(values)])
    return differing(model, values, uncertain, targets(truth, seed=seed), EFFECTS)


@pytest.mark.parametrize(
    ("hidden", "name", "words"),
    [
        ({"stiffer": 0.1}, MODULUS, "base.C is 7.7 % larger"),
        ({"beta": 0.2}, "beta", "beta is there"),
        ({"first": 0.3, "alpha": 0.2}, "alpha", "alpha is there"),  # of an effect that both have
    ],
)
def test_one_difference_is_named_with_its_size(hidden: dict[str, float], name: str, words: str) -> None:
    found = asked(**hidden)
    assert found.proven
    assert not found.before.adequate
    assert [d.name for d in found.nearest] == [name]
    assert found.nearest[0].words == words
    assert found.nearest[0].adequate
    said = " ".join(sentences(found, "b-1", "b-2"))
    says(said, f"b-2 differs from b-1 by {name}: {words}", "mm")


def test_fingers_that_are_alike_but_for_what_the_first_fit_left_open_differ_in_nothing() -> None:
    rng = np.random.default_rng(3)
    found = [asked(stiffer=SD * rng.standard_normal(), seed=seed) for seed in range(20)]
    assert sum(d.proven for d in found) <= 1  # at a level of 1 %
    assert "No difference of b-2 from b-1 is proven" in sentences(found[0], "b-1", "b-2")[0]
    assert asked(stiffer=10 * SD).proven  # beyond it, it is one


@dataclass(frozen=True, eq=False)
class Meshed(Silicone):
    """The same on a mesh whose stiffness is known to 5 %."""

    def modes(self, theta: np.ndarray) -> np.ndarray:
        return 0.05 * theta[0] * BASE


def test_what_the_mesh_is_off_by_is_no_difference_of_two_fingers() -> None:
    mesh = SimpleNamespace(stiffness=0.05, remainder_mm=0.0, unknown="", wall_modes=slice(1, 1), wall_names=())
    model: Any = Meshed(FIELDS, mesh=mesh)
    uncertain = np.diag([SD**2 + (0.05 * 1.3) ** 2])  # the first fit knows its modulus by the mesh's error
    found = differing(model, {"base.C": 1.3}, uncertain, targets((1.3 + 10 * SD) * BASE[0], seed=0), EFFECTS)
    assert found.proven
    assert found.nearest[0].name == MODULUS


def test_what_these_data_cannot_tell_apart_stays_together() -> None:
    model: Any = Silicone(FIELDS)
    t = targets(1.3 * BASE[0] + 0.2 * FIELDS["alpha"][0], seed=0)
    effects = (*EFFECTS, toy_effect("mimic"))
    found = differing(model, {"base.C": 1.3}, np.diag([SD**2]), t, effects)
    assert {d.name for d in found.nearest} == {"alpha", "mimic"}
    assert "These data cannot tell that from" in sentences(found, "b-1", "b-2")[1]


def test_what_no_change_explains_is_told_as_like_the_nearest() -> None:
    model: Any = Silicone(FIELDS)
    t = targets(1.3 * BASE[0] + 0.3 * FIELDS["alpha"][0] + 0.2 * FIELDS["beta"][0], seed=0)
    found = differing(model, {"base.C": 1.3}, np.diag([SD**2]), t, EFFECTS)
    assert found.nearest[0].name == "alpha"
    assert not found.nearest[0].adequate
    assert any(line.startswith("Nothing that was tried leaves noise alone") for line in sentences(found, "a", "b"))


def test_the_look_that_decides_between_walls_and_silicone_is_the_balance() -> None:
    from twin.experiments.benchchecks import in_words, witnesses

    told = in_words(witnesses([MODULUS, "wall_thickness"]))
    assert "weigh both castings (wall_thickness" in told
    assert "pull a strip" in in_words(witnesses([MODULUS, "pressure_gain", CONSTANTS]))
