"""Every tuned number of the error model: a small case whose answer is known, and which fails at twice the number
and at half of it. Where each comes from stands in docs/records/error-numbers.md."""

import ast
import importlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from vision.errors import (
    codingdrift,
    codingvariance,
    independenterrors,
    reencoding,
    restdrift,
    sharederrors,
    staticnoise,
)
from vision.errors.codingdrift import CodingDrift, coding_drift
from vision.errors.independenterrors import Rest
from vision.errors.reencoding import Again
from vision.errors.staticnoise import CREEP, FAST, REST, SHAKEN, NoiseModel, states
from vision.film import packets
from vision.film.packets import Coding
from vision.film.video import Video, Writer
from vision.following.tracks import Followed, Method
from vision.kinds import CodedMarker
from vision.marks import Mark
from vision.plane import Plane, plane_of

Array = NDArray[np.float64]
Check = Callable[[], bool]
ROOT = Path(__file__).parents[3]
MODULES = [
    codingdrift, codingvariance, independenterrors, packets, reencoding, restdrift, sharederrors,
    staticnoise,
]  # fmt: skip
TIP = Mark("tip", CodedMarker(1, 9.0), (0.0, 12.0, 0.0), "finger")

# Not tuned: what coders, the machine or arithmetic say, and names of kinds.
FACTS = {
    "REST", "CREEP", "FAST", "SHAKEN", "PASSING",  # names
    "LEAST_MM", "ROUNDING",  # against a division by zero, and rounding
    "LAGS",  # a grid, see `test_the_grid_of_lags_is_fine_enough`
    "START", "FINEST", "COARSEST", "MOST_B", "SPARSE",  # of x264 and x265: default, range, defaults
    "SEARCHED",  # made of UNSEEN
    "AVX_512",  # OpenCV's name
}  # fmt: skip
SHARES = {"CREEP_SHARED", "DRIFTING", "MOST_NEW", "MOST_RHO"}  # of one half and more of a variance
CASES: dict[str, tuple[str, Check]] = {}  # number to the module that has it, and its case


def case(module: object, name: str) -> Callable[[Check], Check]:
    """The case that holds this number of a module: true where what comes out is as it should be."""

    def kept(check: Check) -> Check:
        CASES[f"{module.__name__.rpartition('.')[2]}.{name}"] = name, check
        return check

    return kept


def scaled(name: str, value: float, factor: float) -> float:
    """The number times a factor; the odds of a share, which cannot be doubled itself."""
    if name in SHARES:
        return factor * value / (1.0 + (factor - 1.0) * value)
    return int(value * factor) if isinstance(value, int) else value * factor


# -- noise -----------------------------------------------------------------------------------------------------


def path(x: Array) -> NDArray[np.int8]:
    """What a patch does that goes along x (t,) px."""
    return states(np.stack([x, 0 * x], axis=-1)[:, None])[:, 0]


@case(staticnoise, "MIN_STATIC")
def few_frames_are_said() -> bool:
    seen = np.ones((200, 2, 2))
    seen[85:, 0], seen[160:, 1] = np.nan, np.nan
    (said,) = staticnoise.hidden_in_static(seen, ["few", "many"], "still") or ("",)
    return "'few'" in said and "'many'" not in said


@case(staticnoise, "DRIFT_PX")
def slow_motion_creeps() -> bool:
    time = np.arange(80.0)
    return path(0.0028 * time)[40] == CREEP and path(0.0014 * time)[40] == REST  # 0.028 and 0.014 px in ten frames


@case(staticnoise, "SETTLED")
def the_first_picture_is_refined() -> bool:
    state = path(np.where(np.arange(80) < 60, 0.0, 5.0))
    return state[7] == SHAKEN and state[14] == REST


@case(staticnoise, "BETWEEN")
def a_move_shakes_for_a_while() -> bool:
    state = path(np.where(np.arange(80) < 40, 0.0, 0.5))
    return state[44] == SHAKEN and state[48] == REST


