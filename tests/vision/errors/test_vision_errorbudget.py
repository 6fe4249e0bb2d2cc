"""The error budget, source by source: what is drawn comes back as stated, over hundreds of drawn rigs.

No pictures: places are projected exactly by a drawn pinhole camera and only then disturbed, so that every
source can be drawn alone, at a size at which it leads. benchmarks/tracking/budget.py does the same on drawn films.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import says
from tests.pulls import band
from vision import Camera, Displacements, Mark, Stated
from vision.errors.codingvariance import Codec
from vision.errors.errorbudget import budget, from_csv, lines, to_csv, with_mode
from vision.errors.sharederrors import sync
from vision.following.tracks import Followed, Method
from vision.kinds import CodedMarker
from vision.measuring.displacements import displacements_of
from vision.placing.views import Seen

Array = NDArray[np.float64]
FEW, MANY = 25, 100  # drawn tests; many in `make test-slow`
DRAWS = pytest.mark.parametrize("draws", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
DEPTH = 12.0  # mm
NOISE_PX = 0.004
STILL, REST, STEPS = 120, 10, 40
TINY = Stated(
    placement_mm=1e-6, scale=1e-9, frame_mm=1e-6, node_mm=1e-6, height_mm=1e-6, out_of_plane_mm=1e-6
)
LENS = Camera(np.array([[2400.0, 0, 640.0], [0, 2400.0, 360.0], [0, 0, 1.0]]), np.zeros(5), (1280, 720))
FRAME = [(-35, 30), (45, 34), (125, 30), (-35, -70), (45, -72), (125, -70)]
FIXED = [(5, 32), (85, 32), (-34, -15), (123, -15)]
FINGER = [(30, 0), (60, 0), (90, 0)]


@dataclass(frozen=True)
class Drawn:
    """What truly happened in one drawn test."""

    marks: tuple[Mark, ...]
    frame_off: Array  # (m,2) mm true minus nominal places of the frame marks
    tag_off: Array  # (m,2) mm, tags glued off their nominal places
    node_off: Array  # (m,2) mm, material points under the tags minus nominal
    scale: float = 0.0  # true lengths are nominal times 1 + scale
    hidden: tuple[int, ...] = ()  # frame marks not seen after the rest
    jitter: float = 0.0  # px, sd of what all marks but those of the frame share in a picture
    bend: Array = field(
        default_factory=lambda: np.concatenate([np.zeros(REST), np.linspace(0.001, 0.016, STEPS - REST)])
    )


def rig() -> tuple[Mark, ...]:
    flat = [
        (role, x, z)
        for role, spots in (("frame", FRAME), ("fixed", FIXED), ("finger", FINGER))
        for x, z in spots
    ]
    return tuple(
        Mark(f"{role}{i}", CodedMarker(i, 9.0), (float(x), DEPTH, float(z)), role)
        for i, (role, x, z) in enumerate(flat)
    )


def arc(x: Array, z: Array, bend: float) -> tuple[Array, Array]:
    """Places (n,2) mm of material points on a finger bent to an arc and stretched by 5 % at full bend."""
    bend = max(bend, 1e-9)
    along = x * (1.0 + 3.0 * bend)
    return np.column_stack(
        [
            np.sin(bend * along) / bend + z * np.sin(bend * along),
            (np.cos(bend * along) - 1.0) / bend + z * np.cos(bend * along),
        ]
    ), -bend * along


def truth(d: Drawn, bend: Array) -> tuple[Array, Array, Array]:
    """Tags' centres (t,m,2) mm and turns (t,m) as they are filmed, and places of the model's points (t,m,2)."""
    nominal = np.array([m.position for m in d.marks])[:, [0, 2]]
    finger = np.array([m.role == "finger" for m in d.marks])
    place = np.tile(nominal + d.frame_off, (len(bend), 1, 1))
    turn, model = np.zeros(place.shape[:2]), place.copy()
    for t, b in enumerate(bend):
        model[t, finger], _ = arc(*nominal[finger].T, b)
        carrier, turned = arc(*(nominal + d.node_off)[finger].T, b)
        c, s = np.cos(turned), np.sin(turned)
        off = d.tag_off[finger]
        place[t, finger] = carrier + np.column_stack(
            [c * off[:, 0] - s * off[:, 1], s * off[:, 0] + c * off[:, 1]]
        )
        turn[t, finger] = turned
    return place * (1.0 + d.scale), turn, model * (1.0 + d.scale)


def camera(rng: np.random.Generator) -> Array:
    """Homography (3,3) of a drawn camera from the plane (x, z, 1) mm to px: 3 to 5 px/mm, tilted by up to 12 degrees."""
    facing = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    turned = cv2.Rodrigues(np.deg2rad(rng.uniform(-12, 12, 3)))[0] @ facing
    depth = rng.uniform(480.0, 800.0)
    tvec = np.array([0.0, 0.0, depth]) - turned @ np.array([45.0, DEPTH, -15.0])
    return LENS.matrix @ np.column_stack([turned[:, 0], turned[:, 2], tvec + turned[:, 1] * DEPTH])


def followed(d: Drawn, H: Array, bend: Array, rng: np.random.Generator, noise: float) -> Followed:
    place, turn, _ = truth(d, bend)
    c, s = 4.5 * np.cos(turn), 4.5 * np.sin(turn)
    zero, one = np.zeros_like(c), np.ones_like(c)
    local = np.stack(
        [
            np.stack(row, axis=-1)
            for row in ((-c, s, place[..., 0]), (-s, -c, place[..., 1]), (zero, zero, one))
        ],
        axis=-2,
    )
    warp = H @ local
    warp = warp / warp[..., 2:, 2:]
    warp[..., :2, 2] += noise * rng.standard_normal((*place.shape[:2], 2))
    if d.jitter:
        loose = np.array([[m.role != "frame"] for m in d.marks])
        warp[..., :2, 2] += d.jitter * rng.standard_normal((len(bend), 1, 2)) * loose
    if len(bend) == STEPS:
        warp[REST:, list(d.hidden)] = np.nan
    seen = np.isfinite(warp[..., 0, 0])
    covariance = np.where(seen[..., None, None], NOISE_PX**2 * np.eye(2), np.nan)
    method = np.where(seen, Method.REGISTERED, Method.LOST).astype(np.int8)
    return Followed(
        time=np.arange(len(bend)) / 10.0,
        warp=warp,
        ideal=warp[..., :2, 2].copy(),
        covariance=covariance,
        method=method,
        growth=np.ones(method.shape),
        reference=np.arange(REST),
    )


def measured(d: Drawn, stated: Stated, seed: int, noise: float = NOISE_PX) -> tuple[Displacements, Array]:
    """The test as it is measured, and its error (s,p,2) mm."""
    rng = np.random.default_rng(seed)
    H = camera(rng)
    film, still = followed(d, H, d.bend, rng, noise), followed(d, H, np.zeros(STILL), rng, noise)
    none = Codec(*np.zeros((4, 3)))
    result = displacements_of([Seen(camera=LENS, film=film, still=still, codec=none)], d.marks, stated=stated)
    model = truth(d, d.bend)[2][:, [i for i, m in enumerate(d.marks) if m.role != "frame"]]
    return result, result.value[..., [0, 2]] - (model - model[:REST].mean(axis=0))


def test_fewer_steps_are_the_same_steps() -> None:
    """Of 40 frames 7, evenly, and the 10 of the reference: what they say is what they said among all."""
    zero = np.zeros((len(rig()), 2))
    d, rng = Drawn(rig(), zero, zero, zero, hidden=(2,)), np.random.default_rng(3)
    H, none = camera(rng), Codec(*np.zeros((4, 3)))
    film, still = (followed(d, H, bend, rng, 1e-2) for bend in (d.bend, np.zeros(STILL)))
    seen = Seen(camera=LENS, film=film, still=still, codec=none)
    stated = Stated(height_mm=1e-6, out_of_plane_mm=1e-6)
    whole, fewer = (displacements_of([seen], d.marks, stated=stated, steps=most) for most in (STEPS, 7))
    kept = [*range(REST), 13, 20, 26, 32, 39]
    np.testing.assert_array_equal(fewer.time, whole.time[kept])
    np.testing.assert_array_equal(fewer.reference, np.arange(REST))
    np.testing.assert_allclose(fewer.value, whole.value[kept], atol=1e-9)
    np.testing.assert_allclose(fewer.covariance, whole.covariance[kept], rtol=1e-6, atol=1e-15)
    # The frame's modes are turned to be orthogonal over the steps, so that only their sum is the same.
    power = [(r.modes**2).sum(axis=0) for r in (fewer, whole)]
    np.testing.assert_allclose(power[0], power[1][kept], rtol=1e-4, atol=1e-12)
    np.testing.assert_array_equal(fewer.tracks.position, whole.tracks.position)
    np.testing.assert_allclose(fewer.noise.rho, whole.noise.rho ** (STEPS / len(kept)))
    assert fewer.notes[0].startswith("All 40 frames were tracked; 15 of them are kept as targets")
    assert not any("were tracked" in note for note in whole.notes)


def pulls(drawn: list[tuple[Displacements, Array]], role: str, *, mean: bool = False) -> float:
    """Rms of error over stated sd after the rest; with `mean` of each mark's mean over the steps."""
    found = []
    for result, error in drawn:
        chosen = [p for p, r in enumerate(result.roles) if r == role]
        variance = np.diagonal(result.covariance, axis1=2, axis2=3)[REST:, chosen][..., [0, 2]]
        # Without pictures nothing is registered between pixels.
        kept = [k for k, name in enumerate(result.mode_names) if not name.endswith((":moved", ":after"))]
        modes = result.modes[kept][:, REST:, chosen][..., [0, 2]]
        e = error[REST:, chosen]
        if mean:
            sd = np.sqrt(variance.mean(axis=0) / len(e) + (modes.mean(axis=1) ** 2).sum(axis=0))
            found.append((e.mean(axis=0) / sd).ravel())
        else:
            found.append((e / np.sqrt(variance + (modes**2).sum(axis=0))).ravel())
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2)))


