"""What the swing of a film tells: of its damping, and by its frequency of the mass that moves."""

import numpy as np

from fe import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.vibration import modes
from twin.gravity import is_heavy
from twin.judging.judged import Judged

APART = 0.1  # of the frequency: rubber is stiffer at that rate (5 % of it on a real beam), and so is a mesh
COUNT = 6  # vibrations, of which the first up and down is meant
SURE = 3.0  # sds of the growth of the damping, and
MOSTLY = 2.0  # times the rest of it, from which a drag is told: second vibrations look like a smaller one


def swing_in_words(judged: Judged) -> str:
    """What the inertia of a judged model tells of damping and mass; "" for a model without."""
    return " ".join(filter(None, [damping_in_words(judged), beside_model(judged)]))


def damping_in_words(judged: Judged) -> str:
    """A sentence on how the damping goes with the amplitude; "" where no law with a drag was needed."""
    values = judged.values
    if "inertia.drag" not in values:
        return ""
    k = [parameter.name for parameter in judged.model.parameters].index("inertia.drag")
    if is_drag(values["inertia.damping"], values["inertia.drag"], float(judged.fit.sd[k])):
        return "Its damping grows with the amplitude, as a drag of what surrounds it does."
    return "Its damping is much the same at all amplitudes, as a loss of the material or of the clamp is."


def is_drag(damping: float, drag: float, sd: float) -> bool:
    """True if most of a damping is a drag: damping ratio at no amplitude, and its growth with an sd.

    >>> is_drag(0.014, 0.13, 0.02), is_drag(0.12, 0.12, 0.02), is_drag(0.02, 0.1, 0.05)
    (True, False, False)
    """
    return drag > SURE * sd and drag > MOSTLY * damping


def beside_model(judged: Judged) -> str:
    """A sentence on the frequency of a judged model with inertia, beside the one that its density gives; ""
    where it has none of either."""
    values = judged.values
    if "inertia.hz" not in values:
        return ""
    test = judged.model.put(values)
    if not isinstance(test.case, Case) or not is_heavy(test.case):
        return ""
    path, p = test.path, judged.model.test.path.pressure
    pressure = float(np.median(judged.model.test.path.at_output()))
    loaded = at_rest(test.case, HeldLoad(pressure, path.outside_at(path.output[:1])[0, :3]))
    if not loaded.converged:
        return ""
    found = modes(loaded, count=COUNT)
    up = np.flatnonzero(~found.sideways)
    model = float(found.frequency[int(up[0]) if up.size else 0])
    faster = 1 + values.get("inertia.faster", 0.0) * pressure / max(float(np.ptp(p)), 1e-12)
    k = [parameter.name for parameter in judged.model.parameters].index("inertia.hz")
    return in_words(faster * values["inertia.hz"], float(judged.fit.sd[k]), model, pressure)


def in_words(seen: float, sd: float, model: float, pressure: float) -> str:
    """A sentence on a frequency in Hz that a film shows, with its sd, beside that of the model under a
    pressure in MPa."""
    beside = f"With its density the model swings at {model:.3g} Hz under {1e3 * pressure:.3g} kPa"
    beside, off = f"{beside}, the finger at {seen:.3g} Hz", seen / model - 1
    if abs(off) < max(APART, 2 * sd / model):
        return f"{beside}: as its stiffness and density say, to {100 * APART:.0f} %."
    if off < 0:
        mass = f"it moves {(model / seen) ** 2:.2g} times the mass that the model has"
        why = f"{mass}, or its clamp gives way as it swings"
    else:
        why = "it is lighter than the model, stiffer at that rate than at rest, or its chamber is closed"
    return f"{beside}: {why}. The film cannot tell which: weigh it."
