"""A spring relaxes: three constants of a law are fitted to measured forces. With `calibrate` alone.

Any residual function will do. Divide it by the sd of the measurement: chi2 then tells whether the law fits.
"""

import numpy as np

from calibrate import Parameter, chi2_test, least_squares

time = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])  # s
force = np.array([5.02, 4.41, 3.97, 3.38, 2.92, 2.76, 2.75])  # N, measured
SD = 0.03  # N, of one value

parameters = (
    Parameter("rest", 0.0, 10.0, "N"),  # name, lower and upper bound, unit
    Parameter("fall", 0.0, 10.0, "N"),
    Parameter("tau", 0.1, 100.0, "s"),
)


def law(theta):
    return theta[0] + theta[1] * np.exp(-time / theta[2])


def residual(theta):
    return (force - law(theta)) / SD


def jacobian(theta):  # derivatives of the residual, (values, parameters)
    _, fall, tau = theta
    decay = np.exp(-time / tau)
    return -np.stack([np.ones_like(time), decay, fall * decay * time / tau**2], axis=1) / SD


fit = least_squares(residual, jacobian, parameters, start=[1.0, 1.0, 1.0], tolerance=1e-4)
for p, value, (low, high) in zip(fit.parameters, fit.theta, fit.interval(0.95)):
    print(f"{p.name} = {value:.3f} {p.unit} (95 %: {low:.3f} to {high:.3f})")
p_value = chi2_test(fit.chi2, [fit.degrees_of_freedom], [np.inf])  # inf: the sd is known, not estimated
said = "the law fits" if p_value > 0.01 else "the law does not fit"
print(f"chi2 {fit.chi2:.2f} for {fit.degrees_of_freedom} degrees of freedom, p {p_value:.2f}: {said}")