def drawn(rng: np.random.Generator, source: str) -> tuple[Drawn, Stated]:
    """One test in which a source is drawn at the size that is stated, and nothing else but the noise."""
    marks, size = rig(), len(FRAME) + len(FIXED) + len(FINGER)
    zero = np.zeros((size, 2))
    d = Drawn(marks, zero, zero, zero)
    frame = np.array([m.role == "frame" for m in marks])
    if source == "frame":
        return replace(d, frame_off=0.2 * rng.standard_normal((size, 2)) * frame[:, None]), replace(
            TINY, frame_mm=0.2
        )
    if source == "placement":
        return replace(d, tag_off=0.3 * rng.standard_normal((size, 2))), replace(TINY, placement_mm=0.3)
    if source == "node":
        return replace(d, node_off=0.3 * rng.standard_normal((size, 2))), replace(TINY, node_mm=0.3)
    if source == "scale":
        # What the user states is off: true lengths are (1 + scale) times the nominal ones.
        return replace(d, scale=0.005 * rng.standard_normal()), replace(TINY, scale=0.005)
    if source == "hidden":
        return replace(d, hidden=(0, 3)), TINY
    return d, TINY


@pytest.mark.parametrize("source", ["noise", "hidden", "frame", "placement", "node", "scale"])
@DRAWS
def test_pulls_of_one_source(source: str, draws: int) -> None:
    rng = np.random.default_rng(sum(map(ord, source)))
    tests = [measured(*drawn(rng, source), seed) for seed in range(draws)]
    # Six modes or more are drawn, or the one scale factor, which is all there is; then 1.7 sds.
    low, high = band(draws, 1.7) if source == "scale" else band(6 * draws)
    for role in ("fixed", "finger"):
        for mean in (False, True):
            assert low < pulls(tests, role, mean=mean) < high, (role, mean)
    table = tests[0][0].budget
    leading = {"noise": "static", "hidden": "static"}.get(source, source)
    finger = [p for p, role in enumerate(tests[0][0].roles) if role == "finger"]
    size = np.sqrt((table.sd[:, finger] ** 2).sum(axis=(1, 2)))
    assert table.sources[int(np.argmax(size))] == leading


