"""Plausibility of pressures and displacements of a soft finger, for a raw log and for targets.

Each function returns a sentence that names a fault and its likely cause, or "".
"""

import os
from typing import TYPE_CHECKING

import numpy as np

from twin.fitmemory import MOST_BYTES, bytes_of
from twin.laws.law import STRETCH, Constants
from twin.laws.mooneyrivlin import LEAST_SHARE, MOONEY_RIVLIN
from twin.targets import Array, PointKind, Targets

if TYPE_CHECKING:
    from fe import Case

LEAST_MPA, MOST_MPA = 1e-4, 1.0  # the peak of a test of a soft finger lies far within
UNITS = {"kPa": 1e-3, "bar": 0.1, "mbar": 1e-4, "psi": 0.00689476, "Pa": 1e-6}  # MPa each
AIR_MPA = (0.08, 0.105)  # of the air, up to 2000 m above the sea
TURNED = 5.0  # times as much below zero as above it
USUAL_MPA = (0.005, 0.3)
REACHED = 1.5  # times what the regulator was set to, or as much below; two units are 6.9 times apart or more
SILICONE_MPA = (0.02, 2.0)  # half of the shear modulus of silicones that fingers are cast of
NEAR = 0.02  # of the least share: where a fit is stopped by it
CURLED = 2.0  # largest displacement over the finger's length: a tip that is rolled up moves by 1.3 of it
RESTING = 2e-3  # displacement over length that any pressure of 40 kPa exceeds; in proportion below that
FULL_MPA = 0.04
BENT = 0.02  # displacement over length from which its sign counts
FAR = 0.2  # displacement over length from which a bent finger is drawn back
FORTH = 0.25  # of u3^2 / length: more than any finger lengthens beside that
APART, FASTER = 0.15, 1.5  # share of the length between two points; times more may the nearer one move
LONG_H, MANY = 3.0, 50  # h and steps of a test whose times are likely in ms
NODE_BYTES = 33e3  # of a solve, for each node (docs/records/engines.md)
ON_PLANE_MM = 1e-6
OFF_NODE_MM = 3.0  # a marker from its node: room for its thickness and for a rough reading


def pressure_fault(peak: float, *, unit: str = "MPa") -> str:
    """Fault of a largest pressure in MPa that was read in a unit.

    >>> pressure_fault(0.03)
    ''
    >>> pressure_fault(30.0)[-53:]
    'Pa (30 kPa are 0.03 MPa) or psi (30 psi are 0.21 MPa)'
    """
    if LEAST_MPA <= peak <= MOST_MPA or (unit == "MPa" and peak < LEAST_MPA):
        return ""  # a resting gauge says nothing of its unit
    text = (f"reaches {peak:.3g} MPa, read in {unit}; wanted {LEAST_MPA:g} to {MOST_MPA:g} MPa, as soft "
            "fingers have")  # fmt: skip
    low, high = USUAL_MPA
    likely = [name for name, factor in UNITS.items() if low <= factor * peak <= high] if unit == "MPa" else []
    if not likely:
        return text
    candidates = " or ".join(
        f"{name} ({peak:.3g} {name} are {UNITS[name] * peak:.2g} MPa)" for name in likely
    )
    return f"{text}; the numbers are likely in {candidates}"


def top_fault(peak: float, *, unit: str, top_kPa: float) -> str:
    """Fault of a largest pressure in MPa that was read in a unit, where the regulator was set to `top_kPa`.

    >>> top_fault(0.03, unit="kPa", top_kPa=30)
    ''
    >>> top_fault(0.003, unit="mbar", top_kPa=30)[-36:]
    '5 kPa; the numbers are likely in kPa'
    """
    times = 1e3 * peak / top_kPa
    if 1 / REACHED <= times <= REACHED:
        return ""
    text = (
        f"reaches {1e3 * peak:.3g} kPa, read in {unit}, but the regulator was set to {top_kPa:g} kPa "
        f"(top_kPa); wanted {top_kPa / REACHED:.3g} to {top_kPa * REACHED:.3g} kPa"
    )
    factors = UNITS | {"MPa": 1.0, "hPa": UNITS["mbar"]}
    if unit not in factors:
        return f"{text}; is the gauge's calibration line right (volt_zero, MPa_per_V), or top_kPa wrong?"
    each = {name: times * factor / factors[unit] for name, factor in (UNITS | {"MPa": 1.0}).items()}
    likely = [name for name, as_read in each.items() if 1 / REACHED <= as_read <= REACHED]
    if not likely:
        return f"{text}; no unit explains it: is top_kPa right, in kPa?"
    return f"{text}; the numbers are likely in {likely[0]}"


