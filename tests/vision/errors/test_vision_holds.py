"""H.264 keeps one image, and its error, through a hold: the mean over a hold is as far off as is stated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision import Video, View, measure
from vision.errors import sharederrors
from vision.errors.errorbudget import budget
from vision.errors.sharederrors import BETWEEN_PX, REDRAWN_PX, codec, redrawn
from vision.errors.staticnoise import CREEP, FAST, REST

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
RAMP, HOLD, LEVELS = 3, 12, (0.003, 0.006, 0.002, 0.007, 0.004)
CREEPS = 0.02  # of the bend, over every second hold


def bend() -> tuple[Array, list[slice]]:
    """Bend of every frame (1/mm), and the holds without their first two frames."""
    parts, holds, last = [np.zeros(14)], [], 0.0
    for k, level in enumerate(LEVELS):
        begins = sum(map(len, parts)) + RAMP
        holds.append(slice(begins + 2, begins + HOLD))
        end = level * (1.0 + CREEPS * (k % 2))
        parts += [np.linspace(last, level, RAMP + 1)[1:], np.linspace(level, end, HOLD)]
        last = end
    return np.concatenate(parts), holds


@pytest.mark.slow
def test_means_of_holds_in_a_film_coded_with_loss(lab: Lab, coded_still: Video, tmp_path: Path) -> None:
    bent, holds = bend()
    film = lab.film(tmp_path / "film.mkv", bent, codec="libx264", seed=3)
    result = measure([View(film, coded_still, lab.camera)], lab.marks, reference=1.15)
    place = lab.motion(bent)[0][:, lab.rows("fixed", "finger")]
    error = result.value - (place - place[:12].mean(axis=0))
    finger = [p for p, role in enumerate(result.roles) if role == "finger"]
    shared = [k for k, n in enumerate(result.mode_names) if n.startswith(("reference:", "codec:"))]
    own = np.diagonal(result.covariance, axis1=2, axis2=3)
    pulls, alone = [], []
    for hold in holds:
        mean = error[hold].mean(axis=0)
        independent = own[hold].mean(axis=0) / HOLD
        together = (result.modes[shared][:, hold].mean(axis=1) ** 2).sum(axis=0)
        pulls.append((mean / np.sqrt(independent + together))[finger][:, [0, 2]])
        alone.append((mean / np.sqrt(independent))[finger][:, [0, 2]])
    low, high = band(22, 2.0)  # 30 values, those of one mark not quite independent; two sds
    assert low < np.sqrt(np.mean(np.square(pulls))) < high
    # As independent errors they are stated far too small: 2.4 here.
    assert np.sqrt(np.mean(np.square(alone))) > 2.0


def test_more_holds_than_modes_are_said(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharederrors, "MAX_HOLDS", 2)
    state = np.array([[REST] * 6 + [FAST] + [REST] * 4 + [FAST] + [REST] * 5]).T
    found, left, (said,) = codec(np.full((17, 1, 3), 0.3), state, lab.marks[-1:])
    assert len(found) == 6  # all components of two holds
    assert left[7:11].all()
    assert said.startswith(
        "Video compression leaves a constant error while a marker rests (3 rests). The 2 longest are modelled; "
        "for the 1 shortest, averages"
    )


def test_every_hold_has_its_mode_and_the_variance_stays(lab: Lab) -> None:
    state = np.array([[REST] * 4 + [FAST] * 2 + [REST] * 5 + [CREEP] * 3 + [FAST], [REST] * 15]).T
    extra = np.zeros((15, 2, 3))
    extra[4:, 0] = [0.3, np.nan, 0.5]
    marks = lab.marks[-2:]
    shared, left, said = codec(extra, state, marks)
    assert said == ()
    assert list(shared) == [f"codec:{marks[0].name}:1:1", f"codec:{marks[0].name}:3:1"]
    whole = np.nan_to_num(left) ** 2 + sum(mode**2 for mode in shared.values())
    np.testing.assert_allclose(whole, np.nan_to_num(extra) ** 2)
    assert not np.nan_to_num(left[6:11]).any()  # at rest all of it is shared
    np.testing.assert_allclose(left[11:14, 0, 0] ** 2, 0.25 * 0.09)
    np.testing.assert_allclose(left[[4, 5, 14], 0, 2], 0.5)  # fast: independent
    seen = np.ones((15, 2), dtype=bool)
    table = budget({"codec": left**2}, np.array(list(shared.values())), list(shared), seen)
    row = table.sd[table.sources.index("codec")]
    np.testing.assert_allclose(row[0, 0], 0.3 * np.sqrt(11 / 15))


def test_a_mark_that_the_rest_does_not_show_has_no_error_of_another_picture(lab: Lab) -> None:
    value, ideal = np.zeros((20, 2, 3)), np.zeros((20, 2, 2))
    value[5:15, :, 2], ideal[5:15, :, 1] = 1.0, 8.0
    ideal[:3, 1] = np.nan
    marks = lab.marks[-2:]
    found = redrawn(value, ideal, np.arange(3), marks, 1.0)
    assert {name.split(":")[1] for name in found} == {marks[0].name}
    assert set(np.flatnonzero(found[f"codec:{marks[0].name}:3:moved"][:, 0, 2])) == set(range(5, 15))
    assert found[f"codec:{marks[0].name}:3:moved"].max() == pytest.approx(
        np.hypot(REDRAWN_PX, BETWEEN_PX) / 8.0
    )