@pytest.mark.parametrize("jitter", [0.0, 1.0])
@DRAWS
def test_pulls_of_the_mean_over_marks_that_jitter_together(jitter: float, draws: int) -> None:
    zero = np.zeros((len(FRAME) + len(FIXED) + len(FINGER), 2))
    d = Drawn(rig(), zero, zero, zero, jitter=jitter * NOISE_PX)
    found, whole, row = [], [], []
    for seed in range(draws):
        result, error = measured(d, TINY, seed)
        count = len(result.names)
        correlation = result.noise.correlation.reshape(count, 3, count, 3)
        sd = np.sqrt(np.diagonal(result.covariance, axis1=2, axis2=3))
        for k, axis in enumerate((0, 2)):
            s, r = sd[REST:, :, axis], correlation[:, axis, :, axis]
            modes = result.modes[:, REST:, :, axis].mean(axis=2)
            each = np.einsum("tp,pq,tq->t", s, r, s) / count**2
            found.append(error[REST:, :, k].mean(axis=1) / np.sqrt(each + (modes**2).sum(axis=0)))
            mean = each.mean() / len(each) + (modes.mean(axis=1) ** 2).sum()
            whole.append(error[REST:, :, k].mean() / np.sqrt(mean))
        table = dict(zip(result.budget.sources, result.budget.sd, strict=True))
        row.append(table["jitter"][..., [0, 2]] / np.hypot(table["static"], table["jitter"])[..., [0, 2]])
    # Two axes of 30 steps that share the reference's mean, and of all steps together
    low, high = band(12 * draws)
    assert low < np.sqrt(np.mean(np.concatenate(found) ** 2)) < high
    low, high = band(2 * draws, 2.6)
    assert low < np.sqrt(np.mean(np.square(whole))) < high
    # Where the two are alike it is half the variance, less what the homography has of it; where there is
    # none, 7 marks in 120 pictures tell it to a tenth of their own variance.
    share = float(np.mean(np.square(row)))
    assert (0.35 < share < 0.55) if jitter else (share < 0.05)


