"""Least squares against certified values, at bounds, without full rank, with models that fail."""


import numpy as np
import pytest
from numpy.typing import NDArray

from calibrate import Parameter, least_squares
from tests.messages import saying

Array = NDArray[np.float64]


class Counted:
    """A model y(x, theta) against data as whitened residual and Jacobian by central differences."""

    def __init__(self, model, x, y, sd: float) -> None:
        self.model, self.x, self.y, self.sd = model, np.asarray(x, float), np.asarray(y, float), sd
        self.residuals = self.jacobians = 0

    def residual(self, theta: Array) -> Array | None:
        self.residuals += 1
        try:
            return (self.y - self.model(self.x, *theta)) / self.sd
        except FloatingPointError:
            return None

    def jacobian(self, theta: Array) -> Array:
        self.jacobians += 1
        steps = np.diag(1e-6 * np.maximum(np.abs(theta), 1e-4))
        ends = [(self.model(self.x, *(theta - h)), self.model(self.x, *(theta + h))) for h in steps]
        return np.stack([(a - b) / (2 * np.sum(h)) for (a, b), h in zip(ends, steps)], axis=1) / self.sd


# NIST Statistical Reference Datasets, nonlinear regression, certified values to 11 digits
# (www.itl.nist.gov/div898/strd/nls/nls_main.shtml). MGH09 and Thurber are of "higher difficulty".
NIST = {
    "Misra1a": {
        "model": lambda x, b1, b2: b1 * (1 - np.exp(-b2 * x)),
        "x": [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760],
        "y": [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.4, 75.47,
              81.78],
        "starts": [(500, 0.0001), (250, 0.0005)],
        "value": (2.3894212918e2, 5.5015643181e-4),
        "sd": (2.7070075241, 7.2668688436e-6),
        "rss": 1.2455138894e-1,
        "rsd": 1.0187876330e-1,
    },
    "MGH09": {
        "model": lambda x, b1, b2, b3, b4: b1 * (x**2 + x * b2) / (x**2 + x * b3 + b4),
        "x": [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
        "y": [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246],
        # Start 1 (25, 39, 41.5, 39) is left out: it runs along a valley to another, published, minimum.
        "starts": [(0.25, 0.39, 0.415, 0.39)],
        "value": (1.9280693458e-1, 1.9128232873e-1, 1.2305650693e-1, 1.3606233068e-1),
        "sd": (1.1435312227e-2, 1.9633220911e-1, 8.0842031232e-2, 9.0025542308e-2),
        "rss": 3.0750560385e-4,
        "rsd": 6.6279236551e-3,
    },
    "Thurber": {
        "model": lambda x, b1, b2, b3, b4, b5, b6, b7: (
            (b1 + x * (b2 + x * (b3 + x * b4))) / (1 + x * (b5 + x * (b6 + x * b7)))
        ),
        "x": [-3.067, -2.981, -2.921, -2.912, -2.840, -2.797, -2.702, -2.699, -2.633, -2.481, -2.363, -2.322,
              -1.501, -1.460, -1.274, -1.212, -1.100, -1.046, -0.915, -0.714, -0.566, -0.545, -0.400, -0.309,
              -0.109, -0.103, 0.010, 0.119, 0.377, 0.790, 0.963, 1.006, 1.115, 1.572, 1.841, 2.047, 2.200],
        "y": [80.574, 84.248, 87.264, 87.195, 89.076, 89.608, 89.868, 90.101, 92.405, 95.854, 100.696,
              101.060, 401.672, 390.724, 567.534, 635.316, 733.054, 759.087, 894.206, 990.785, 1090.109,
              1080.914, 1122.643, 1178.351, 1260.531, 1273.514, 1288.339, 1327.543, 1353.863, 1414.509,
              1425.208, 1421.384, 1442.962, 1464.350, 1468.705, 1447.894, 1457.628],
        "starts": [(1000, 1000, 400, 40, 0.7, 0.3, 0.03), (1300, 1500, 500, 75, 1, 0.4, 0.05)],
        "value": (1.2881396800e3, 1.4910792535e3, 5.8323836877e2, 7.5416644291e1, 9.6629502864e-1,
                  3.9797285797e-1, 4.9727297349e-2),
        "sd": (4.6647963344, 3.9571156086e1, 2.8698696102e1, 5.5675370270, 3.1333340687e-2, 1.4984928198e-2,
               6.5842344623e-3),
        "rss": 5.6427082397e3,
        "rsd": 1.3714600784e1,
    },
}


def wide(value: Array, sd: Array) -> list[Parameter]:
    """Bounds far away: 400 sds hold every published start."""
    return [Parameter(f"b{k}", v - 400 * s, v + 400 * s) for k, (v, s) in enumerate(zip(value, sd))]


STARTS = [(name, start) for name, p in NIST.items() for start in p["starts"]]


@pytest.mark.parametrize(("name", "start"), STARTS)
def test_nist_values_and_standard_errors(name: str, start: tuple[float, ...]) -> None:
    p = NIST[name]
    value, sd = np.array(p["value"]), np.array(p["sd"])
    problem = Counted(p["model"], p["x"], p["y"], p["rsd"])
    fit = least_squares(problem.residual, problem.jacobian, wide(value, sd), start=start, max_evaluations=60)
    assert fit.converged, fit.reason
    assert np.all(np.abs(fit.theta - value) < 0.01 * sd)  # the promise: within 0.01 sd of the optimum
    # sds change along 0.01 sd by the curvature of the model: below 1 % on these.
    assert fit.sd == pytest.approx(sd, rel=0.01)
    assert fit.chi2 == pytest.approx(p["rss"] / p["rsd"] ** 2, abs=1e-3)
    assert fit.degrees_of_freedom == len(p["x"]) - len(value)
    assert fit.evaluations == problem.residuals
    assert fit.at_bound == ()
    assert problem.jacobians <= problem.residuals


@pytest.mark.parametrize("name", list(NIST))
def test_nist_to_more_digits_where_the_noise_is_called_smaller(name: str) -> None:
    p = NIST[name]
    value, sd = np.array(p["value"]), np.array(p["sd"])
    problem = Counted(p["model"], p["x"], p["y"], p["rsd"] / 1000)  # 0.01 sd is now 1e-5 of the true sd
    start = p["starts"][-1]
    fit = least_squares(problem.residual, problem.jacobian, wide(value, sd), start=start, max_evaluations=90)
    assert fit.converged, fit.reason
    assert np.all(np.abs(fit.theta - value) < 2e-5 * sd)
    assert fit.sd * 1000 == pytest.approx(sd, rel=1e-4)


def test_longley_linear_and_collinear() -> None:
    # NIST StRD Longley (doi:10.1080/01621459.1967.10500896): six regressors with a condition of 5e9.
    table = np.array([
        [60323, 83.0, 234289, 2356, 1590, 107608, 1947], [61122, 88.5, 259426, 2325, 1456, 108632, 1948],
        [60171, 88.2, 258054, 3682, 1616, 109773, 1949], [61187, 89.5, 284599, 3351, 1650, 110929, 1950],
        [63221, 96.2, 328975, 2099, 3099, 112075, 1951], [63639, 98.1, 346999, 1932, 3594, 113270, 1952],
        [64989, 99.0, 365385, 1870, 3547, 115094, 1953], [63761, 100.0, 363112, 3578, 3350, 116219, 1954],
        [66019, 101.2, 397469, 2904, 3048, 117388, 1955], [67857, 104.6, 419180, 2822, 2857, 118734, 1956],
        [68169, 108.4, 442769, 2936, 2798, 120445, 1957], [66513, 110.8, 444546, 4681, 2637, 121950, 1958],
        [68655, 112.6, 482704, 3813, 2552, 123366, 1959], [69564, 114.2, 502601, 3931, 2514, 125368, 1960],
        [69331, 115.7, 518173, 4806, 2572, 127852, 1961], [70551, 116.9, 554894, 4007, 2827, 130081, 1962]])
    value = np.array([-3482258.63459582, 15.0618722713733, -0.0358191792925910, -2.02022980381683,
                      -1.03322686717359, -0.0511041056535807, 1829.15146461355])
    sd = np.array([890420.383607373, 84.9149257747669, 0.0334910077722432, 0.488399681651699,
                   0.214274163161675, 0.226073200069370, 455.478499142212])
    design = np.column_stack([np.ones(16), table[:, 1:]]) / 304.854073561965
    y = table[:, 0] / 304.854073561965
    fit = least_squares(lambda t: y - design @ t, lambda t: -design, wide(value, sd), start=value + 20 * sd)
    assert fit.converged, fit.reason
    assert np.all(np.abs(fit.theta - value) < 0.01 * sd)
    assert fit.sd == pytest.approx(sd, rel=1e-6)
    assert fit.chi2 == pytest.approx(9.0, abs=1e-3)  # 16 values - 7 parameters, whitened by the residual sd


def relaxation(x: Array, a: float, b: float, k: float) -> Array:
    return a + b * np.exp(-k * x)


def relaxing(sd: float = 0.01) -> tuple[Counted, tuple[Parameter, ...]]:
    x = np.linspace(0, 5, 60)
    y = relaxation(x, 1.0, 2.0, 0.7) + sd * np.random.default_rng(3).normal(size=60)
    parameters = (Parameter("a", -5, 5, "mm"), Parameter("b", -5, 5, "mm"), Parameter("k", 0.01, 5, "1/s"))
    return Counted(relaxation, x, y, sd), parameters


def test_the_jacobian_is_asked_for_once_a_step() -> None:
    problem, parameters = relaxing()
    fit = least_squares(problem.residual, problem.jacobian, parameters, start=(0.8, 1.5, 0.5))
    assert fit.converged
    assert np.all(np.abs(fit.theta - [1, 2, 0.7]) < 4 * fit.sd)
    # one at the start and one for every step that was taken: here all were
    assert problem.jacobians == problem.residuals <= 8
    assert fit.interval() == pytest.approx(fit.theta[:, None] + fit.sd[:, None] * [-1.96, 1.96], rel=1e-5)


def test_stated_errors_are_those_found() -> None:
    pulls = []
    for seed in range(200):
        problem, parameters = relaxing()
        noise = 0.01 * np.random.default_rng(seed).normal(size=60)
        problem.y = relaxation(problem.x, 1.0, 2.0, 0.7) + noise
        fit = least_squares(problem.residual, problem.jacobian, parameters, start=(1, 2, 0.7))
        pulls.append((fit.theta - [1, 2, 0.7]) / fit.sd)
    # sd of 200 pulls: 1 +- 0.05, four of them allowed; their mean 0 +- 0.07.
    assert np.std(pulls, axis=0) == pytest.approx(1.0, abs=0.2)
    assert np.abs(np.mean(pulls, axis=0)) == pytest.approx(0.0, abs=0.28)


def test_an_active_bound_is_kept_listed_and_has_no_gaussian_error() -> None:
    problem, _ = relaxing()
    parameters = (Parameter("a", -5, 5), Parameter("b", -5, 5), Parameter("k", 0.8, 5))
    fit = least_squares(problem.residual, problem.jacobian, parameters, start=(0.8, 1.5, 2.0))
    assert fit.converged, fit.reason
    assert fit.theta[2] == 0.8
    assert fit.at_bound == ("k",)
    assert np.isnan(fit.sd[2])
    assert np.all(np.isnan(fit.interval()[2]))
    assert np.all(fit.covariance[2] == 0)
    # The other two are linear given k: their values and errors from the normal equations.
    design = np.column_stack([np.ones(60), np.exp(-0.8 * problem.x)]) / problem.sd
    known = np.linalg.inv(design.T @ design)
    assert fit.theta[:2] == pytest.approx(known @ design.T @ (problem.y / problem.sd), abs=0.01 * fit.sd[0])
    assert np.all(fit.sd[:2] >= np.sqrt(np.diag(known)))
    assert fit.degrees_of_freedom == 58


@pytest.mark.parametrize("beyond", [0.3, 1.0, 2.5])
def test_what_ends_at_a_bound_widens_the_intervals_of_the_others(beyond: float) -> None:
    """The data allow it inside, too: against draws of the posterior that are cut off at the bound."""
    rng = np.random.default_rng(3)
    design = rng.standard_normal((40, 2)) @ np.array([[1.0, 0.9], [0.0, 0.3]])  # the two trade off
    inverse = np.linalg.inv(design.T @ design)
    best = np.array([1.0, -beyond * np.sqrt(inverse[1, 1])])  # so many sds below the bound at 0
    parameters = (Parameter("a", -9, 9), Parameter("b", 0, 9))
    fit = least_squares(lambda t: design @ (t - best), lambda t: design, parameters, start=(0.5, 0.5))
    assert fit.at_bound == ("b",)
    drawn = rng.multivariate_normal(best, inverse, size=400_000)
    drawn = drawn[drawn[:, 1] > 0]
    wanted = np.sqrt(np.mean((drawn[:, 0] - fit.theta[0]) ** 2))
    assert fit.sd[0] == pytest.approx(wanted, rel=0.05)  # of 2,500 draws at the least
    held = 1 / np.linalg.norm(design[:, 0])
    assert fit.sd[0] > held


def test_a_bound_is_left_again_where_the_misfit_falls_inward() -> None:
    problem, parameters = relaxing()
    fit = least_squares(problem.residual, problem.jacobian, parameters, start=(-5, 5, 0.01))
    assert fit.converged, fit.reason
    assert fit.at_bound == ()
    assert np.all(np.abs(fit.theta - [1, 2, 0.7]) < 4 * fit.sd)


def test_a_bound_close_by_is_reached_where_the_misfit_pulls_beyond_it() -> None:
    # Optimum 10 sd below the bound, start 0.005 sd above it: a short step that is worth 0.1 in chi2.
    parameters = [Parameter("p", 0, 10)]
    fit = least_squares(lambda t: t + 10, lambda t: np.ones((1, 1)), parameters, start=(0.005,))
    assert fit.converged
    assert fit.theta[0] == 0.0
    assert fit.at_bound == ("p",)


def test_every_residual_is_asked_within_the_bounds() -> None:
    problem, parameters = relaxing()
    low, high = np.array([-5, -5, 0.01]), np.array([5, 5, 5])

    def residual(theta: Array) -> Array | None:
        assert np.all((low <= theta) & (theta <= high))
        return problem.residual(theta)

    least_squares(residual, problem.jacobian, parameters, start=[(-5, -5, 5), (5, 5, 5), (5, -5, 0.01)])


def test_what_the_data_cannot_tell_is_said() -> None:
    x = np.linspace(0, 1, 30)
    y = 30 * x + np.random.default_rng(1).normal(size=30)
    design = np.column_stack([x, x, np.ones(30)]) / 0.1  # only p + q is seen
    parameters = [Parameter("p", -10, 10), Parameter("q", -10, 10), Parameter("c", -10, 10)]
    fit = least_squares(lambda t: y - design @ t, lambda t: -design, parameters, start=(0, 1, 0))
    assert fit.converged, fit.reason
    assert "the data leave 1 combination of p, q undetermined" in fit.reason
    assert np.all(np.isinf(fit.sd[:2]))
    assert fit.theta[0] + fit.theta[1] == pytest.approx(3.0, abs=0.3)
    line = np.column_stack([x, np.ones(30)]) / 0.1
    assert fit.sd[2] == pytest.approx(np.sqrt(np.linalg.inv(line.T @ line)[1, 1]), rel=1e-6)
    assert fit.degrees_of_freedom == 28
    assert fit.interval()[0] == pytest.approx([-10, 10])


def test_a_parameter_that_does_nothing_is_undetermined() -> None:
    parameters = [Parameter("p", -10, 10), Parameter("idle", 0, 1)]
    jacobian = np.column_stack([-np.ones(5), np.zeros(5)])
    fit = least_squares(lambda t: np.ones(5) - t[0], lambda t: jacobian, parameters, start=(3, 0.5))
    assert fit.converged
    assert fit.theta == pytest.approx([1, 0.5], abs=0.01 * fit.sd[0])
    assert fit.sd == pytest.approx([1 / np.sqrt(5), np.inf])


def test_nearly_collinear_columns_are_no_obstacle() -> None:
    x = np.linspace(0, 1, 50)
    design = np.column_stack([np.ones(50), 1 + 1e-4 * x]) / 1e-6
    truth = np.array([0.2, 0.1])
    parameters = [Parameter("p", 0, 0.5), Parameter("q", 0, 0.5)]
    fit = least_squares(lambda t: design @ (truth - t), lambda t: -design, parameters, start=(0.4, 0.4))
    assert fit.converged, fit.reason
    assert np.all(np.abs(fit.theta - truth) <= 0.02 * fit.sd)
    assert fit.sd == pytest.approx(np.sqrt(np.diag(np.linalg.inv(design.T @ design))), rel=1e-4)
    assert fit.correlation[0, 1] < -0.999


def test_a_model_that_cannot_be_solved_shortens_the_step() -> None:
    problem, parameters = relaxing()
    refused = []

    def residual(theta: Array) -> Array | None:
        if theta[2] > 0.9 or theta[0] > 1.5:
            refused.append(theta)
            return None if len(refused) % 2 else np.full(60, np.nan)
        return problem.residual(theta)

    fit = least_squares(residual, problem.jacobian, parameters, start=(1.4, -1.0, 0.05))
    assert refused
    assert fit.converged, fit.reason
    assert np.all(np.abs(fit.theta - [1, 2, 0.7]) < 4 * fit.sd)


@pytest.mark.parametrize("failure", [None, np.full(60, np.nan)])
def test_a_start_that_cannot_be_solved_is_a_fit_with_its_reason(failure: Array | None) -> None:
    problem, parameters = relaxing()
    fit = least_squares(lambda t: failure, problem.jacobian, parameters, start=(1, 1, 1))
    assert not fit.converged
    assert fit.chi2 == np.inf
    assert "cannot be solved at the start" in fit.reason
    assert np.all(np.isinf(fit.sd))

    def half(theta: Array) -> Array | None:
        return None if theta[0] < 0 else problem.residual(theta)

    assert least_squares(half, problem.jacobian, parameters, start=[(-1, 1, 1), (1, 1, 1)]).converged


def test_several_starts_find_the_deeper_of_two_minima() -> None:
    x = np.linspace(0, 10, 80)
    problem = Counted(lambda x, w: np.sin(w * x), x, np.sin(1.3 * x), 0.05)
    parameters = [Parameter("w", 0.1, 4)]
    alone = least_squares(problem.residual, problem.jacobian, parameters, start=(3.5,))
    assert abs(alone.theta[0] - 1.3) > 0.1
    fit = least_squares(problem.residual, problem.jacobian, parameters, start=[[3.5], [2.5], [1.2]], seed=11)
    assert fit.theta[0] == pytest.approx(1.3, abs=0.01 * fit.sd[0])
    assert fit.seed == 11


def test_the_budget_is_kept() -> None:
    problem, parameters = relaxing()
    fit = least_squares(problem.residual, problem.jacobian, parameters, start=(-4, -4, 4), max_evaluations=3)
    assert not fit.converged
    assert problem.residuals == 3
    assert "used up" in fit.reason
    assert np.all(np.isfinite(fit.sd) | np.isnan(fit.sd))


def test_a_rough_misfit_ends_at_its_floor_without_using_up_the_budget() -> None:
    problem, parameters = relaxing()

    def rough(theta: Array) -> Array | None:
        # A solver's own error: 1e-4 of the noise, another one at every theta.
        seed = np.abs(theta * 1e9).astype(np.uint64)
        return problem.residual(theta) + 1e-4 * np.random.default_rng(seed).normal(size=60)

    fit = least_squares(rough, problem.jacobian, parameters, start=(0.5, 1.0, 0.3))
    assert fit.converged, fit.reason
    assert problem.residuals < 25


def test_a_large_misfit_ends_where_the_derivatives_can_promise_no_more() -> None:
    rng, solves = np.random.default_rng(3), []
    rows, missed = rng.normal(size=(2000, 2)), 10 * rng.normal(size=2000)

    def residual(theta: Array) -> Array:
        solves.append(theta)
        return missed + rows @ theta

    wrong = rows + 1e-5 * missed[:, None]  # so that they promise a fall where there is none

    fit = least_squares(
        residual, lambda _: wrong, [Parameter("a", -9, 9), Parameter("b", -9, 9)], start=(1.0, 1.0)
    )
    assert fit.converged, fit.reason
    assert len(solves) < 8


@pytest.mark.parametrize(
    ("start", "sentence"),
    [((0, 0, 9), "k = 9.0 1/s is outside its bounds 0.01 .. 5"), ((0, 0), "wanted 3 values in each row")],
)
def test_bad_starts_are_refused(start: tuple, sentence: str) -> None:
    problem, parameters = relaxing()
    with pytest.raises(ValueError, match=sentence):
        least_squares(problem.residual, problem.jacobian, parameters, start=start)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match=saying("C10", "0.5", "0.1 MPa")):
        Parameter("C10", 0.5, 0.1, "MPa")
    with pytest.raises(ValueError, match="start 2 MPa is outside its bounds"):
        Parameter("C10", 0.0, 1.0, "MPa", start=2)
    with pytest.raises(ValueError, match="each with a name of its own"):
        least_squares(lambda t: t, lambda t: t, [Parameter("p", 0, 1)] * 2, start=(0, 0))
