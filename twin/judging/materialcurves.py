"""The rows that tests of the silicone itself add to a film's whitened residual."""

import numpy as np

from calibrate.fit import Jacobian, Residual
from fe import Material
from twin.effects.protocol import Order, Test, Theta, Unsolvable
from twin.model.prediction import STEP, Model
from twin.targets import Array, MaterialCurve, Targets

OF_MATERIAL = (Order.LAW, Order.MATERIAL)  # effects that a specimen has as the finger does


def silicone(model: Model, values: Theta) -> Material:
    """The material that a model gives its silicone at named values."""
    test: Test = model.test
    for effect in model.effects:
        if effect.order in OF_MATERIAL:
            test = effect.before(test, values)
    case = test.case
    return next(m for name, m in case.materials.items() if name not in case.kept)


def curve_residual(model: Model, targets: Targets, theta: Array) -> Array:
    """The whitened residual (n,) of all curves at theta (d,), measured less predicted. Raises Unsolvable
    where the law has no stress."""
    material = silicone(model, model.named(theta))
    return np.concatenate([whitened_misfit(curve, material) for curve in targets.curves])


def beside_film(
    residual: Residual, jacobian: Jacobian, information: Jacobian | None, *, model: Model, targets: Targets
) -> tuple[Residual, Jacobian, Jacobian | None]:
    """A film's residual, its derivatives and the rows of its information, with the rows of all curves
    below."""

    def longer(theta: Array) -> Array | None:
        film = residual(theta)
        try:
            return film if film is None else np.concatenate([film, curve_residual(model, targets, theta)])
        except Unsolvable:
            return None

    def below(rows: Jacobian) -> Jacobian:
        def all_rows(theta: Array) -> Array:
            film = rows(theta)
            try:
                return np.concatenate([film, curve_jacobian(model, targets, theta)])
            except Unsolvable:
                lost = sum(len(curve.stress) for curve in targets.curves)
                return np.concatenate([film, np.full((lost, len(theta)), np.nan)])

        return all_rows

    return longer, below(jacobian), information and below(information)


def whitened_misfit(curve: MaterialCurve, material: Material) -> Array:
    """The whitened residual (n,) of one curve. Raises Unsolvable where the material has no stress."""
    stress = curve.predicted(material)
    if not np.isfinite(stress).all():
        raise Unsolvable(f"the law has no stress at some strains of the material test {curve.name}")
    return curve.whiten(curve.stress - stress)


def curve_jacobian(model: Model, targets: Targets, theta: Array) -> Array:
    """Derivatives (n, d) of `curve_residual` by differences: it is in closed form, and smooth."""
    columns = []
    for k, p in enumerate(model.parameters):
        step = STEP * p.step * np.eye(len(theta))[k]
        ahead, behind = (curve_residual(model, targets, theta + s) for s in (step, -step))
        columns.append((ahead - behind) / (2 * STEP * p.step))
    return np.array(columns).T