@case(staticnoise, "FAST_PX")
def a_pixel_a_frame_is_fast() -> bool:
    time = np.arange(80.0)
    return path(1.4 * time)[40] == FAST and path(0.7 * time)[40] != FAST


# -- how long noise lasts ---------------------------------------------------------------------------------------


def lasting(seed: int, frames: int, count: int, parts: list[tuple[float, float]]) -> Array:
    """Noise (t,n) of variance 1, less its means; parts: share and correlation from frame to frame."""
    rng, total = np.random.default_rng(seed), np.zeros((frames, count))
    for share, rho in parts:
        shock = rng.standard_normal((frames, count))
        slow = shock.copy()
        for t in range(1, frames):
            slow[t] = rho * slow[t - 1] + np.sqrt(1.0 - rho**2) * shock[t]
        total += np.sqrt(share) * slow
    return total - total.mean(axis=0)


@case(staticnoise, "SURE")
def white_noise_has_no_memory_and_a_short_one_is_seen() -> bool:
    """Three sds: once in 700 white films, not once in 15; a correlation of 4.6 sds is seen in nine of ten."""
    found = [
        sum(staticnoise.persistence_of(lasting(seed, 400, 4, [(1.0, rho)])).lasting > 0.0 for seed in range(count))
        for rho, count in ((0.0, 120), (0.115, 40))
    ]
    return found[0] <= 1 and found[1] >= 32


@case(staticnoise, "MOST_RHO")
def memory_is_50_frames_at_most() -> bool:
    rho = staticnoise.persistence_of(lasting(0, 600, 16, [(1.0, 0.997)])).rho
    return 0.965 < rho < 0.987  # 28 to 76 frames


@case(staticnoise, "TOWARDS_LONG")
def slow_errors_weigh_in_a_fit_that_cannot_be_right() -> bool:
    """Noise of two memories, 2 and 33 frames: variance of the mean of 60 frames over the true one. One memory
    cannot be both. 0.61 at half the number, 0.94 at twice."""
    told = np.mean([
        staticnoise.persistence_of(lasting(seed, 320, 64, [(0.2, 0.0), (0.5, 0.6), (0.3, 0.97)])).of_mean(60)
        for seed in range(6)
    ])  # fmt: skip
    of_mean = staticnoise.of_mean
    true = 0.2 / 60 + sum(s * of_mean(np.array(1.0), np.array(r), 60) for s, r in ((0.5, 0.6), (0.3, 0.97)))
    return 0.66 < told / true < 0.83


