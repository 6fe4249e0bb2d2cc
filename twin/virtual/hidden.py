"""Hidden effects of virtual truths: effects of the library, their physics by another law, and effects outside
the library. Every entry of `KINDS` has one amplitude, `size`, which is 0 where nothing is hidden.

They are effects like those of the library (two pure maps), but none of them is ever a candidate.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fe import Case, Path
from fe.case import Layer
from fe.mesh.inner import inside
from twin.effects.library import effect
from twin.effects.loads import first_order_lag
from twin.effects.measurement import turn
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect, Test
from twin.effects.supports import flat_bottom
from twin.targets import Array
from twin.virtual.hiddenmotion import swinging

Change = Callable[[Test, float], Test]
Seen = Callable[[Array, Test, float], Array]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of hidden truth.

    name; physics: the effect of the library that names it, or nothing; law: `same` as the library's,
    `other`, or `unknown`; unit of its size; sizes: at which a truth is solved, 0 left out; before, after: as
    those of an effect; part: what has to be solved for it: `static` (curves over pressure), `history` (the
    whole course), vibrations (`motion`), or nothing (`path` and `picture`: it changes the pressure or what is
    seen alone); whole: it needs the whole finger; along: a factor (s,) of its size at every step, from
    pressure (s,) over the top pressure; mechanism: its class, where the library does not have it.
    """

    name: str
    physics: str
    law: str
    unit: str
    sizes: tuple[float, ...]
    part: str
    before: Change = field(default=lambda test, size: test)
    after: Seen = field(default=lambda u, test, size: u)
    whole: bool = False
    along: Callable[[Array], Array] | None = None
    solved_as: str = ""
    amplitude: str = ""
    mechanism: Mechanism | None = None

    @property
    def key(self) -> str:
        """The name under which its solves are kept: kinds that differ in sign or `along` alone share them."""
        return self.solved_as or self.name

    @property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest size."""
        return min(0.0, *self.sizes), max(0.0, *self.sizes)


def known(label: str, parameter: str, others: Mapping[str, float] | None = None) -> Change:
    """The map of an effect of the library with one free parameter; the others are held."""
    effects: list[Effect] = []

    def change(test: Test, size: float) -> Test:
        effects[:] = effects or [effect(label)]
        return effects[0].before(test, {parameter: size, **(others or {})})

    return change


def seen_as(label: str, parameter: str, others: Mapping[str, float] | None = None) -> Seen:
    """Map of the camera image by an effect of the library with one free parameter."""

    def change(u: Array, test: Test, size: float) -> Array:
        return effect(label).after(u, test, {parameter: size, **(others or {})})

    return change


# -- other laws of the same physics -------------------------------------------------------------------------


def log_creep(test: Test, size: float) -> Test:
    """Relaxation in equal parts over four decades, as a logarithm of time: nine Prony terms."""
    series = tuple((size / 9, float(tau)) for tau in np.logspace(-1, 3, 9))
    return _with(test, test.case.with_material(prony=series))


def gent(test: Test, size: float) -> Test:
    """A part `size` (MPa) of the shear modulus is a Gent law with limit Jm = 1, instead of C10's."""
    old = next(iter(test.case.materials.values()))
    return _with(test, test.case.with_material(C10=old.C10 - size / 2, gent=(size, 1.0)))


def late_softening(test: Test, size: float) -> Test:
    """Mullins softening whose scale grows with the largest energy."""
    return _with(test, test.case.with_material(mullins=(size, 1e-3, 1.0)))


def two_volumes(test: Test, size: float) -> Test:
    """Two first-order volumes in series, `size` s in all, and a dead time of a fifth of `size`."""
    path, tau = test.path, max(size, 0.0)
    p = first_order_lag(path.time, path.pressure, 0.4 * tau)
    p = first_order_lag(path.time, p, 0.4 * tau)
    return _along(test, np.interp(path.time - 0.2 * tau, path.time, p))


def bent_gauge(test: Test, size: float) -> Test:
    """A gauge that reads wrong by a factor which grows with the pressure, `size` at the top."""
    p = test.path.pressure
    return _along(test, p * (1 + size * p / max(float(p.max()), 1e-12)))


