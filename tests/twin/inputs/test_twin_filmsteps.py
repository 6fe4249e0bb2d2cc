"""How many frames of a film become steps where twin.toml does not say."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.messages import says
from twin.fitmemory import MOST_BYTES, MOST_STEPS, bytes_of
from twin.inputs.filmsteps import OWN, room, said_of_steps

NAMES = [f"placement:m{k}:x" for k in range(200)] + [f"codec:m{k}" for k in range(300)]


@pytest.mark.parametrize("films", [1, 3])
def test_errors_of_the_rig_count_once_and_others_once_a_film(films: int) -> None:
    values, rest = 100, 40
    errors = 200 + films * (300 + OWN)  # as the films' targets have them together
    most = room(films)(NAMES, values, rest)
    assert most < MOST_STEPS
    held, more = (bytes_of(films * (most + rest + k) * values, values, errors) for k in (0, 1))
    assert held <= MOST_BYTES < more


def moved(frames: int, most: int) -> SimpleNamespace:
    tracks = SimpleNamespace(time=np.arange(frames))
    return SimpleNamespace(tracks=tracks, time=np.arange(most + 40), most_steps=most, names=("a", "b"), mode_names=("scale",) * 900)


def test_fewer_frames_than_usual_are_told_unless_they_are_stated() -> None:
    (told,) = said_of_steps(moved(10_000, 200), stated=False)
    says(told, "240 of the 10000 frames", "900 errors", "2 markers", "3 GB", "`steps` under [measure]")
    assert said_of_steps(moved(10_000, 200), stated=True) == ()
    assert said_of_steps(moved(10_000, MOST_STEPS), stated=False) == ()
    assert said_of_steps(moved(150, 200), stated=False) == ()