def test_the_grid_of_lags_is_fine_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half and twice the lags move what is told by less than half of its own scatter."""
    told = {}
    for lags in (7, 14, 28):
        monkeypatch.setattr(staticnoise, "LAGS", lags)
        found = [staticnoise.persistence_of(lasting(seed, 320, 32, [(0.25, 0.0), (0.75, 0.96)])) for seed in range(6)]
        told[lags] = np.array([one.of_mean(18) for one in found])
    for lags in (7, 28):
        assert abs(np.mean(told[lags] - told[14])) < 0.5 * np.std(told[14])


# -- films coded again ------------------------------------------------------------------------------------------


@case(reencoding, "WINDOW")
def a_third_of_a_stretch_is_before_the_fastest_motion() -> bool:
    x = np.where(np.arange(400) < 200, 0.0, 9.0)
    (first,) = reencoding.windows(np.stack([x, x], axis=-1)[:, None], np.zeros((400, 1), np.int8), [0])
    return 170 < first < 188  # 11 to 29 frames


@case(reencoding, "UNSEEN")
def the_last_frames_of_a_stretch_do_not_count() -> bool:
    return 42 < reencoding._inner(60).stop < 54 and reencoding._inner(20).stop == 20


def tries(slope: float, true: float) -> int:
    """How often the rate is tried until it is found, where so many steps of it halve the bytes."""
    tried: list[float] = []

    def off(level: float) -> float:
        tried.append(level)
        return (true - level) / slope

    assert reencoding._searched(off, reencoding.START) == pytest.approx(true, abs=slope * reencoding.NEAR)
    return len(tried)


@case(reencoding, "COARSER")
def a_coarser_rate_is_found_at_once() -> bool:
    return max(tries(4.5, true) for true in (25.0, 28.0, 32.0)) <= 2


@case(reencoding, "FINER")
def a_finer_rate_is_found_at_once() -> bool:
    return max(tries(1.7, true) for true in (16.0, 18.0, 21.0)) <= 2


@case(reencoding, "CLOSE")
def two_rates_close_to_each_other_tell_the_one_between_them() -> bool:
    return steep_tries(-3.0) == 2 and steep_tries(-6.0) > 2


def steep_tries(second: float) -> int:
    """How often a rate is tried where the second one tried is so far from the first, and the right one is
    near the first."""
    tried: list[float] = []

    def off(level: float) -> float:
        tried.append(level)
        return second / reencoding.FINER if level == reencoding.START else 1.0 if len(tried) == 2 else 0.0

    reencoding._searched(off, reencoding.START)
    return len(tried)


@case(reencoding, "NEAR")
def bytes_within_15_percent_are_near_enough() -> bool:
    return tries(4.5, 23.0 + 4.5 * 0.14) == 1 and tries(4.5, 23.0 + 4.5 * 0.28) == 2


@cache
def coded(folder: Path, tune: str) -> Video:
    """A block that wanders over a wall with others and noise of 1.5 grey levels, by x264 at crf 18."""
    rng, target, wall = np.random.default_rng(5), folder / f"{tune}.mkv", np.full((240, 320), 120.0)
    y, x = np.mgrid[0:37, 0:41]
    block = 200.0 - 130.0 * ((x + 2 * y) // 6 % 2)
    for row, column in ((13, 29), (19, 131), (21, 233), (171, 27), (173, 130), (167, 231)):
        wall[row : row + 37, column : column + 41] = block
    options = {"crf": "18", "bf": "0", **({"tune": tune} if tune else {})}
    with Writer(target, (320, 240), fps=30.0, codec="libx264", options=options) as writer:
        for k in range(70):
            grey = wall.copy()
            grey[93:130, 20 + 3 * k : 61 + 3 * k] = block
            writer.add(np.clip(np.rint(grey + 1.5 * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8))
    return Video(target)


FOLDER: list[Path] = []


@case(reencoding, "KEPT_GREY")
def what_x264_leaves_of_noise_tells_its_tuning() -> bool:
    left = [
        reencoding._noise_left([image for _, _, image in coded(FOLDER[0], tune).frames(0, 4)])
        for tune in ("", "grain")
    ]
    return left[0] < reencoding.KEPT_GREY < left[1]


@case(reencoding, "CAMERA_GREY")
def the_rate_of_a_film_is_found_when_its_noise_is_put_back() -> bool:
    film = coded(FOLDER[0], "")
    level, _ = reencoding._matched(film, film.coding(), slice(0, 60), None, FOLDER[0] / "again.mkv")
    return abs(level - 18.0) < 1.0


@case(packets, "LIVE_S")
def even_key_frames_tell_a_film_that_is_coded_while_it_is_taken() -> bool:
    """Phones draw a key frame every second; x264's usual 250 frames are 8 s at 30 frames/s and 4 s at 60."""
    every = [Coding("h264", np.ones(500, np.intp), np.arange(500) % step == 0, 0, 30.0) for step in (40, 90)]
    return every[0].live and not every[1].live


# -- what coding leaves -----------------------------------------------------------------------------------------