def drifting_zero(test: Test, size: float) -> Test:
    """Drift of the gauge's zero (MPa) from `size` to half of `size` over the session."""
    t = test.path.time
    return _along(test, test.path.pressure + size * (1 - 0.5 * t / t[-1]))


def warming(test: Test, size: float) -> Test:
    """Change of the moduli by `size` in all, half of `size` within 40 s."""
    path = test.path
    return replace(test, path=replace(path, stiffness=1 + size * (1 - 2.0 ** (-path.time / 40.0))))


def stepped_wall(test: Test, size: float) -> Test:
    """Walls that are thicker by `size` mm behind the middle, and thinner before it, in one step."""
    return _inner(test, lambda x: size * 0.5 * np.tanh((x - 0.5) / 0.05))


def thin_band(test: Test, size: float) -> Test:
    """Walls thinner by `size` mm over a quarter of the length, with steep edges."""
    return _inner(test, lambda x: -size * np.exp(-np.minimum(((x - 0.5) / 0.125) ** 8, 100.0)))


def tilted_core(test: Test, size: float) -> Test:
    """A core that is held at the base and rises to `size` mm at the tip."""
    inner = inside(test.case)
    moved = np.zeros((len(inner.rows), 3))
    moved[:, 2] = size * _share(inner.position)
    return _moved(test, inner.spread(moved))


def half_layer(test: Test, size: float) -> Test:
    """A sheet of `size` N/mm in the bottom's half towards the base."""
    case, name = test.case, "hidden_layer"
    faces = flat_bottom(case)
    nodes = np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)
    near = case.nodes[nodes, 0].mean(axis=1) < 0.5 * case.nodes[:, 0].max()
    return _with(test, replace(case, surfaces={**case.surfaces, name: faces[near]}, layer=Layer(name, size)))


# -- what no library holds ----------------------------------------------------------------------------------


def tip_force(direction: tuple[float, float, float]) -> Change:
    """A dead force of `size` N on the tip face of the whole finger, in a direction."""

    def change(test: Test, size: float) -> Test:
        force = test.share * size * np.array(direction)
        return _with(test, replace(test.case, forces={**test.case.forces, "tip_face": force}))

    return change


def soft_band(test: Test, size: float) -> Test:
    """Silicone softer by the share `size` over a fifth of the length, nearer to the base."""
    case = test.case
    (body, material), = case.materials.items()
    x = case.nodes[case.connectivity].mean(axis=1)[:, 0] / case.nodes[:, 0].max()
    band = np.abs(x - 0.4) < 0.1
    soft = replace(material, C10=material.C10 * (1 - size), C01=material.C01 * (1 - size))
    sets = {**case.element_sets, body: np.flatnonzero(~band), "band": np.flatnonzero(band)}
    return _with(test, replace(case, element_sets=sets, materials={body: material, "band": soft}))


def leak(test: Test, size: float) -> Test:
    """The chamber loses pressure while it is held: the share `size` of it over 10 s, made up on the ramps."""
    path = test.path
    slope, top = np.gradient(path.pressure, path.time), max(float(path.pressure.max()), 1e-12)
    held, lost = np.abs(slope) < 0.02 * top, np.zeros(len(path.time))
    for n in range(1, len(lost)):
        dt = path.time[n] - path.time[n - 1]
        lost[n] = lost[n - 1] + size * dt / 10 if held[n] else lost[n - 1] * np.exp(-dt / 0.5)
    return _along(test, path.pressure * (1 - lost))


def backlash(test: Test, size: float) -> Test:
    """Bouc-Wen hysteresis of the pressure that acts, `size` MPa wide (Wen 1976, doi
    10.1061/JMCEA3.0002106)."""
    p = test.path.pressure
    z, reach = np.zeros(len(p)), 0.1 * max(float(p.max()), 1e-12)
    for n in range(1, len(p)):
        dp = (p[n] - p[n - 1]) / reach
        z[n] = z[n - 1] + dp - 0.5 * (abs(dp) * z[n - 1] + dp * abs(z[n - 1]))
    return _along(test, p - size * z)


def sliding(u: Array, test: Test, size: float) -> Array:
    """Slip of the base out of the clamp by `size` mm in x and half of `size` in z while the pressure first
    rises above 60 % of the top.
    """
    p, top = np.maximum.accumulate(test.path.at_output()), test.path.pressure.max()
    gone = np.clip((p / top - 0.6) / 0.4, 0.0, 1.0)
    out = u.copy()
    out[:, test.moving] += size * gone[:, None, None] * np.array([1.0, 0.0, 0.5])
    return out


