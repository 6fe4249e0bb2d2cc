"""Hidden kinds that are written after the rule was frozen, by someone who has not read it.

Each is a `twin.virtual.hidden.Kind` of a name that `KINDS` has not: another law of an effect of the library
(`law="other"`, `physics` its name) or none of it (`law="unknown"`). A kind of `part` `path` or `picture`
needs nothing else; one of `static` or `history` is solved first, by
`python benchmarks/diagnosis/snapshots.py --later --pack`. They are the group `later` of `identify.py`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fe.case import Layer
from fe.mesh.inner import inside
from fe.mesh.points import nearest
from twin.effects.protocol import Test
from twin.effects.supports import flat_bottom
from twin.targets import Array
from twin.virtual.hidden import Change, Kind, Seen, known

# -- other laws of the same physics -------------------------------------------------------------------------


def stretched_creep(test: Test, size: float) -> Test:
    """Relaxation of the share `size` by exp(-sqrt(t / 6 s)), whose spectrum of times is known in closed form:
    sqrt(x) exp(-x / 4) over log x, with x = tau / 6 s."""
    tau = np.logspace(-1, 2, 7)
    weight = np.sqrt(tau / 6.0) * np.exp(-tau / 24.0)
    series = tuple((float(size * g), float(t)) for g, t in zip(weight / weight.sum(), tau, strict=True))
    return replace(test, case=test.case.with_material(prony=series))


def pressed_softening(test: Test, size: float) -> Test:
    """A finger that is softer as a whole below its largest pressure so far: by up to `size`, exponentially in
    the distance to it."""
    path = test.path
    top = max(float(path.pressure.max()), 1e-12)
    below = (np.maximum.accumulate(path.pressure) - path.pressure) / top
    factor = 1 - size * -np.expm1(-below / 0.4)
    return replace(test, path=replace(path, stiffness=factor))


def sagging_core(test: Test, size: float) -> Test:
    """A core that is held at both ends and lies higher by `size` mm in the middle: it sagged, or was bent."""
    inner = inside(test.case)
    x = inner.position[:, 0]
    share = (x - x.min()) / np.ptp(x)
    moved = np.zeros((len(inner.rows), 3))
    moved[:, 2] = 4 * size * share * (1 - share)
    return replace(test, case=replace(test.case, nodes=test.case.nodes + inner.spread(moved)))


def sloped_layer(test: Test, size: float) -> Test:
    """A sheet in the bottom of `size` N/mm on average, whose thickness grows evenly from almost nothing at
    the base."""
    case, name, parts = test.case, "sloped_layer", 10
    stiffness = tuple(float(size * s) for s in (2 * np.arange(parts) + 1) / parts)
    surfaces = {**case.surfaces, name: flat_bottom(case)}
    return replace(test, case=replace(case, surfaces=surfaces, layer=Layer(name, stiffness)))


def bottoming(x: Array) -> Array:
    """The secant compliance, over that at rest, of a clamp that saturates as a gasket is pressed flat,
    at shares x (s,) of the top pressure."""
    held = np.maximum(np.abs(x), 1e-6) / 0.4
    return np.asarray(np.tanh(held) / held, float)


def slow_vent(test: Test, size: float) -> Test:
    """A valve that vents with a lag of `size` s, and fills with a fifth of it."""
    path = test.path
    p, wanted, time = path.pressure.copy(), path.pressure, path.time
    for n in range(1, len(p)):
        dt = time[n] - time[n - 1]
        tau = max(size * (1.0 if wanted[n] < p[n - 1] else 0.2), 1e-6)
        behind = tau * (wanted[n] - wanted[n - 1]) / dt  # where the line ends up behind a steady ramp
        p[n] = wanted[n] - behind + (p[n - 1] - wanted[n - 1] + behind) * np.exp(-dt / tau)
    return replace(test, path=replace(path, pressure=p))


def kinked_gauge(test: Test, size: float) -> Test:
    """A gauge that reads right up to 60 % of the top, and above it too little by the share `size` of what is
    added."""
    p = test.path.pressure
    return replace(test, path=replace(test.path, pressure=p + size * np.maximum(p - 0.6 * p.max(), 0.0)))


# -- what no library holds ----------------------------------------------------------------------------------


def stiff_wall(test: Test, size: float) -> Test:
    """One side of the finger is stiffer by the share `size`: the halves were cast from two batches of
    silicone, and glued."""
    case = test.case
    (body, material), = case.materials.items()  # fmt: skip
    side = case.nodes[case.connectivity].mean(axis=1)[:, 1] > 0.0
    hard = replace(material, C10=material.C10 * (1 + size), C01=material.C01 * (1 + size))
    sets = {**case.element_sets, body: np.flatnonzero(~side), "hard_side": np.flatnonzero(side)}
    return replace(test, case=replace(case, element_sets=sets, materials={body: material, "hard_side": hard}))


def tight_thread(test: Test, size: float) -> Test:
    """A thread over the crests pulls the first and the last bellow together with `size` N."""
    case = test.case
    high = case.nodes[:, 2] > 0.8 * case.nodes[:, 2].max()
    share, sets, forces = case.nodes[:, 0] / case.nodes[:, 0].max(), {}, {}
    for name, low, top, sign in (("thread_base", 0.1, 0.3, 1.0), ("thread_tip", 0.7, 0.9, -1.0)):
        sets[name] = np.flatnonzero(high & (share > low) & (share < top))
        forces[name] = test.share * sign * size * np.array([1.0, 0.0, 0.0])
    return replace(
        test,
        case=replace(case, node_sets={**case.node_sets, **sets}, forces={**case.forces, **forces}),
    )


def taut(x: Array) -> Array:
    """How much of its force a thread has that is slack up to 40 % of the top pressure, at shares x (s,)."""
    return np.clip((x - 0.4) / 0.6, 0.0, 1.0)


def rubbing(test: Test, size: float) -> Test:
    """The tip's face rubs along a wall before it: a force of `size` N against its motion, and none while it
    rests."""
    path, nodes = test.path, test.case.nodes
    way = np.sign(np.round(np.diff(path.pressure, prepend=path.pressure[0]), 9))
    tip = [nearest(test.case, np.array([nodes[:, 0].max(), 0.0, z])) for z in (4.0, 8.0, 12.0)]
    pulls = np.zeros((len(way), len(tip), 3))
    pulls[:, :, 2] = test.share * size / len(tip) * way[:, None]  # it bends down as it is filled
    return replace(test, path=replace(path, places=np.array(tip), pulls=pulls))


def hanging_tag(u: Array, test: Test, size: float) -> Array:
    """The last marker peels off as the finger is strained, and hangs down by `size` mm at the end."""
    path, row = test.path, int(np.flatnonzero(test.moving)[-1])
    strained = np.cumsum(path.pressure**2) / max(float((path.pressure**2).sum()), 1e-30)
    weight = path.outside_at(path.output)[:, :3]
    length = np.linalg.norm(weight, axis=1, keepdims=True)
    down = np.where(length > 0, weight / np.maximum(length, 1e-12), [0.0, 0.0, -1.0])
    out = u.copy()
    out[:, row] += size * np.interp(path.output, path.time, strained)[:, None] * down
    return out


def settling(u: Array, test: Test, size: float) -> Array:
    """The finger turns in its holder by `size` rad in all, tip down, half of it within 40 s."""
    angle = size * (1 - 2.0 ** (-test.path.output / 40.0))
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    place = test.points + u
    x, z = place[..., 0], place[..., 2]
    turned = np.stack([c * x + s * z, place[..., 1], c * z - s * x], axis=-1)
    return np.where(np.asarray(test.moving)[:, None], turned - test.points, u)


# -- all of them --------------------------------------------------------------------------------------------


def other(
    physics: str, unit: str, sizes: tuple[float, ...], part: str, before: Change, *,
    name: str = "", along: Callable[[Array], Array] | None = None,
) -> Kind:  # fmt: skip
    """A kind of another law, named as its map."""
    return Kind(name=name or before.__name__, physics=physics, law="other", unit=unit, sizes=sizes, part=part,
                before=before, along=along)  # fmt: skip


def unknown(
    unit: str, sizes: tuple[float, ...], part: str, before: Change, *,
    whole: bool = False, along: Callable[[Array], Array] | None = None,
) -> Kind:  # fmt: skip
    """A kind that no library holds, named as its map."""
    return Kind(name=before.__name__, physics="", law="unknown", unit=unit, sizes=sizes, part=part,
                before=before, whole=whole, along=along)  # fmt: skip


def pictured(unit: str, sizes: tuple[float, ...], after: Seen) -> Kind:
    """A kind that no library holds and that the picture alone shows, named as its map."""
    return Kind(name=after.__name__, physics="", law="unknown", unit=unit, sizes=sizes, part="picture",
                after=after)  # fmt: skip


KINDS_LATER: dict[str, Kind] = {
    k.name: k
    for k in (
        other("creep", "", (0.1, 0.15, 0.2), "history", stretched_creep),
        other("mullins", "", (0.125, 0.25), "path", pressed_softening),
        other("eccentric_core", "mm", (-1.2, -0.8, -0.3, 0.3, 0.8, 1.2), "static", sagging_core),
        other("strain_limiting_layer", "N/mm", (0.75, 1.5, 3.0, 4.5, 6.0), "static", sloped_layer),
        other("clamp", "rad/(N mm)", (3e-3, 6e-3, 12e-3), "static", known("clamp", "clamp.compliance"),
              name="bottoming_clamp", along=bottoming),
        other("pressure_lag", "s", (0.4, 0.8), "path", slow_vent),
        other("pressure_gain", "", (-0.35, 0.35), "path", kinked_gauge),
        unknown("", (0.25, 0.5, 0.75, 1.0), "static", stiff_wall, whole=True),
        unknown("N", (0.2, 0.4, 0.8, 1.2), "static", tight_thread, along=taut),
        unknown("N", (0.08, 0.16), "history", rubbing),
        pictured("mm", (0.25, 0.5), hanging_tag),
        pictured("rad", (-0.05, 0.05), settling),
    )
}  # fmt: skip
STAND_INS_LATER: dict[str, tuple[str, ...]] = {  # as `identify.STAND_INS_OF`, for those that are unknown
    "stiff_wall": ("twist", "soft spot", "force_aside_"),
    "tight_thread": ("outside force", "fold"),
    "rubbing": ("friction",),
    "hanging_tag": ("slip",),
    "settling": ("drift", "play"),
}

__all__ = ["KINDS_LATER", "STAND_INS_LATER"]