def held_over_slow() -> float:
    """What is told of rests that have no error at all, two of them, over what creeping patches have."""
    state = np.full((60, 3), CREEP, np.int8)
    state[30:, :2] = REST
    error = np.where(np.arange(60)[:, None, None] % 2, 0.005, -0.005) * np.ones((60, 3, 2))
    error[30:, :2] = 0.0
    found = codingvariance.codec_terms([Again(slice(0, 60), error, state, 23.0, 1.0)])
    return float(found.held[0] / found.creep[0])


@case(codingvariance, "RESTS")
def two_rests_are_worth_what_was_known() -> bool:
    return abs(held_over_slow() / (0.9 * np.sqrt(0.5)) - 1.0) < 0.1


@case(codingvariance, "STOPS")
def an_unseen_rest_has_most_of_the_error_of_slow_motion() -> bool:
    return abs(held_over_slow() / np.sqrt(0.5) - 0.9) < 0.1  # drawn film, see the record


# -- modes ------------------------------------------------------------------------------------------------------


def shared(state: int, length: int, *, rests: int = 1) -> tuple[sharederrors.Named, Array]:
    """Modes of a mark that does so for so many frames, as often, with 1 mm of coding error; and what is left."""
    hold = np.concatenate([np.full(length, state), [FAST]])
    states = np.tile(hold, rests)[:, None].astype(np.int8)
    found, left, _ = sharederrors.codec(np.full((len(states), 1, 3), 1.0) * (1.0, 0.0, 0.0), states, [TIP])
    return found, left[: length, 0, 0]


@case(sharederrors, "MIN_HOLD")
def three_frames_are_a_hold() -> bool:
    return not shared(REST, 2)[0] and bool(shared(REST, 4)[0])


@case(sharederrors, "MAX_HOLDS")
def sixty_holds_have_modes() -> bool:
    return 45 < len(shared(REST, 4, rests=130)[0]) < 85


@case(sharederrors, "LONG")
def a_late_picture_drifts_in_a_long_hold() -> bool:
    return len(shared(CREEP, 15)[0]) == 1 and len(shared(CREEP, 28)[0]) == 2


@case(sharederrors, "CREEP_SHARED")
def most_of_a_creeping_marks_error_stays() -> bool:
    _, left = shared(CREEP, 15)
    return bool(np.all(np.abs(left**2 - 0.25) < 0.07))


@case(sharederrors, "DRIFTING")
def half_of_a_late_pictures_error_grows() -> bool:
    found, _ = shared(CREEP, 40)
    power = {name: float(np.sum(mode**2)) for name, mode in found.items()}
    return abs(power["codec:tip:1:1:drift"] / sum(power.values()) - 0.5) < 0.1


def drawn_anew(coded_mm: float) -> float:
    """Px of the error of a mark that lies on other pixels than at rest."""
    value, ideal = np.zeros((20, 1, 3)), np.zeros((20, 1, 2))
    value[5:, 0, 2], ideal[5:, 0, 1] = 1.0, 8.0
    found = sharederrors.redrawn(value, ideal, np.arange(3), [TIP], coded_mm)
    return 8.0 * max(float(mode.max()) for mode in found.values())


@case(sharederrors, "REDRAWN_PX")
def coding_draws_a_moved_mark_anew() -> bool:
    return 0.0028 < drawn_anew(1.0) < 0.0057


@case(sharederrors, "BETWEEN_PX")
def registration_errs_between_pixels() -> bool:
    return 0.00056 < drawn_anew(0.0) < 0.00113


@case(sharederrors, "LEVEL")
def neighbours_lie_along_the_finger() -> bool:
    points = np.array([(0.0, 0, 0), (20.0, 0, 2.8), (10.0, 0, 2.8)])  # slopes of 0.14 and 0.28
    return sharederrors._beside(points, [0, 1, 2], 0) == (0, 1)


@case(sharederrors, "UNLIKELY")
def residuals_contradict_once_in_a_thousand() -> bool:
    told = []
    for chance in (0.0014, 0.0007):
        misfit = np.full((7, 2), np.sqrt(chi2.isf(chance, 6) / 14))
        told.append(bool(sharederrors.frame_sd(misfit, ["a"] * 7, 1.0, fitted=8)[1]))
    return told == [False, True]


