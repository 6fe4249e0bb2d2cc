"""The noise that values show by themselves, without a model: how they scatter about smooth courses, from step
to step.

What moves with the pressure is no noise: each step's values are projected off the direction in which the
points move with it, where the gauge's error and the regulator's ripple are. Smooth courses are fitted and
taken off: powers of the pressure, its memory, rests and holds, slow functions of time.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.judging.comparison import branches
from twin.judging.lawerrors import memory
from twin.judging.stillnoise import STATED, correlated, mean_variance
from twin.targets import Array, Noise, Targets, least_known

POWERS = 5  # of the pressure that a smooth course may hold
SLOW = 24  # steps for every slow function of time: noise with a memory of some steps is faster
OFTEN = 0.8  # of the steps in which a component is seen that counts
LEAST = 60  # degrees of freedom: fewer tell an sd worse than to a tenth
MOST_RHO = 0.9  # what lasts longer may be a motion that no course above follows
SMOOTHED = 0.25  # of a stated sd below which values are no measured ones, or smoothed: it is kept
LAGS = (1, 2, 4, 8)  # steps of the second differences that tell a coding error's size and memory
FAR = 4.0  # times a usual step's power: beyond it is a motion
MOST_FAR = 0.2  # share of the steps beyond which no second difference is trusted
CLEAR = 3.0  # sds by which a factor or a correlation must differ to be used
EVEN = 1.5  # largest ratio of the mean power of a step to that of a usual one: more is no noise but a motion
UNLIKELY = 0.003  # chance of so different a noise below which what is stated is wrong


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """What values show of their noise: sd in mm of all together; rho from step to step; shared, the
    correlation of two points in an axis; freedom, the degrees of freedom of the sd; chance (sd, rho) of a
    noise at least as different, where the noise is of that sd and rho."""

    sd: float
    rho: float
    shared: float
    freedom: float
    chance: Callable[[float, float], float]


def own_scatter(targets: Targets) -> Scatter | None:
    """The noise of the finger's points in a film; None where the values tell too little of it.

    It is that of the largest restricted likelihood (Patterson & Thompson 1971, doi 10.1093/biomet/58.3.545)
    of an autoregression about smooth courses.
    """
    data = targets.used
    often = np.argwhere(data.mean(axis=0) >= OFTEN * data.any(axis=(1, 2)).mean())
    if len(often) < 2:
        return None
    steps = np.flatnonzero(data[:, often[:, 0], often[:, 1]].all(axis=1))
    if len(steps) < SLOW:
        return None
    smooth, slopes = (x[steps] for x in smooth_courses(targets))
    value = targets.value[steps][:, often[:, 0], often[:, 1]]
    first = np.append(True, (np.diff(steps) > 1) | (np.diff(targets.block[steps]) > 0))
    basis = _orthonormal(smooth)
    direction = slopes @ np.linalg.lstsq(smooth[:, : slopes.shape[1]], value, rcond=None)[0]
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = direction / np.where(size > 0, size, 1.0)
    left = value - basis @ (basis.T @ value)
    left = left - direction * (direction * left).sum(axis=1, keepdims=True)
    columns = len(often) - float((direction**2).sum(axis=1).mean())
    free = (len(steps) - basis.shape[1]) * columns
    if len(steps) <= basis.shape[1] or free < LEAST:
        return None
    likelihood = _likelihood(basis, left, first, columns)
    best = scipy.optimize.minimize_scalar(lambda r: likelihood(r)[0], bounds=(0.0, 0.99), method="bounded")
    rho = float(best.x)
    rho = 0.0 if likelihood(0.0)[0] <= likelihood(rho)[0] else rho
    new = _new(np.column_stack([basis, left]), first, rho)
    q = np.linalg.qr(new[:, : basis.shape[1]])[0]
    new = new[:, basis.shape[1] :]
    new = new - q @ (q.T @ new)
    power = new.T @ new / (len(steps) - basis.shape[1])
    sd, shared = _shared(power, direction, often[:, 1])
    alike = 1 + (len(often) / len(np.unique(often[:, 1])) - 1) * shared**2  # values that tell the same
    least = likelihood(rho)[0]

    def chance(stated_sd: float, stated_rho: float) -> float:
        deviance, variance = likelihood(stated_rho)
        ratio = variance / stated_sd**2
        worse = (deviance - least + free * (ratio - 1 - np.log(ratio))) / alike
        return float(scipy.special.chdtrc(2, max(worse, 0.0)))

    if rho > MOST_RHO or not _even((new**2).sum(axis=1), columns / alike):
        return None
    return Scatter(sd=sd, rho=rho, shared=shared, freedom=free / alike, chance=chance)


def with_own_noise(targets: Targets) -> Targets:
    """The targets with the noise that they show themselves, where that contradicts the one that is stated."""
    noise, out = targets.noise, targets
    if noise is None or any(n.frames < STATED for n in targets.noises or (noise,)):
        return targets
    if not targets.noises:
        return _scaled(targets, own_scatter(targets), noise, np.ones(len(targets.time), bool))
    for b in range(len(targets.noises)):
        of_block = targets.block == b
        alone = replace(targets, held_out=~of_block)
        out = _scaled(out, own_scatter(alone), targets.noises[b], of_block)
    return replace(out, noise=least_known(out.noises))


def _scaled(t: Targets, found: Scatter | None, stated: Noise, steps: NDArray[np.bool_]) -> Targets:
    """The targets with the noise that was found in these steps (s,), in place of a stated one, if that is
    unlikely: its sds all by one factor, and with them the errors of the reference."""
    sd, rho = float(np.nanmean(stated.sd)), float(np.nanmean(stated.rho))
    if found is None or found.chance(sd, rho) > UNLIKELY:
        return t
    if found.sd < SMOOTHED * sd:
        few = f"From step to step the film scatters by {found.sd:.1g} mm only, as smoothed values do."
        return _with_noise(t, stated, replace(stated, basis=f"{stated.basis} {few}"))
    factor, seen = found.sd / sd, np.isfinite(stated.sd)
    axis = np.where(seen, np.arange(3), np.nan).ravel()
    correlation = found.shared * np.equal.outer(axis, axis)
    np.fill_diagonal(correlation, 1.0)
    new = replace(
        stated, sd=factor * stated.sd, rho=np.where(seen, found.rho, np.nan), freedom=found.freedom,
        correlation=correlation,
        basis=(
            f"The noise is stated as an sd of {sd:.3g} mm{correlated(rho)}. From step to step the film "
            f"scatters by {found.sd:.3g} mm, {factor:.2g} times as much{correlated(found.rho)}: that is used."
        ),
    )  # fmt: skip
    covariance, modes = t.covariance.copy(), t.modes.copy()
    covariance[steps] *= factor**2
    rest = int((t.rests[t.reference] == t.rests[steps][0]).sum())
    of_mean = np.sqrt(mean_variance(found.rho, rest) / mean_variance(rho, rest))
    of_reference = np.array([name.startswith("reference:") for name in t.mode_names], bool)
    modes[np.ix_(of_reference, steps)] *= factor * of_mean
    return _with_noise(replace(t, covariance=covariance, modes=modes), stated, new)


def _with_noise(t: Targets, old: Noise, new: Noise) -> Targets:
    return replace(t, noise=new, noises=tuple(new if n is old else n for n in t.noises))


@dataclass(frozen=True, kw_only=True)
class CodingScatter:
    """What a film shows of its coding errors' independent part: its variance over the stated one, its
    correlation rho from step to step, and the degrees of freedom of the first."""

    factor: float
    rho: float
    freedom: float

    @property
    def clear(self) -> bool:
        """Whether it is another than the stated one by more than its own error."""
        sd = np.sqrt(2 / self.freedom * (1 + self.rho) / (1 - self.rho))
        return bool(abs(np.log(self.factor)) > CLEAR * sd or self.rho > CLEAR / np.sqrt(self.freedom))


def with_own_coding(targets: Targets) -> tuple[Targets, str]:
    """The targets of a film with the independent coding errors that it shows itself, where these are clearly
    others than stated, and a sentence on them."""
    found = coding_scatter(targets)
    if found is None or not found.clear or targets.noise is None:
        return targets, ""
    finger, still = ~targets.fixed[:, None], targets.noise.sd**2
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)
    new = np.where(finger & (variance > still), still + found.factor * (variance - still), variance)
    ratio = np.sqrt(np.divide(new, variance, out=np.ones_like(new), where=variance > 0))
    noise = replace(
        targets.noise, coding_rho=found.rho, freedom=found.freedom,
        codec_sd=np.where(finger, np.sqrt(found.factor), 1.0) * targets.noise.codec_sd,
    )  # fmt: skip
    return replace(
        targets, noise=noise, covariance=targets.covariance * ratio[..., None] * ratio[..., None, :]
    ), (
        f"Compression errors scatter {np.sqrt(found.factor):.2g} times as much from step to step as the film "
        f"coded again says{correlated(found.rho)}: that is used."
    )


def coding_scatter(targets: Targets) -> CodingScatter | None:
    """The coding errors' independent part by second differences over LAGS, off the directions in which the
    points move with the pressure (Gasser, Sroka & Jennen-Steinmetz 1986, doi 10.1093/biomet/73.3.625); None
    where the film tells too little of it.

    Differences know no slow errors: those are the shared ones, which are stated apart.
    """
    data, noise = targets.used, targets.noise
    often = np.argwhere(data.mean(axis=0) >= OFTEN * data.any(axis=(1, 2)).mean())
    p, i = often.T
    steps = np.flatnonzero(data[:, p, i].all(axis=1))
    if noise is None or len(often) < 3 or len(steps) < SLOW:
        return None
    still = float((noise.sd[p, i] ** 2).sum())
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[steps][:, p, i]
    added = np.maximum(variance.sum(axis=1) - still, 0.0)
    left = _beside_pressure(targets, steps, targets.value[steps][:, p, i])
    time, share, squares, freedom = targets.time[steps], 1 - 2 / len(often), [], 0.0
    period = float(np.median(np.diff(time)))
    for lag in LAGS:
        here = np.arange(lag, len(steps) - lag)
        apart = np.stack([time[here] - time[here - lag], time[here + lag] - time[here]]) / (lag * period)
        here = here[(np.abs(apart - 1) < 0.01).all(axis=0)]
        decay = float(np.nanmean(noise.rho[p, i])) ** lag
        rest = still * share * (6 - noise.lasting * (8 * decay - 2 * decay**2))
        stated = share * (added[here - lag] + 4 * added[here] + added[here + lag])
        here, stated = here[stated > rest], stated[stated > rest]
        power = ((left[here - lag] - 2 * left[here] + left[here + lag]) ** 2).sum(axis=1) - rest
        near = power < FAR * np.median(power / stated) * stated if len(here) else np.zeros(0, bool)
        if len(near) < SLOW or near.mean() < 1 - MOST_FAR:
            return None
        squares.append(max(float(power[near].sum() / stated[near].sum()), 1e-4))
        # Neighbouring second differences of white noise are correlated by -2/3 and 1/6.
        freedom = freedom or int(near.sum()) * (len(often) - 2) / (1 + 2 * (4 / 9 + 1 / 36))
    rho = np.linspace(0.0, 0.9, 91)
    told = np.log([(3 - 4 * rho**lag + rho ** (2 * lag)) / 3 for lag in LAGS])
    size = np.log(squares)[:, None] - told
    best = int(size.var(axis=0).argmin())
    if freedom < LEAST:
        return None
    return CodingScatter(factor=float(np.exp(size[:, best].mean())), rho=float(rho[best]), freedom=freedom)


def _beside_pressure(targets: Targets, steps: NDArray[np.int64], value: Array) -> Array:
    """Values (s, m) mm of some steps less smooth courses, off their slope by the pressure and its change."""
    smooth, slopes = (x[steps] for x in smooth_courses(targets))
    fit = np.linalg.lstsq(smooth[:, : slopes.shape[1]], value, rcond=None)[0]
    left, slope = value - smooth[:, : slopes.shape[1]] @ fit, slopes @ fit
    x = targets.pressure[steps] / max(float(np.abs(targets.pressure).max()), 1e-12)
    powers = np.arange(POWERS + 1)
    bend = (powers * (powers - 1) * x[:, None] ** np.maximum(powers - 2, 0)) @ fit[: POWERS + 1]
    for k, both in enumerate(zip(slope, bend, strict=True)):
        along = np.linalg.qr(np.stack(both, axis=1))[0]
        left[k] -= along @ (along.T @ left[k])
    return np.asarray(left, float)


def smooth_courses(targets: Targets) -> tuple[Array, Array]:
    """Smooth courses (s, b), and slopes (s, f) of the first of them by the pressure over its largest: what
    a finger may do that creeps, lags and softens, in each recording its own."""
    t, top = targets, max(float(np.abs(targets.pressure).max()), 1e-12)
    x, nothing = t.pressure / top, np.zeros(len(t.time))
    since = np.interp(t.time, t.log_time, memory(t.log_time, t.log_pressure)) / top
    branch = branches(t.time, t.pressure, t.log_time, t.log_pressure)
    hold, rest = (branch == 2).astype(float), (branch == 0).astype(float)
    rows = [(x**k, k * x ** max(k - 1, 0)) for k in range(POWERS + 1)]
    rows += [(since, nothing), (since**2, nothing), (x * since, since), (x * hold, hold), (rest, nothing)]
    slow = []
    for b in np.unique(t.block):
        own, time = (t.block == b).astype(float), t.time[t.block == b]
        rows += [(own * x**k, own * k * x ** max(k - 1, 0)) for k in range(4)] if b else []
        u = 2 * (time - time[0]) / max(float(np.ptp(time)), 1e-12) - 1
        course = np.zeros((len(x), len(u) // SLOW))
        course[t.block == b] = np.polynomial.legendre.legvander(u, len(u) // SLOW)[:, 1:]
        slow += list(course.T)
    smooth, slopes = zip(*rows, strict=True)
    return np.array([*smooth, *slow]).T, np.array(slopes).T


def _orthonormal(smooth: Array) -> Array:
    """An orthonormal basis (s, q) of courses (s, b)."""
    size = np.linalg.norm(smooth, axis=0)
    left, sizes, _ = np.linalg.svd(smooth / np.where(size > 0, size, 1.0), full_matrices=False)
    return np.asarray(left[:, sizes > 1e-7 * sizes[0]], float)


def _new(values: Array, first: NDArray[np.bool_], rho: float) -> Array:
    """What is new (s, n) in each step of values (s, n), as large as they are: of an autoregression with rho,
    which begins anew at the flags (s,)."""
    out = values.copy()
    after = np.flatnonzero(~first)
    out[after] = (values[after] - rho * values[after - 1]) / np.sqrt(1 - rho**2)
    return out


def _likelihood(
    basis: Array, left: Array, first: NDArray[np.bool_], columns: float
) -> Callable[[float], tuple[float, float]]:
    """-2 ln of the restricted likelihood, but for a constant, and the variance in mm2, of a rho.

    left (s, m) mm: values about the courses basis (s, q). columns: how many of them are independent.
    """
    q, free = basis.shape[1], (len(basis) - basis.shape[1]) * columns
    z = np.column_stack([basis, left])
    begins, now, before = z[first], z[~first], z[np.flatnonzero(~first) - 1]
    start, same, earlier, cross = begins.T @ begins, now.T @ now, before.T @ before, now.T @ before

    def at(rho: float) -> tuple[float, float]:
        gram = start + (same + rho**2 * earlier - rho * (cross + cross.T)) / (1 - rho**2)
        root = np.linalg.cholesky(gram[:q, :q])
        explained = np.linalg.solve(root, gram[:q, q:])
        variance = float(np.trace(gram[q:, q:]) - (explained**2).sum()) / free
        volume = len(now) * np.log(1 - rho**2) + 2 * np.log(np.diag(root)).sum()
        return float(free * np.log(variance) + columns * volume), variance

    return at


def _even(power: Array, free: float) -> bool:
    """Whether the powers (s,) of the steps, each of `free` independent values, are those of one noise: their
    mean is near what their median tells of it (Wilson & Hilferty 1931, doi 10.1073/pnas.17.12.684)."""
    usual = float(np.median(power)) / (1 - 2 / (9 * free)) ** 3
    return float(power.mean()) < EVEN * usual


def _shared(power: Array, direction: Array, axis: NDArray[np.int64]) -> tuple[float, float]:
    """The sd in mm, and the correlation of two components of one axis, from the mean products (m, m) mm2 of
    what is left beside a direction (s, m), of unit length, in each step."""
    off = np.equal.outer(axis, axis) & ~np.eye(len(axis), dtype=bool)
    outer = np.einsum("si,sj->ij", direction, direction) / len(direction)
    across = direction @ off
    along = np.einsum("si,sj->ij", direction, across) / len(direction)
    within = np.einsum("s,si,sj->ij", (across * direction).sum(axis=1), direction, direction) / len(direction)
    parts = [np.eye(len(axis)) - outer, off - along - along.T + within]
    parts = parts[: 1 + bool(off.any())]
    inner = np.array([[float((a * b).sum()) for b in parts] for a in parts])
    sizes = np.linalg.solve(inner, [float((a * power).sum()) for a in parts])
    if len(sizes) == 1 or sizes[1] <= 0:
        return float(np.sqrt((parts[0] * power).sum() / inner[0, 0])), 0.0
    return float(np.sqrt(sizes[0])), float(min(sizes[1] / sizes[0], 0.95))