def barrel(u: Array, test: Test, size: float) -> Array:
    """Radial distortion of the lens: `size` is the relative shift 60 mm off the picture's middle."""
    centre = np.array([0.5 * np.nanmax(test.points[:, 0]), 0.0, 0.0])
    offset = (test.points + u - centre) * [1.0, 0.0, 1.0]
    return u + size * ((offset / 60.0) ** 2).sum(axis=-1, keepdims=True) * offset


def slipped(u: Array, test: Test, size: float) -> Array:
    """The second marker of the finger slips by `size` mm towards the tip at 22 s."""
    row = int(np.flatnonzero(test.moving)[:2][-1])
    beside = (test.points[:, 2] == test.points[row, 2]) & test.moving
    gap = np.where(beside, np.abs(test.points[:, 0] - test.points[row, 0]), np.inf)
    near = np.argsort(gap)[:2]
    a, b = near[np.argsort(test.points[near, 0])]
    chord = (test.points + u)[:, b] - (test.points + u)[:, a]
    length = max(float(test.points[b, 0] - test.points[a, 0]), 1e-9)
    out = u.copy()
    out[:, row] += size * (test.path.output > 22.0)[:, None] * chord / length
    return out


def standing(u: Array, test: Test, heights: Array) -> Array:
    """Markers on stiff pins of `heights` (p,) mm, square to the chord between the two nearest of the lower
    edge's, the clamp's end of it being one."""
    at, moving, out = test.points, test.moving, u.copy()
    edge = np.flatnonzero(moving & (at[:, 2] < at[moving, 2].min() + 1e-6))
    x = np.concatenate([[0.0], at[edge, 0]])
    seen = np.pad((at + u)[:, edge], ((0, 0), (1, 0), (0, 0)))
    seen[:, 0, 2] = at[edge, 2].min()
    for row in np.flatnonzero(moving & (heights != 0)):
        near = np.argsort(np.abs(x - at[row, 0]), kind="stable")[:2]
        a, b = near[np.argsort(x[near])]
        chord = seen[:, b] - seen[:, a]
        length = np.hypot(chord[:, 0], chord[:, 2])
        out[:, row, 0] -= heights[row] * chord[:, 2] / length
        out[:, row, 2] += heights[row] * (chord[:, 0] / length - 1)
    return out


def uneven_pins(u: Array, test: Test, size: float) -> Array:
    """All markers on pins that grow from half of `size` mm at the base to one and a half at the tip."""
    x = np.where(test.moving, test.points[:, 0], 0.0)
    return standing(u, test, size * (0.5 + x / x.max()) * test.moving)


def tall_tag(u: Array, test: Test, size: float) -> Array:
    """The marker at the tip alone on a pin of `size` mm."""
    return standing(u, test, size * (np.arange(len(test.points)) == np.flatnonzero(test.moving)[-1]))


def nearing(u: Array, test: Test, size: float) -> Array:
    """Scale of the finger about the picture's middle that grows with the square of the last marker's motion,
    by `size` at the farthest."""
    moved = (u[:, np.flatnonzero(test.moving)[-1]] ** 2).sum(axis=1)
    centre = np.array([0.5 * np.nanmax(test.points[:, 0]), 0.0, 0.0])
    share = (moved / max(float(moved.max()), 1e-12))[:, None, None]
    return u + size * share * (test.points + u - centre) * [1.0, 0.0, 1.0] * test.moving[:, None]


def loose_clamp(u: Array, test: Test, size: float) -> Array:
    """The finger turns by `size` rad in its loose clamp while the pressure rises through 30 to 50 % of the
    top, and back while it falls through 20 to 5 %."""
    p, state, turned = test.path.pressure / max(float(test.path.pressure.max()), 1e-12), 0.0, []
    for x in p:  # play: above the way back, below the way up
        state = float(np.clip(state, np.clip((x - 0.3) / 0.2, 0, 1), np.clip((x - 0.05) / 0.15, 0, 1)))
        turned.append(size * state)
    angle, arm = np.interp(test.path.output, test.path.time, turned), test.points + u
    seen = np.einsum("sij,spj->spi", [turn(1, a) for a in angle], arm)
    return u + (seen - arm) * test.moving[:, None]