# -- key frames, and what changes between them -------------------------------------------------------------------

NOMINAL = np.array([(x, z) for x in (0.0, 50.0, 100.0) for z in (0.0, 60.0)])
KEYS = codingdrift.stretches(np.array([0, 240]), 480)
NOISE = 1e-6  # mm, so small that what is told is all that counts


def plane(error: Array, *, spare: bool = True) -> Plane:
    """Frame marks of errors (t,6,2) mm, 1 px/mm; only four of them without spare ones."""
    pixels = NOMINAL + error
    pixels[:, 4 if not spare else 6 :] = np.nan
    return plane_of(NOMINAL, pixels)


def told(error: Array | float = 0.0, *, frozen: float = 1e-6, spare: bool = True) -> CodingDrift:
    """Coding drift of a film whose frame marks err by (480,6,2) mm; its static film shows two of noise NOISE."""
    model = NoiseModel(
        sd=np.full((2, 3), NOISE), rho=np.zeros((2, 3)), correlation=np.eye(6), frames=300, codec_sd=np.zeros((2, 3))
    )
    rest = Rest(model, 0.0, 0.0, np.zeros((2, 2)), np.zeros(2))
    film, quiet = plane(np.zeros((480, 6, 2)) + error, spare=spare), plane(np.zeros((300, 6, 2)), spare=spare)
    return coding_drift(film, quiet, np.zeros((300, 2, 2)), rest, frozen, KEYS, [slice(0, 300)])


def new(found: CodingDrift, row: int = 0) -> float:
    """Share of the variance that is new from one block to the next."""
    return 1.0 - float(found.covariance[row, row + 1] / found.covariance[row, row])


@case(codingdrift, "LONG")
def key_frames_two_seconds_apart_are_rare() -> bool:
    often, rare = (codingdrift.stretches(np.arange(0, 900, step), 900) for step in (42, 85))
    return not codingdrift.rare(often) and codingdrift.rare(rare)


def courses(rms: Array) -> int:
    """How many courses count, of blocks of these rms (b,) mm where marks have noise of 1 mm."""
    blocks = tuple(slice(40 * k, 40 * (k + 1)) for k in range(len(rms)))
    drift = CodingDrift(blocks, np.diag(len(rms) * rms**2), 0.0, 1.0)
    steps = np.arange(40 * len(rms) + 40)  # the reference is after all blocks: nothing is subtracted
    return len(codingdrift.courses(drift, steps, steps[-40:]))


@case(codingdrift, "MOST")
def twelve_courses_have_modes() -> bool:
    return 8 < courses(np.ones(30)) < 17


@case(codingdrift, "LEAST")
def a_course_far_below_the_noise_has_no_mode() -> bool:
    return courses(np.array([0.14, 0.07])) == 1


@case(codingdrift, "BLOCK")
def six_blocks_between_two_key_frames() -> bool:
    return len(told().blocks) == 12  # of 480 frames


@case(codingdrift, "FRESH")
def a_key_frame_draws_half_of_it_anew() -> bool:
    return abs(told(spare=False).covariance[0, 0] / 1e-6 - 0.6) < 0.15


@case(codingdrift, "WORTH")
def frame_marks_that_do_not_step_count_too() -> bool:
    """4 values of the frame marks at one key frame say 0, coding once more says 1e-6."""
    return abs(told().covariance[0, 0] / (0.6 * 1e-6) - 0.6) < 0.1


@case(codingdrift, "SLOW")
def a_film_that_tells_nothing_changes_slowly() -> bool:
    return abs(new(told(spare=False)) / 0.014 - 1.0) < 0.3


@case(codingdrift, "FEW")
def a_film_that_does_not_change_is_half_believed() -> bool:
    """10 changes of 4 values are 0: 4 of 44 is left of what was known; each then counts as much as all: half."""
    return abs(new(told()) / (0.014 * 4 / 44 / 2) - 1.0) < 0.4


