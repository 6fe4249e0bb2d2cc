"""Two cameras on drawn film: motion out of the plane, pulls, clocks apart, a shaken camera, calibration error."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from tests.pulls import band
from vision import Camera, Displacements, Video, View, measure
from vision.calibration.rig import OWN, Rig
from vision.drawing import synthetic
from vision.errors.codingvariance import codec_terms
from vision.errors.reencoding import coded_again
from vision.errors.sharederrors import Stated
from vision.film import checkpoint
from vision.following.reference import prepare
from vision.following.tracking import follow
from vision.marks import frame_places, rows_of
from vision.measuring.displacements import displacements_of
from vision.measuring.face import Face
from vision.placing import spaceerrors
from vision.placing.planeerrors import principal
from vision.placing.triangulation import Sight, places_of, rigid_fit
from vision.placing.views import How, Seen, look

Array = NDArray[np.float64]
FRAMES, RATE = 50, 10.0
REFERENCE_S = 1.5
HOW = How("DICT_4X4_50", REFERENCE_S)
PERFECT = Stated(placement_mm=1e-6, scale=1e-9, frame_mm=1e-6, node_mm=1e-6)


def second(pose: tuple[Array, Array], degrees: float) -> tuple[Array, Array]:
    """The pose of a camera that looks at the same middle from a place turned about the vertical."""
    turn, _ = cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(degrees)]))
    first, _ = cv2.Rodrigues(pose[0])
    middle = np.array([45.0, 12.0, -15.0])
    rotation = first @ turn
    return cv2.Rodrigues(rotation)[0].ravel(), pose[1] + first @ middle - rotation @ middle


def rig_of(cameras: tuple[Camera, ...], poses: list[tuple[Array, Array]]) -> Rig:
    turns = [cv2.Rodrigues(p[0])[0] for p in poses]
    relative = [t @ turns[0].T for t in turns]
    turn = np.array([cv2.Rodrigues(r)[0].ravel() for r in relative])
    shift = np.array(
        [np.ravel(p[1]) - r @ np.ravel(poses[0][1]) for p, r in zip(poses, relative, strict=True)]
    )
    return Rig(cameras, turn, shift, np.zeros((len(cameras) * OWN,) * 2))


def motion(lab: Any, time: Array) -> tuple[Array, Array]:
    """Centres (t,p,3) mm and rotations (t,p) rad: bent towards -z, and out of the plane by up to 7 mm."""
    ramp = np.clip((time - 1.6) / 3.0, 0.0, 1.0)
    bend = 0.009 * ramp**2 * (3.0 - 2.0 * ramp)
    place, turn = lab.motion(bend)
    for p in lab.rows("finger"):
        place[:, p, 1] += 7.0 * ramp**2 * (3.0 - 2.0 * ramp) * (lab.marks[p].position[0] / 90.0) ** 2
    return place, turn


class Pair:
    """Both cameras' films of one motion."""

    def __init__(self, lab: Any, folder: Path) -> None:
        self.lab, self.poses = lab, [lab.pose, second(lab.pose, 24.0)]
        moved = np.array([[-20.0, 0, 4], [0, -21, -5], [0, 0, 0]])
        self.cameras = (lab.camera, replace(lab.camera, matrix=lab.camera.matrix + moved))
        self.rig = rig_of(self.cameras, self.poses)
        self.time = np.arange(FRAMES) / RATE
        films = [
            self.drawn(folder / f"{name}{c}.mkv", c, time)
            for name, time in (("film", self.time), ("static", np.zeros(120)))
            for c in range(2)
        ]
        self.views = [View(films[c], films[2 + c], self.cameras[c]) for c in range(2)]
        # Followed once: what tests measure from it costs nothing more.
        self.seen = [look(view, lab.marks, HOW) for view in self.views]
        self.places = motion(lab, self.time)[0]
        self.truth = self.places - self.places[self.time <= REFERENCE_S].mean(axis=0)
        self.output = lab.rows("fixed", "finger")

    def drawn(self, path: Path, c: int, time: Array, slip: float = 0.0, codec: str = "rawvideo") -> Video:
        """What camera c films; the finger's last marker slips by so many mm along it at 3 s."""
        place, turn = motion(self.lab, time)
        last = self.lab.rows("finger")[-1]
        after = time > 3.0
        place[after, last] += slip * np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=-1)[after, last]
        synthetic.film(
            path,
            camera=self.cameras[c],
            pose=self.poses[c],
            marks=self.lab.marks,
            positions=place,
            rotations=turn,
            codec=codec,
            seed=10 * c + len(time),
        )
        return Video(path)

    def sight(self) -> Sight:
        """What the cameras would see without noise."""
        raw = []
        for camera, matrix in zip(self.cameras, self.rig.matrices, strict=True):
            turn, _ = cv2.Rodrigues(self.poses[0][0])
            own = self.places @ turn.T + np.ravel(self.poses[0][1])
            mapped = own @ matrix[:, :3].T + matrix[:, 3]
            raw.append(camera.distort(mapped[..., :2] / mapped[..., 2:]))
        nominal = np.array([m.position for m in self.lab.marks])
        still = np.flatnonzero(self.time <= REFERENCE_S)
        variance = np.full((2, len(nominal)), 1e-5)
        return Sight(
            raw=np.array(raw),
            variance=variance,
            nominal=nominal,
            frame=self.lab.rows("frame"),
            points=self.output,
            reference=still,
        )


