"""What the virtual laboratory makes: targets relative to their reference, with the modes of their errors."""

from dataclasses import replace

import numpy as np

from fe import Path
from twin.virtual import FILM_A, Bench, at_nodes, noisy_targets, path

QUIET = Bench(film_hz=2.0, sd=1e-6, gauge_sd_MPa=0.0, ripple_MPa=0.0)
PLACES = np.array([[20.0, 11.5, 0.0], [50.0, 11.5, 0.0], [80.0, 11.5, 0.0]])
POINTS = at_nodes(("a", "b", "c"), (1, 2, 3), PLACES)


def bending(course: Path, *, sag: float) -> np.ndarray:
    """Displacements (s, 3, 3) mm that grow with pressure, of a finger that sags before the test begins."""
    size = sag + course.at_output()[:, None] / 0.03
    u = np.zeros((len(course.output), 3, 3))
    u[..., 2] = -size * (PLACES[:, 0] / 20) ** 2
    return u


def test_modes_are_relative_to_the_reference_of_a_finger_that_sags() -> None:
    course = path(QUIET)
    u = bending(course, sag=0.4)
    found = noisy_targets(u, 0 * u, course, points=POINTS, bench=QUIET, seed=1)
    mean = found.modes[:, found.reference].mean(axis=1)
    shared = [k for k, name in enumerate(found.mode_names) if not name.startswith("reference:")]
    assert np.abs(mean[shared]).max() < 1e-12
    scale = found.modes[found.mode_names.index("scale")][:, :3]
    moved = u - u[found.reference].mean(axis=0)
    np.testing.assert_allclose(scale, QUIET.scale_sd * moved, rtol=0, atol=1e-12)
    assert np.abs(u[found.reference]).max() > 1.0  # mm: the absolute displacements are not zero there


def test_the_drawn_errors_lie_along_the_modes() -> None:
    course = path(QUIET)
    u = bending(course, sag=0.4)
    found = noisy_targets(u, 0 * u, course, points=POINTS, bench=QUIET, seed=2)
    seen = found.valid
    off = (found.value[:, :3] - (u - u[found.reference].mean(axis=0)))[seen[:, :3]]
    rows = found.modes[:, :, :3][:, seen[:, :3]]
    left = off - rows.T @ np.linalg.lstsq(rows.T, off, rcond=1e-12)[0]
    assert np.abs(off).max() > 0.05  # mm
    assert np.abs(left).max() < 10 * QUIET.sd


def test_a_protocol_is_data() -> None:
    course = path(replace(QUIET, log_hz=10.0), protocol=((0.0, 0.0), (1.0, 20.0), (3.0, 20.0)))
    np.testing.assert_allclose(course.pressure_at(np.array([0.5, 1.0, 2.0])), [0.01, 0.02, 0.02])
    assert course.output[-1] == 2.5
    assert path(QUIET).output[-1] < FILM_A[-1][0]