def silicone_doubt(constants: Constants, *, end: int) -> str:
    """A sentence where the scale of constants is no silicone's.

    end: 1 where all constants end at their highest allowed values, -1 at their lowest, else 0.
    """
    (low, high), total = SILICONE_MPA, constants.scale
    if low <= total <= high and not end:
        return ""
    what = "the constants end at their bounds" if end else f"silicones have {low:g} to {high:g} MPa"
    soft = end < 0 or (not end and total < low)
    wrong = "low, as kPa read as mbar, or psi as kPa" if soft else "high, as mbar read as kPa, or kPa as psi"
    return (
        f"{constants.law.stiffness} is {total:.3g} MPa: {what}. Is the pressure read too {wrong}? Write what "
        "the regulator was set to as top_kPa under [pressure]: `twin check` compares it with the log."
    )


def stability_doubt(constants: Constants, *, sd: float = 0.0, stretch: float = STRETCH) -> str:
    """A sentence where the C01 of Mooney-Rivlin rubber looks like another effect, else "".

    That is where it is below zero by two of its sd, or the least at which the rubber is stable, or less than
    that at the stretch that the model reaches.
    """
    if constants.law != MOONEY_RIVLIN or (share := constants.shape[0]) > -NEAR:
        return ""
    if stretch > STRETCH and constants.material.steadiness(stretch) < 0.0:
        return (
            f"C01/(C10 + C01) is {share:.2f}: at the stretch of {stretch:.2g} that the model reaches such a "
            "rubber is not stable. What looks like it is a wrong wall, missing fibres, or another effect: "
            "`twin diagnose` looks for it."
        )
    if share > LEAST_SHARE + NEAR:
        return "" if share * constants.scale > -2 * sd else (
            f"C01/(C10 + C01) is {share:.2f}, below zero. Such a rubber stiffens in tension, as a wrong wall "
            "or missing fibres make it seem, too: a tensile test of the silicone tells ([[material_tests]])."
        )
    return (
        f"C01/(C10 + C01) is {share:.2f}, and with less the rubber would not be stable: the silicone has "
        "another law than Mooney-Rivlin, or another effect is missing. `twin diagnose` looks for it."
    )


def zero_fault(pressure: Array) -> str:
    """Fault of the pressures (t,) MPa of a whole test: absolute pressure, or a wrong sign.

    >>> zero_fault(np.array([0.1013, 0.12, 0.13])).partition(":")[0]
    'never falls below 0.1013 MPa, which is the pressure of the air'
    """
    low, high = float(pressure.min()), float(pressure.max())
    if AIR_MPA[0] <= low <= AIR_MPA[1]:
        return (
            f"never falls below {low:.4g} MPa, which is the pressure of the air: it seems to be absolute "
            "pressure; wanted gauge pressure, which is 0 when the finger is vented; subtract the "
            "reading at rest"
        )
    if low < -LEAST_MPA and -low > TURNED * high:
        missing, readings = pressure == low, pressure[pressure != low]
        if readings.size > missing.sum() and readings.min() > low / TURNED and readings.max() >= LEAST_MPA:
            return (
                f"is exactly {low:.4g} MPa in {missing.sum()} of {pressure.size} rows, and "
                f"{readings.min():.2g} to {readings.max():.2g} MPa in all others: such a value usually "
                "stands for 'no reading'; remove these rows"
            )
        return (
            f"falls to {low:.3g} MPa and rises to {high:.2g} MPa only; wanted gauge pressure, above 0 when "
            "the finger is inflated; turn its sign (MPa_per_V of a gauge that gives volts)"
        )
    return ""


def motion_fault(targets: Targets, case: "Case", *, bends_down: bool) -> str:
    """Fault of measured displacements for the finger of a case: their size, or their sign where the finger
    bends to -z."""
    u = np.where(targets.valid, targets.value, np.nan)[:, ~targets.fixed]
    if not np.isfinite(u).any():
        return "no displacement of a point on the finger is valid; wanted some with valid 1 in targets.csv"
    length, pressure = float(np.ptp(case.nodes, axis=0).max()), float(np.abs(targets.pressure).max())
    most = float(np.nanmax(np.abs(u)))
    where = f"the largest displacement is {most:.3g} mm, and the finger is {length:.3g} mm long"
    if most > CURLED * length:
        return f"{where}: wanted displacements in mm; are they in micrometres, or in px?"
    if pressure >= LEAST_MPA and most < RESTING * min(pressure / FULL_MPA, 1.0) * length:
        return (f"{where}, while the pressure rises to {pressure:.3g} MPa: it seems to be at rest; wanted "
                "displacements in mm; are they in m, or of another film?")  # fmt: skip
    if fault := _vague(targets, most):
        return fault
    return (_sign(targets, BENT * length) or _drawn(targets, length)) if bends_down else ""