def zoomed(u: Array, test: Test, size: float) -> Array:
    """The picture's scale changes by `size` in the middle of the first recording."""
    later = test.path.output > 22.0
    return u + size * later[:, None, None] * (test.points + u) * [1.0, 0.0, 1.0]


def _with(test: Test, case: Case) -> Test:
    return replace(test, case=case)


def _along(test: Test, pressure: Array) -> Test:
    path: Path = replace(test.path, pressure=pressure)
    return replace(test, path=path)


def _share(position: Array) -> Array:
    x = position[:, 0]
    return np.asarray((x - x.min()) / np.ptp(x), float)


def _inner(test: Test, thickness: Callable[[Array], Array]) -> Test:
    """The test with its walls thicker by `thickness` mm of the share of the length."""
    inner = inside(test.case)
    amount = thickness(_share(inner.position))
    return _moved(test, inner.spread(amount[:, None] * inner.normal * [0.0, 1.0, 1.0]))


def _moved(test: Test, motion: Array) -> Test:
    nodes = test.case.nodes + motion
    return _with(test, replace(test.case, nodes=nodes))


def _two(*sizes: float) -> tuple[float, ...]:
    return (*(-s for s in reversed(sizes)), *sizes)


def _one(size: float) -> tuple[float, ...]:
    return (size / 2, size)


def _same(
    physics: str, parameter: str, unit: str, sizes: tuple[float, ...], part: str,
    *, label: str = "", others: Mapping[str, float] | None = None,
) -> Kind:  # fmt: skip
    full = f"{physics}.{parameter}"
    if part == "picture":
        return Kind(name=physics, physics=physics, law="same", unit=unit, sizes=sizes, part=part,
                    after=seen_as(label or physics, full, others), amplitude=full)  # fmt: skip
    return Kind(name=physics, physics=physics, law="same", unit=unit, sizes=sizes, part=part,
                before=known(label or physics, full, others), amplitude=full)  # fmt: skip


def _other(
    name: str, physics: str, unit: str, sizes: tuple[float, ...], part: str, before: Change,
    along: Callable[[Array], Array] | None = None, solved_as: str = "",
) -> Kind:  # fmt: skip
    return Kind(name=name, physics=physics, law="other", unit=unit, sizes=sizes, part=part, before=before,
                along=along, solved_as=solved_as)  # fmt: skip


def _seen(name: str, physics: str, unit: str, sizes: tuple[float, ...], after: Seen) -> Kind:
    return Kind(name=name, physics=physics, law="other", unit=unit, sizes=sizes, part="picture", after=after)


def _unknown(
    name: str, unit: str, sizes: tuple[float, ...], part: str, before: Change | None = None,
    after: Seen | None = None, *, whole: bool = False, solved_as: str = "",
) -> Kind:  # fmt: skip
    maps = {k: v for k, v in (("before", before), ("after", after)) if v is not None}
    return Kind(name=name, physics="", law="unknown", unit=unit, sizes=sizes, part=part, whole=whole,
                solved_as=solved_as, **maps)  # type: ignore[arg-type]


_CLAMP = known("clamp", "clamp.compliance")