@case(codingdrift, "MOST_NEW")
def a_block_drawn_anew_forgets() -> bool:
    rng = np.random.default_rng(1)
    error = np.repeat(0.1 * rng.standard_normal((12, 6, 2)), 40, axis=0)
    return 0.93 < new(told(error)) < 0.965


# -- rest -------------------------------------------------------------------------------------------------------


def apart(place: Array) -> float:
    """What is told of one mark's places (t,) or (t,2) mm that should be at rest, mm."""
    both = place if place.ndim == 2 else np.stack([place, 0 * place], axis=-1)
    found = restdrift.unrest(both[:, None], ["tip"])
    return found.mm if found is not None else 0.0


def moves(mm: float) -> bool:
    found = restdrift.unrest(np.linspace(0.0, 1.2 * mm, 300)[:, None, None] * np.array([1.0, 0.0]), ["tip"])
    return found is not None and found.moves


@case(restdrift, "BLOCKS")
def a_drift_is_told_by_its_outer_sixths() -> bool:
    return 0.75 < apart(np.linspace(0.0, 1.0, 300)) < 0.88


@case(restdrift, "FEW")
def three_frames_are_no_part() -> bool:
    jump, spike = np.repeat([0.0, 1.0], 4), np.where(np.arange(8) == 5, 0.08, 0.0)
    return apart(jump) == 1.0 and apart(spike) == 0.0


def flips(*along: float) -> bool:
    ends = np.array([[0.0, 0.0], [1.0, 0.0]])
    return restdrift._flips(np.array(along)[:, None] * ends[1], ends)


@case(restdrift, "TURNS")
def to_and_fro_is_three_jumps() -> bool:
    return flips(0, 0, 1, 1, 0, 0, 1, 1) and not flips(0, 0, 1, 1, 1, 1, 0, 0)


@case(restdrift, "BETWEEN")
def the_middle_of_the_way_is_in_between() -> bool:
    return flips(*[0.25, 0.75] * 10) and not flips(*[0.35, 0.65] * 10)


@case(restdrift, "RARE")
def hardly_a_frame_is_in_between() -> bool:
    return flips(*[0, 1] * 9, 0.5, 0.5) and not flips(*[0, 1] * 8, *[0.5] * 4)


@case(restdrift, "CLEAR")
def ten_sds_of_a_mean_are_clear() -> bool:
    """The mean of 50 frames of 0.1 mm has 0.014 mm, a difference 0.02 mm: steps of 7 and 14 of these."""
    white = 0.1 * np.random.default_rng(0).standard_normal((300, 2))
    for part in np.array_split(white, 6):
        part -= part.mean(axis=0)
    step = np.repeat([(0.0, 0.0), (1.0, 0.0)], 150, axis=0)
    return apart(white + 0.14 * step) == 0.0 and apart(white + 0.28 * step) > 0.2


@case(restdrift, "MOST_MM")
def a_quarter_of_a_millimetre_is_a_motion() -> bool:
    return not moves(0.18) and moves(0.35)


@case(restdrift, "TELL_MM")
def a_drift_of_some_hundredths_is_told() -> bool:
    return apart(np.linspace(0.0, 0.025, 300)) == 0.0 and apart(np.linspace(0.0, 0.05, 300)) > 0.0


# -- the variance of one place -----------------------------------------------------------------------------------


@case(independenterrors, "OWN")
def a_tenth_of_a_marks_noise_is_its_own_at_least() -> bool:
    """A mark whose whole static variance, 1 mm2, is the homography's is blurred to twice its variance."""
    flat = plane(np.zeros((1, 6, 2)))
    model = NoiseModel(
        sd=np.ones((1, 3)), rho=np.zeros((1, 3)), correlation=np.eye(3), frames=300, codec_sd=np.zeros((1, 3))
    )
    rest = Rest(model, 0.0, 0.0, np.ones((1, 2)), np.zeros(2))
    worse, place = np.full((1, 7), 2.0), np.full((1, 1, 2), 10.0)
    parts = independenterrors.independent(rest, flat, place, worse, list(range(6)), [6])
    return 0.07 < parts["blur"][0, 0, 0] < 0.14