def doubts(targets: Targets, case: "Case") -> tuple[str, ...]:
    """Doubts about targets, one sentence each: points that may be exchanged, times in another unit, loads on
    a body without weight, more errors than the memory holds, a mesh that it does not hold."""
    found = _overtaken(targets, case), _late(targets), _weightless(targets, case), _too_many(targets)
    return tuple(filter(None, (*found, _too_fine(case))))


def _too_many(targets: Targets) -> str:
    """Doubt about targets whose shared errors a fit cannot hold in the memory of this computer."""
    values, errors, most = int(targets.valid.sum()), len(targets.modes), memory_of_computer()
    wanted = bytes_of(values, int(targets.valid.any(axis=0).sum()), errors)
    if wanted < most:
        return ""
    return (
        f"A fit of these targets holds {errors} errors that many of their {values} values share: some "
        f"{wanted / 1e9:.0f} GB, where this computer has {most / 1e9:.0f} GB. State fewer `steps` under "
        "[measure] of twin.toml, or leave them out, which keeps as many as a fit holds in "
        f"{MOST_BYTES / 1e9:.0f} GB, and measure again."
    )


def _too_fine(case: "Case") -> str:
    """Doubt about a mesh whose solve this computer cannot hold."""
    nodes, most = len(case.nodes), memory_of_computer()
    if NODE_BYTES * nodes < most:
        return ""
    return (
        f"A solve of the {nodes} nodes of this mesh takes some {NODE_BYTES * nodes / 1e9:.0f} GB, where this "
        f"computer has {most / 1e9:.0f} GB. State a smaller `mesh` under "
        "[model] of twin.toml, or a coarser deck."
    )