@pytest.fixture(scope="module")
def pair(lab: Any, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    return Pair(lab, tmp_path_factory.mktemp("pair"))


def measured(pair: Pair, **changed: Any) -> Displacements:
    views = changed.pop("views", pair.views)
    return measure(views, pair.lab.marks, rig=pair.rig, stated=PERFECT, reference=REFERENCE_S, **changed)


def placed(pair: Pair, seen: list[Seen]) -> Displacements:
    """As `measured`, from what was followed."""
    return displacements_of(seen, pair.lab.marks, rig=pair.rig, stated=PERFECT)


def followed(pair: Pair, c: int, film: Video) -> Seen:
    """What camera c saw, with another film and the static film of the pair."""
    how = {"reference_s": REFERENCE_S}
    follower = prepare(film, pair.cameras[c], pair.lab.marks, dictionary=HOW.dictionary, **how)
    shown = follow(film, follower, stage="film", **how)
    frame, points = rows_of(pair.lab.marks)
    again = coded_again(film, follower, shown, frame_places(pair.lab.marks), frame, points, None)
    return replace(pair.seen[c], film=shown, codec=codec_terms(again))


@pytest.mark.slow
def test_motion_out_of_the_plane_is_measured_with_pulls_of_one(pair: Pair) -> None:
    found = placed(pair, pair.seen)
    error = found.value - pair.truth[:, pair.output]
    assert np.abs(pair.truth[..., 1]).max() > 5.0
    assert np.sqrt(np.mean(error**2, axis=(0, 1))) == pytest.approx([0, 0, 0], abs=0.003)  # 0.01 px
    pulls = error / np.sqrt(np.diagonal(found.covariance, axis1=2, axis2=3) + (found.modes**2).sum(axis=0))
    finger = np.array([role == "finger" for role in found.roles])
    for role in (finger, ~finger):
        low, high = band(pulls[:, role, 0].size / 1.5)  # values of a mark share its reference
        rms = np.sqrt(np.mean(pulls[:, role] ** 2, axis=(0, 1)))
        assert np.all((low < rms) & (rms < high))
    assert all("frame1" in sentence for sentence in found.lost)  # outside the second camera's picture
    assert np.isfinite(found.noise.sd).all()
    assert not any("does not come back" in remark for remark in found.remarks)


def test_one_camera_is_wrong_where_two_are_right(pair: Pair) -> None:
    alone = displacements_of(pair.seen[:1], pair.lab.marks, stated=PERFECT)
    error = (alone.value - pair.truth[:, pair.output])[..., [0, 2]]
    assert np.isnan(alone.value[..., 1]).all()
    assert np.nanmax(np.abs(error)) > 0.5  # r dy / Z = 50 mm x 7 mm / 380 mm = 0.9 mm


def test_a_marker_that_slips_is_named(pair: Pair, tmp_path: Path) -> None:
    seen = [
        followed(pair, c, pair.drawn(tmp_path / f"slip{c}.mkv", c, pair.time, slip=0.5)) for c in range(2)
    ]
    (said,) = [remark for remark in placed(pair, seen).remarks if "does not come back" in remark]
    assert said.startswith(f"Marker {pair.lab.marks[-1].name!r} jumps by 0.5")
    assert "at 3.100 s" in said


@pytest.mark.slow
def test_the_mean_of_a_hold_is_as_far_off_as_its_coding_error(pair: Pair, tmp_path: Path) -> None:
    time = np.arange(72) / RATE  # at rest again from 4.6 s on
    films = [pair.drawn(tmp_path / f"film{c}.mkv", c, time, codec="libx264") for c in range(2)]
    found = placed(pair, [followed(pair, c, film) for c, film in enumerate(films)])
    place = motion(pair.lab, time)[0]
    error = found.value - (place - place[time <= REFERENCE_S].mean(axis=0))[:, pair.output]
    hold = slice(50, 72)
    finger = np.array([role == "finger" for role in found.roles])
    own = np.diagonal(found.covariance, axis1=2, axis2=3)[hold].mean(axis=0) / 22
    mean, shared = error[hold].mean(axis=0), (found.modes[:, hold].mean(axis=1) ** 2).sum(axis=0)
    low, high = band(9, 2.0)
    assert low < np.sqrt(np.mean((mean / np.sqrt(own + shared))[finger] ** 2)) < high
    assert np.sqrt(np.mean((mean / np.sqrt(own))[finger] ** 2)) > 4.0  # as independent: stated far too small
    assert {n.split(":")[2] for n in found.mode_names if n.startswith("codec:")} >= {
        "1",
        "2",
        "3",
    }  # all components


def test_a_late_camera_is_found_out_and_corrected(pair: Pair) -> None:
    """The second camera's stamps are 30 ms late, a third of a frame."""
    found = placed(pair, [pair.seen[0], replace(pair.seen[1], start=0.03)])
    lags = [float(r.split("motion ")[1].split(" ms")[0]) for r in found.notes if "motion" in r]
    assert lags == [pytest.approx(30.0, abs=0.5)]
    error = found.value - pair.truth[:, pair.output]
    assert np.sqrt(np.nanmean(error**2)) < 0.004  # 0.1 mm without the correction
    assert "camera_clock:2" in found.mode_names


class Killed(Exception):
    pass


def test_a_killed_measurement_goes_on_bit_for_bit(
    pair: Pair, kept: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint, "EVERY", 20)
    whole = placed(pair, pair.seen)

    def kill(stage: str, done: int, total: int) -> None:
        if (stage, done) == ("film-2", 45):
            raise Killed

    with pytest.raises(Killed):
        measured(pair, keeper=kept, progress=kill)
    parts = {"static-1": 6, "film-1": 2, "static-2": 6, "film-2": 2}
    assert sorted(kept) == sorted(f"{stage}-{k:04d}" for stage, count in parts.items() for k in range(count))
    first: dict[str, int] = {}
    again = measured(pair, keeper=kept, progress=lambda stage, done, total: first.setdefault(stage, done))
    # Nothing that was kept is followed again; static films are whole in six parts of 20 frames.
    assert first == {"film-1": 41, "film-2": 41}
    for field in ("value", "covariance", "modes", "homography", "mode_names", "lost", "remarks", "notes"):
        np.testing.assert_array_equal(getattr(whole, field), getattr(again, field), err_msg=field)
    np.testing.assert_array_equal(whole.tracks.position, again.tracks.position)


def test_errors_of_the_calibration_are_covered_by_its_modes(pair: Pair) -> None:
    """The rig is off by draws from its stated covariance, the pixels are exact."""
    sd = np.zeros((2, OWN))
    sd[:, :5] = 2.0, 2.0, 3.0, 3.0, 2e-3
    sd[1, 9:] = 1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.5
    covariance = np.diag(sd.ravel() ** 2)
    sight, pulls = pair.sight(), []
    exact = spaceerrors.displacement(places_of(pair.rig, sight), sight.reference)
    assert exact == pytest.approx(pair.truth[:, pair.output], abs=1e-6)
    for trial in range(12):
        draw = np.random.default_rng(trial).standard_normal(int((sd > 0).sum())) @ principal(covariance)
        wrong = replace(pair.rig.moved(draw), covariance=covariance)
        value = spaceerrors.displacement(places_of(wrong, sight), sight.reference)
        modes = np.array(list(spaceerrors.calibration(wrong, sight, value).values()))
        error = (value - exact)[-1, -1]
        assert np.linalg.norm(error) > 1e-3  # mm
        pulls.append(error / np.sqrt((modes[:, -1, -1] ** 2).sum(axis=0)))
    low, high = band(12 * 2, 2.0)  # draws of three components, of which two go together
    assert low < np.sqrt(np.mean(np.square(pulls))) < high


def test_a_rigid_fit_finds_the_pose_and_refuses_a_line() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 50, (7, 3)) * (1, 0, 1)
    turn, _ = cv2.Rodrigues(np.array([0.3, -1.2, 0.8]))
    moved = points @ turn.T + (10.0, 20.0, 900.0)
    moved[3] = np.nan
    found, shift = rigid_fit(moved, points)
    assert moved[0] @ found.T + shift == pytest.approx(points[0], abs=1e-9)
    with pytest.raises(ValueError, match="lie on one line"):
        rigid_fit(points * (1, 0, 0), points)


def test_views_must_be_those_of_the_rig(pair: Pair) -> None:
    with pytest.raises(ValueError, match="1 views for 2 cameras"):
        measured(pair, views=pair.views[:1])
    with pytest.raises(ValueError, match=r"2 views for 1 cameras.* several cameras need a rig"):
        measure(pair.views, pair.lab.marks)
    with pytest.raises(ValueError, match=saying("1", r"rig\.cameras\[0\]")):
        measured(pair, views=pair.views[::-1])
    with pytest.raises(ValueError, match="a speckled face is measured by one camera"):
        measured(pair, face=Face((0.0, -40.0), (80.0, -10.0), 12.0, 10.0, 9.0))