KINDS = {
    k.name: k
    for k in (
        _same("creep", "g1", "", (0.02, 0.04, 0.08), "history", others={"creep.tau1": 4.0}),
        _same("mullins", "softening", "", (0.05, 0.1, 0.2), "history", others={"mullins.m": 2e-3}),
        _same("stiffening", "C20", "MPa", (-0.02, 0.02, 0.1), "static"),
        _same("clamp", "compliance", "rad/(N mm)", (2e-4, 4e-4, 1.6e-3), "static"),
        _same("precurvature", "per_mm", "1/mm", _two(1.5e-3, 2.8e-3), "static"),
        _same("wall_taper", "mm", "mm", _two(0.3, 0.9), "static"),
        _same("eccentric_core", "mm", "mm", _two(0.3, 0.8), "static"),
        _same("ballooning", "depth", "mm", (0.2, 0.4, 0.8), "static",
              others={"ballooning.place": 0.5, "ballooning.width": 5.0}),
        _same("strain_limiting_layer", "stiffness", "N/mm", (0.6, 3.0), "static"),
        _same("hoop_reinforcement", "stiffness", "N/mm", (0.6, 3.0), "static"),
        _same("compressibility", "excess", "1/MPa", (0.04, 0.08, 0.4), "static"),
        _same("gravity", "density", "tonne/mm3", _one(1e-9), "static"),
        _same("pressure_gain", "gain", "", _two(0.12), "path"),
        _same("pressure_offset", "offset", "MPa", _two(3e-3), "path"),
        _same("pressure_lag", "tau", "s", _one(0.4), "path"),
        _same("thermal", "rate", "1/s", _two(1.5e-3), "path"),
        _same("camera_scale", "scale", "", _two(0.18), "picture"),
        _same("time_shift", "s", "s", _two(0.3), "path"),
        _same("camera_rotation", "angle", "rad", _two(0.1), "picture"),
        _same("camera_tilt", "aside", "rad", _two(0.28), "picture", others={"camera_tilt.up": 0.0}),
        _same("tube", "up", "N", _two(0.1), "static", others={"tube.place": 0.75, "tube.along": 0.0}),
        replace(_same("marker_slip", "along", "mm", _two(0.4), "picture"), after=slipped),
        _same("camera_breathing", "scale", "", _two(0.05), "picture"),
        _other("log_creep", "creep", "", _one(0.15), "history", log_creep),
        _other("late_softening", "mullins", "", _one(0.2), "history", late_softening),
        _other("gent", "stiffening", "MPa", (0.1, 0.2), "static", gent),
        _other("stepped_wall", "wall_taper", "mm", _two(0.3, 0.8), "static", stepped_wall),
        _other("thin_band", "ballooning", "mm", (0.4, 0.8), "static", thin_band),
        _other("tilted_core", "eccentric_core", "mm", _two(0.3, 0.8), "static", tilted_core),
        _other("half_layer", "strain_limiting_layer", "N/mm", (1.0, 4.0), "static", half_layer),
        _other("softening_clamp", "clamp", "rad/(N mm)", _one(1.6e-3), "static", _CLAMP,
               along=lambda x: 0.5 + 0.5 * np.clip(x, 0, 1), solved_as="clamp"),
        _other("rearing_tube", "tube", "N", _two(0.08), "static", tip_force((0.0, 0.0, 1.0)),
               along=lambda x: np.clip(x, 0, 1) ** 2, solved_as="force_up"),
        _other("two_volumes", "pressure_lag", "s", _one(0.6), "path", two_volumes),
        _other("bent_gauge", "pressure_gain", "", _two(0.12), "path", bent_gauge),
        _other("drifting_zero", "pressure_offset", "MPa", _two(3e-3), "path", drifting_zero),
        _other("warming", "thermal", "", _two(0.2), "path", warming),
        replace(_seen("inertia", "inertia", "", (1.0,), swinging), part="motion"),
        _seen("uneven_pins", "marker_standoff", "mm", _two(3.0), uneven_pins),
        _seen("tall_tag", "marker_standoff", "mm", _two(3.0), tall_tag),
        _seen("nearing", "camera_breathing", "", _two(0.05), nearing),
        _unknown("force_up", "N", (-0.08, 0.08), "static", tip_force((0.0, 0.0, 1.0))),
        _unknown("force_down", "N", (-0.08, 0.08), "static", tip_force((0.0, 0.0, 1.0)),
                 solved_as="force_up"),
        _unknown("force_side", "N", (0.4,), "static", tip_force((0.0, 1.0, 0.0)), whole=True),
        _unknown("soft_band", "", _one(0.3), "static", soft_band),
        _unknown("leak", "", _one(0.2), "path", leak),
        _unknown("backlash", "MPa", _one(1e-3), "path", backlash),
        _unknown("sliding", "mm", _one(0.5), "picture", after=sliding),
        _unknown("barrel", "", _two(0.2), "picture", after=barrel),
        _unknown("zoomed", "", _two(0.02), "picture", after=zoomed),
        replace(_unknown("loose_clamp", "rad", _one(0.02), "picture", after=loose_clamp),
                mechanism=Mechanism.LOAD),
    )
}  # fmt: skip