def test_sync_is_velocity_times_the_clocks_error() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.4, 0.5, 0.6])
    value = np.zeros((6, 2, 3))
    value[:, 0, 0], value[:, 0, 2] = 5.0 * time, -2.0 * time
    value[:, :, 1] = np.nan
    value[2, 0] = np.nan  # lost
    mode = sync(time, value, 0.01)
    np.testing.assert_allclose(mode[:, 0], np.tile([0.05, 0.0, -0.02], (6, 1)), atol=1e-12)
    assert not mode[:, 1].any()


def test_frame_marks_that_contradict_what_is_stated_are_said_and_count() -> None:
    rng = np.random.default_rng(4)
    marks = rig()
    frame = np.array([m.role == "frame" for m in marks])
    off, zero = np.zeros((len(marks), 2)), np.zeros((len(marks), 2))
    off[1] = 1.5  # one frame mark's place is mistyped
    result, _ = measured(Drawn(marks, off * frame[:, None], zero, zero), replace(TINY, frame_mm=0.05), 0)
    says(result.remarks[0], "'frame1'", "0.05 mm", "(frame_sd_mm)")
    said, _ = measured(
        Drawn(marks, 0.05 * rng.standard_normal((len(marks), 2)) * frame[:, None], zero, zero),
        replace(TINY, frame_mm=0.05),
        0,
    )
    assert not any("stated places" in sentence for sentence in said.remarks)
    row = result.budget.sources.index("frame")
    assert result.budget.sd[row].max() > 5.0 * said.budget.sd[row].max()


def test_table_as_text_and_csv() -> None:
    modes = np.zeros((2, 4, 2, 3))
    modes[0, :, 1, 0], modes[1, 3, 1, 2] = 3.0, 8.0
    seen = np.array([[True, True]] * 3 + [[False, True]])
    variance = {"static": np.full((4, 2, 3), 1.0)}
    variance["static"][..., 1] = np.nan
    table = budget(variance, modes, ["scale", "placement:b:x"], seen)
    rows = {source: (table.sd[r], table.peak[r]) for r, source in enumerate(table.sources)}
    np.testing.assert_allclose(rows["static"][0], [[1, 0, 1], [1, 0, 1]])
    np.testing.assert_allclose(rows["scale"][0], [[0, 0, 0], [3, 0, 0]])
    np.testing.assert_allclose(rows["placement"][0], [[0, 0, 0], [0, 0, 4]])  # rms of 0, 0, 0, 8
    np.testing.assert_allclose(rows["placement"][1], [[0, 0, 0], [0, 0, 8]])
    np.testing.assert_allclose(table.total()[1], [np.sqrt(10), 0, np.sqrt(17)])
    again, names = from_csv(to_csv(table, ["a", "b"]))
    assert names == ("a", "b")
    assert again.sources == table.sources
    np.testing.assert_allclose(again.sd, table.sd, rtol=1e-5)
    np.testing.assert_allclose(again.peak, table.peak, rtol=1e-5)
    more = with_mode(table, "sync", modes[1], seen)
    np.testing.assert_allclose(more.sd[more.sources.index("sync")], rows["placement"][0])
    assert "largest: placement; smaller by markers placed with a jig" in lines(table, ["a", "b"])[-1]