def misfits(size: Array, ideal: Array) -> Array:
    """Times its usual variance (t,) that one mark of residual variances (t,) px2 states."""
    frames, one = len(size), np.ones((len(size), 1))
    followed = Followed(
        time=np.arange(frames) / 10.0, warp=np.tile(np.eye(3), (frames, 1, 1, 1)), ideal=ideal[:, None],
        covariance=0.5 * size[:, None, None, None] * np.eye(2), growth=one, reference=np.arange(3),
        method=np.full(one.shape, Method.REGISTERED, np.int8),
    )  # fmt: skip
    return independenterrors.misfit(followed)[:, 0]


@case(independenterrors, "CLEARLY")
def three_times_the_usual_residual_is_clear() -> bool:
    size = np.ones(100)
    size[50], size[60] = 2.1, 4.2
    ratio = misfits(size, np.zeros((100, 2)))
    return ratio[50] == 1.0 and ratio[60] > 4.0


@case(independenterrors, "LEAST_MOVING")
def where_pictures_repeat_what_moves_is_usual() -> bool:
    """120 frames repeat one picture, and leave nothing; while the mark moves 1 to 100 px2 are left. A
    quarter of what counts as moving, the first pictures with it, leaves 15 px2 at most."""
    size = np.concatenate([np.full(120, 1e-9), np.arange(1.0, 101.0)])
    x = np.concatenate([np.zeros(120), 2.0 * np.arange(100)])
    return 4.6 < misfits(size, np.stack([x, x], axis=-1))[-1] < 9.0


# -- all of them -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    FOLDER.append(tmp_path_factory.mktemp("coded"))


@pytest.mark.parametrize("number", CASES)
def test_a_number_is_right_and_neither_twice_nor_half_of_it(number: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, check = CASES[number]
    home = importlib.import_module(packets.__name__ if number.startswith("packets") else f"vision.errors.{number.partition('.')[0]}")
    value = getattr(home, name)
    assert check()
    for factor in (2.0, 0.5):
        for module in MODULES:  # those that import it, too
            if name in imported(module.__name__, home.__name__):
                monkeypatch.setattr(module, name, scaled(name, value, factor))
        with np.errstate(all="ignore"):
            try:
                right = check()
            except (AssertionError, ValueError, IndexError):
                right = False
        assert not right, f"{number} times {factor:g} is not seen"


@cache
def imported(module: str, home: str) -> frozenset[str]:
    """Names of another module that a module has from it; all of its own."""
    if module == home:
        return frozenset(vars(importlib.import_module(module)))
    tree = ast.parse(Path(importlib.import_module(module).__file__ or "").read_text(encoding="utf-8"))
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == home]
    return frozenset(alias.name for node in froms for alias in node.names)


def numbers(module: object) -> set[str]:
    """Module-level names in capitals that hold numbers."""
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    targets = [t for node in tree.body if isinstance(node, ast.Assign) for t in node.targets]
    names = {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name) and n.id.isupper()}
    return {name for name in names if isinstance(getattr(module, name), (int, float))}


def test_every_number_of_the_room_has_its_case_and_its_record() -> None:
    own = {f"{module.__name__.rpartition('.')[2]}.{name}" for module in MODULES for name in numbers(module) - FACTS}
    assert own == set(CASES)
    page = "docs/records/error-numbers.md"
    record = (ROOT / page).read_text(encoding="utf-8")
    assert [number for number in CASES if f"`{number}`" not in record] == []
    assert [m.__name__ for m in MODULES if page not in Path(m.__file__ or "").read_text(encoding="utf-8")] == []