def memory_of_computer() -> float:
    """Memory of this computer in bytes; infinite where the system does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):  # Windows has no such call
        return float("inf")


def _weightless(targets: Targets, case: "Case") -> str:
    """Doubt about a body that something hangs on, and that has no weight itself."""
    if not targets.loads or any(m.density for m in case.materials.values()):
        return ""
    return (
        f"The targets hang loads on the body (at {targets.loads[0].at}), but the model has no density: its "
        "own weight, which acts with them, is left out. Weigh the silicone and state density_kg_m3 and "
        "gravity under [model] of twin.toml."
    )


def _late(targets: Targets) -> str:
    """Doubt about the unit of time: a test of many steps lasts for hours."""
    hours = float(np.ptp(targets.time)) / 3600
    if hours < LONG_H or len(targets.time) < MANY:
        return ""
    step = float(np.median(np.diff(targets.time)))
    return f"The steps of the targets are {step:.3g} s apart, {hours:.3g} hours in all: is time_s in ms?"


def rise_fault(targets: Targets) -> str:
    """Fault of targets without a pressure to calibrate with."""
    most = float(np.abs(targets.pressure).max())
    if most >= LEAST_MPA:
        return ""
    return f"the pressure does not rise: it is {most:.3g} MPa at most; wanted the pressures of a test, in MPa"


def _sign(targets: Targets, least: float) -> str:
    """Fault where the point that moves most along z at top pressure moves up, by `least` mm or more."""
    top = targets.pressure >= 0.99 * targets.pressure.max()
    z = np.where(targets.valid[..., 2] & ~targets.fixed, targets.value[..., 2], np.nan)[top]
    if not np.isfinite(z).any():
        return ""
    step, point = np.unravel_index(int(np.nanargmax(np.abs(z))), z.shape)
    if z[step, point] < least:
        return ""
    return (
        f"U3 of {targets.names[int(point)]} is +{z[step, point]:.3g} mm at top pressure, but a pressurised "
        "finger bends to -z: wanted z up and U3 negative there; turn the sign, or the axes"
    )


def _vague(targets: Targets, most: float) -> str:
    """Fault of sds that are larger than every displacement."""
    measured = targets.valid & ~targets.fixed[:, None]
    if not measured.any():
        return ""
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[measured]
    sd = float(np.sqrt(np.median(variance)))
    if sd <= most:
        return ""
    return (
        f"their standard deviation is {sd:.3g} mm (median), and the largest displacement {most:.3g} mm: they "
        "say nothing of the finger; wanted sds in mm, smaller than what they are of"
    )


def _drawn(targets: Targets, length: float) -> str:
    """Fault where a point that bends far down leaves the clamp: an arc draws it back by u3^2 / 1.5 L."""
    value = np.where(targets.valid & ~targets.fixed[:, None], targets.value, np.nan)
    x, z = value[..., 0], value[..., 2]
    off = np.where(z < -FAR * length, x - FORTH * z**2 / length, -np.inf)
    off = np.where(np.isfinite(x), off, -np.inf)
    if not off.size or off.max() <= 0.0:
        return ""
    step, point = np.unravel_index(int(off.argmax()), off.shape)
    return (
        f"U1 of {targets.names[int(point)]} is +{x[step, point]:.3g} mm where its U3 is {z[step, point]:.3g} "
        "mm, but a finger that bends is drawn back towards the clamp; wanted x from the clamp to the tip, "
        "and U1 negative there; turn the sign of U1"
    )


def _overtaken(targets: Targets, case: "Case") -> str:
    """Doubt about a point that moves much more than another one farther from the clamp."""
    placed = [p for p, point in enumerate(targets.points) if point.kind in (PointKind.NODE, PointKind.PLACE)]
    top, length = int(np.argmax(targets.pressure)), float(np.ptp(case.nodes[:, 0]))
    shared = targets.valid[top][placed].all(axis=0)
    if len(placed) < 2 or not shared.any():
        return ""
    x = np.array([targets.points[p].place(case.position)[0] for p in placed])
    moved = np.linalg.norm(targets.value[top][placed][:, shared], axis=1)
    apart = (x[None] - x[:, None] > APART * length) & (moved[:, None] > BENT * length)
    ratio = np.where(apart, moved[:, None] / np.maximum(moved[None], 1e-9), 0.0)
    a, b = np.unravel_index(int(ratio.argmax()), ratio.shape)
    if ratio[a, b] < FASTER:
        return ""
    near, far = targets.names[placed[int(a)]], targets.names[placed[int(b)]]
    return (
        f"Point {near} at x = {x[a]:.4g} mm moves by {moved[a]:.3g} mm at top pressure, and {far} at x = "
        f"{x[b]:.4g} mm by {moved[b]:.3g} mm, though it lies farther from the clamp. Does something hold the "
        "finger there, or are their nodes or names exchanged?"
    )


def on_model_side(position: Array, case: "Case", *, mirrored: bool) -> Array:
    """A stated position (3,) mm, or with `mirrored` its mirror image, where a half model has only that."""
    half = float(case.nodes[:, 1].min()) >= -ON_PLANE_MM
    return position * (1.0, -1.0, 1.0) if mirrored and half and position[1] < 0.0 else position


def place_fault(targets: Targets, case: "Case", *, mirrored: bool = False) -> str:
    """Fault of a point whose stated position is too far from its node.

    mirrored: whether a point on the side y < 0 of half a finger stands for its mirror image.
    """
    for point in targets.points:
        if point.kind is not PointKind.NODE or point.position is None or point.node is None:
            continue
        node = case.position(point.node)
        position = on_model_side(np.array(point.position), case, mirrored=mirrored)
        away = float(np.linalg.norm(position - node))
        if away > OFF_NODE_MM:
            return (
                f"point {point.name!r} is stated at {_shown(point.position)} mm, but its node {point.node} "
                f"lies at {_shown(node)} mm, {away:.1f} mm away; wanted at most {OFF_NODE_MM:g} mm; "
                "correct one of them"
            )
    return ""


EXPLAINED = 0.5  # share of the motion's mean square that any model of the finger explains


def fit_fault(targets: Targets, residual: Array) -> str:
    """Fault where the best constants of the model leave residuals (s, p, 3) mm as large as the motion."""
    moved, misfit = targets.rms(targets.value), targets.rms(residual)
    if misfit**2 <= (1 - EXPLAINED) * moved**2:
        return ""
    s, p, i = np.unravel_index(int(np.where(targets.used, np.abs(residual), 0.0).argmax()), residual.shape)
    measured, model = targets.value[s, p, i], targets.value[s, p, i] - residual[s, p, i]
    return (
        f"the best constants leave {misfit:.3g} mm rms of a motion of {moved:.3g} mm rms: these are not the "
        f"displacements of this finger. Most at {targets.names[int(p)]}: U{i + 1} is {measured:.3g} mm, the "
        f"model's {model:.3g} mm at {targets.pressure[s]:.3g} MPa. Check signs and units of the "
        "displacements, the "
        "unit of the pressure, and which node each point is at"
    )


def _shown(x: Array | tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in x) + ")"
