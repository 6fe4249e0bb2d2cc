"""A model that answers from tables instead of solves, so that a diagnosis of the short finger takes a second.

`ReducedModel` is a `Model` whose displacements come from the tables of `bank`: load paths over reduced
pressure for any constants, to which every effect that changes the structure adds its own, to second or third
order in its size and to first order beside others. What changes the pressure or the picture alone is exact.
Creep moves the load path's pressure to the creep-equivalent one (`fe.path.equivalent`), and what the solves
with it add to that is tabulated, too, as is Mullins softening.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

from benchmarks.diagnosis.bank import (
    FILE,
    GRID,
    LARGE,
    MAIN,
    NODES,
    SHARES,
    TOTALS,
    complete,
    entries,
    fitted_case,
    kind_of,
    rows_of,
    sizes,
)

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator, CubicSpline, interp1d

from fe.path import equivalent
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.prediction import HISTORY, Model, Solved, Tangents, each
from twin.targets import Array
from twin.virtual.protocols import PROTOCOLS

COURSE_STEPS = PROTOCOLS["P5"].steps
STIFF = dict.fromkeys(("N", "N mm", "N/mm", "MPa", "MPa/mm", "tonne/mm3"), -1)
SCALING = {**STIFF, "rad/(N mm)": 1, "1/MPa": 1}  # with C10 + C01, of an amplitude in such a unit
FARTHEST = 0.36  # reduced pressure beyond which a finger has no equilibrium; straight lines lead there
LITTLE = 1e-3  # of a parameter's typical size, for differences


@lru_cache(maxsize=1)
def bank() -> dict[str, Array]:
    """The arrays of the bank."""
    with np.load(FILE) as data:
        return {name: data[name].astype(float) for name in data.files}


def weights(nodes: Array, x: float) -> Array:
    """Weights (k,) of values at nodes (k,) for the value at x, constant beyond the ends: a cubic spline
    through four or more, else a polynomial."""
    nodes, unit = np.asarray(nodes, float), np.eye(len(nodes))
    if len(nodes) == 1:
        return np.ones(1)
    inside = float(np.clip(x, nodes[0], nodes[-1]))
    if len(nodes) < 4:
        return np.asarray(BarycentricInterpolator(nodes, unit)(inside))
    return np.asarray(CubicSpline(nodes, unit)(inside))


@dataclass(frozen=True)
class Table:
    """What an effect adds to the load paths: slopes (v, w, k, p, 3), one row v for each node and amplitude;
    bent: (row, size, further change (w, k, p, 3)) of whole solves."""

    effect: Effect
    shape: list[str]
    nodes: list[Theta]
    slopes: Array
    bent: list[tuple[int, float, Array]]

    @staticmethod
    def of(effect: Effect, test: Test, tables: "Tables") -> "Table | None":
        """The table of an effect at some places; None where the bank has none."""
        shape, nodes = entries(effect, test)
        wide = effect.laws()[-1]
        label, arrays = wide.label.replace(":", "_"), bank()
        if f"slopes@{label}" not in arrays:
            return None
        every = [(tuple(sorted(e.items())), name) for _, e, name in rows_of(wide, test)]
        none = dict.fromkeys(set(entries(wide, test)[0]) - set(shape), 0.0)  # of what a narrower law lacks
        wider = [(tuple(sorted({**none, **e}.items())), name) for _, e, name in rows_of(effect, test)]
        own = [every.index(row) for row in wider]
        slopes = tables.of_ways(arrays[f"slopes@{label}"][own])
        bent, plain = [], tables.of_ways(arrays["plain"])
        for k, (row, (_, _, name)) in enumerate(zip(own, rows_of(effect, test), strict=True)):
            for size in sizes(wide, name):
                key = f"size@{label}@{row}@{size:g}"
                if key in arrays:
                    bent.append((k, size, tables.of_ways(arrays[key]) - plain - size * slopes[k]))
        return Table(effect, shape, nodes, slopes, bent)

    def change(self, values: Theta, constants: Constants) -> Array:
        """What it adds to the load paths (w, k, p, 3) mm at named values."""
        at, out = self._nodes(values), np.zeros(self.slopes.shape[1:])
        count, nodes = len(self.effect.amplitudes), np.flatnonzero(at)
        for n, p in enumerate(self.effect.amplitudes):
            size = (values[p.name] - p.null) * (constants.scale / MAIN.scale) ** SCALING.get(p.unit, 0)
            if size == 0.0:
                continue
            for node in nodes:
                row = node * count + n
                out += at[node] * (size * self.slopes[row] + self._bend(row, size))
        return out

    def _bend(self, row: int, size: float) -> Array | float:
        """What the whole solves add to the first order: b2 a^2 + b3 a^3 + .. through all of them."""
        known = [(s, c) for r, s, c in self.bent if r == row]
        if not known:
            return 0.0
        top, order = max(abs(s) for s, _ in known), np.arange(2, 2 + len(known))
        powers = np.array([(s / top) ** order for s, _ in known])
        w = np.linalg.solve(powers.T, (size / top) ** order)
        return sum(x * c for x, (_, c) in zip(w, known, strict=True))  # type: ignore[return-value]

    def _nodes(self, values: Theta) -> Array:
        """Weights of the nodes."""
        out = np.ones(1)
        for name in self.shape:
            at, x = np.array(sorted({float(n[name]) for n in self.nodes})), float(values[name])
            if at[0] > 0 and at[-1] > 5 * at[0]:  # even steps of its logarithm
                at, x = np.log(at), float(np.log(max(x, 1e-9)))
            out = np.kron(out, weights(at, x))
        return out


def _powers(total: float) -> Array:
    return np.array([1.0, 1 / total, 1 / total**2])


@dataclass(frozen=True)
class Tables:
    """All tables for some places: rows (m,) of the bank's points, times (s,) s on the clock of the whole
    course, ways (s,) of gravity; weighed: whether the finger has weight."""

    rows: NDArray[np.int64]
    times: Array
    way: NDArray[np.int64]
    weighed: bool
    of: dict[str, Table | None] = field(default_factory=dict)
    shares: dict[float, Array] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)

    def of_ways(self, array: Array) -> Array:
        """An array (.., w, k, p, 3) at the places; without weight the mean of upright and upside down."""
        found = array[..., self.rows, :]
        return found if self.weighed else found[..., :2, :, :, :].mean(axis=-4, keepdims=True)

    def kind(self, effect: Effect, test: Test) -> str:
        """What an effect changes."""
        if effect.name == "elasticity":
            return "law"
        if effect.label not in self.kinds:
            self.kinds[effect.label] = kind_of(effect, test)
        return self.kinds[effect.label]

    def table(self, effect: Effect, test: Test) -> Table | None:
        """The table of an effect that changes the structure."""
        if effect.label not in self.of:
            self.of[effect.label] = Table.of(effect, test, self)
        return self.of[effect.label]

    @cached_property
    def base(self) -> Array:
        """Coefficients (3, h, w, k, p, 3) of the powers of 1 / total in the load paths, at SHARES."""
        count = range(len(SHARES))
        every = np.array([[self.of_ways(bank()[f"base@{i}@{j}"]) for j in count] for i in range(len(TOTALS))])
        powers = np.array([_powers(t) for t in TOTALS])
        return np.einsum("mi,ihwkpc->mhwkpc", np.linalg.inv(powers), every)

    def load_paths(self, share: float) -> Array:
        """Coefficients (3, w, k, p, 3) of the powers of 1 / total at a share."""
        if share not in self.shares:
            if len(self.shares) > 8:
                self.shares.clear()
            w = _at_shares()(share)
            self.shares[share] = np.asarray(np.tensordot(w, self.base, (0, 1)))
        return self.shares[share]

    @cached_property
    def creep(self) -> Array:
        """What creep adds (k, s, m, 3) mm to the load path at the creep-equivalent pressure, per unit of g,
        at the nodes of its time."""
        arrays, course, rows = bank(), PROTOCOLS["P5"].course, []
        paths = np.tensordot(
            _powers(MAIN.scale),
            replace(self, weighed=True, of={}, shares={}, kinds={}).load_paths(MAIN.shape[0]),
            1,
        )
        way = (COURSE_STEPS // 60).astype(int)
        still = along(paths, course.at_output() / MAIN.scale, way)
        for k, tau in enumerate(NODES["creep.tau1"]):
            q = equivalent(course.time, course.pressure, np.array([[0.05, tau]]))
            plain = along(paths, np.interp(COURSE_STEPS, course.time, q) / MAIN.scale, way) - still
            rows.append(((arrays[f"creep@{k}"] - arrays["course"])[:, self.rows] - plain) / 0.05)
        return self.at_times(np.array(rows))

    def at_times(self, rows: Array) -> Array:
        """Values (k, s, m, 3) at the times, of those at the steps of the whole course."""
        return interp1d(COURSE_STEPS, rows, axis=1, bounds_error=False, fill_value=(rows[:, 0], rows[:, -1]))(
            self.times
        )

    @cached_property
    def softening(self) -> tuple[Array, Array, Array]:
        """Changes (k, s, m, 3) mm per unit of softening at its nodes, and what the whole solves there add to
        the first order, per unit squared and cubed."""
        arrays = bank()
        rows = self.at_times(arrays["mullins"][:, :, self.rows])
        large, half = (
            np.array([arrays[f"mullins@{k}{size}"] - arrays["course"] for k in range(len(rows))])
            for size in ("", "@half")
        )
        far, near = (
            (self.at_times(changes[:, :, self.rows]) - size * rows) / size**2
            for changes, size in ((large, LARGE), (half, LARGE / 2))
        )
        return rows, 2 * near - far, (far - near) / (LARGE / 2)


def along(paths: Array, x: Array, way: Array) -> Array:
    """Displacements (s, p, 3) mm on load paths (w, k, p, 3) at reduced pressures x (s,), ways (s,)."""
    spline, inside = _spline(), np.minimum(x, GRID[-1])
    at, out = spline(inside) + (x - inside)[:, None] * spline(inside, 1), np.empty((len(x), *paths.shape[2:]))
    for k in range(len(paths)):
        own = way == k
        out[own] = np.tensordot(at[own], paths[k], 1)
    return out


@lru_cache(maxsize=1)
def _at_shares() -> BarycentricInterpolator:
    return BarycentricInterpolator(SHARES, np.eye(len(SHARES)))


@lru_cache(maxsize=1)
def _spline() -> CubicSpline:
    return CubicSpline(GRID, np.eye(len(GRID)))


@dataclass(frozen=True)
class ReducedModel(Model):
    """A model that looks up what others solve. counted: its look-ups, in place of solves."""

    tables: Tables = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    counted: list[int] = field(default_factory=lambda: [0], compare=False, repr=False)
    kept: dict[bytes, Solved] = field(default_factory=dict, init=False, compare=False, repr=False)

    @cached_property
    def _whole(self) -> tuple[Test, str]:
        return self.test, "Tables of the short finger."

    def put(self, theta: Theta) -> Test:
        """The test with the effects' `before` applied, but for those that have a table."""
        test = self.test
        for e in self.effects:
            if self.tables.kind(e, self.test) not in ("case", "course"):
                test = e.before(test, theta)
        return test

    def moved(self, test: Test, theta: Theta) -> Array:
        """Displacements (s, p, 3) mm before the mesh's correction and the camera. Raises Unsolvable where the
        tables end."""
        self.counted[0] += 1
        body = next(iter(test.case.materials.values()))
        constants, path, t = mooney_rivlin(body.C10, body.C01), test.path, self.tables
        factor = path.stiffness_at(path.output)
        drive = path.pressure if path.stiffness is None else path.pressure / path.stiffness
        prony = np.array([pair for pair in body.prony if pair[0]]).reshape(-1, 2)
        q = equivalent(path.time, drive, prony) if len(prony) else drive
        x = np.interp(path.output, path.time, q) / constants.scale
        if not SHARES[0] - 0.1 <= constants.shape[0] <= 1.1 or not np.isfinite(x).all() or x.max() > FARTHEST:
            raise Unsolvable(f"no equilibrium beyond a reduced pressure of {FARTHEST:g}")
        if factor.min() <= 0.05:
            raise Unsolvable("the moduli fall to nothing")
        parts = t.load_paths(constants.shape[0])
        scale = _powers(constants.scale)
        changes = [
            table.change(theta, constants)
            for e in self.effects
            if t.kind(e, self.test) == "case" and (table := t.table(e, self.test))
        ]
        if path.stiffness is None:
            u = along(sum(scale[m] * parts[m] for m in range(3)) + sum(changes), x, t.way)
        else:
            u = along(parts[0] + sum(changes), x, t.way)
            for m in (1, 2):
                u += along(scale[m] * parts[m], x, t.way) / (factor**m)[:, None, None]
        for e in self.effects:
            if t.kind(e, self.test) == "course" and (table := t.table(e, self.test)):
                there = e.at_output(path)[:, None, None]  # type: ignore[attr-defined]
                u += there * along(table.change(theta, constants), x, t.way)
        u += self._memory(body, constants)
        out = np.zeros((len(u), len(test.points), 3))
        out[:, test.moving] = u
        return out + _Surface.of(out, test).slipped(test) if test.slips else out

    def _memory(self, body: object, constants: Constants) -> Array | float:
        """What creep and softening add beyond the load paths."""
        out: Array | float = 0.0
        for g, tau in body.prony:
            if g:
                w = weights(np.log(NODES["creep.tau1"]), float(np.log(max(tau, 1e-3))))
                out = out + g * np.tensordot(w, self.tables.creep, 1)
        if mullins := body.mullins:
            soft, m, beta = mullins
            rows, bent, more = self.tables.softening
            scaled = m * MAIN.scale / constants.scale
            wm = weights(np.log(NODES["mullins.m"]), float(np.log(max(scaled, 1e-6))))
            w = np.kron(wm, weights(np.array(NODES["mullins.beta"]), beta))
            out = out + np.tensordot(w, soft * rows + soft**2 * bent + soft**3 * more, 1)
        return out

    # -- what a model offers --------------------------------------------------------------------------------

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """As `Model.solved`, from the tables; the last ones are kept."""
        key = theta.tobytes()
        known = self.kept.pop(key, None)
        if known is None or (derivatives and known.jacobian is None):
            u = known.u if known else self._seen_at(self.named(theta))
            rows = None
            if derivatives:
                rows = np.array([self._difference(self.named(theta), p) for p in self.parameters])
            known = Solved(theta.copy(), u, rows, None)  # type: ignore[arg-type]
        self.kept[key] = known
        for old in list(self.kept)[:-6]:
            del self.kept[old]
        return known

    def _seen_at(self, values: Theta) -> Array:
        test = self.put(values)
        return self.seen(self.moved(test, values), test, values)

    def _difference(self, values: Theta, p: object, step: float = LITTLE) -> Array:
        """The derivative (s, p, 3) of what is seen."""
        name, h = p.name, step * p.step  # type: ignore[attr-defined]
        plus, minus = ({**values, name: values[name] + s * h} for s in (1, -1))
        try:
            return (self._seen_at(plus) - self._seen_at(minus)) / (2 * h)
        except Unsolvable:
            return (self._seen_at(values) - self._seen_at(minus)) / h

    def solution(self, theta: Array) -> Any:
        """In place of a solution, whether there is a history."""
        body = next(iter(self.put(self.named(theta)).case.materials.values()))
        active = any(g for g, _ in body.prony) or bool(body.mullins and body.mullins[0])
        return SimpleNamespace(history=SimpleNamespace(active=True) if active else None)

    def per_pressure(self, theta: Array) -> Array:
        """As `Model.per_pressure`, from the tables."""
        values, h = self.named(theta), 1e-5
        test = self.put(values)
        ends = []
        for step in (h, -h):
            there = replace(test, path=replace(test.path, pressure=test.path.pressure + step))
            u = self.moved(there, values)
            ends.append(u if self.mesh is None else self.mesh.corrected(u, test))
        return (ends[0] - ends[1]) / (2 * h)

    def modes(self, theta: Array) -> Array:
        """As `Model.modes`, from the tables."""
        if self.mesh is None:
            return np.zeros((0, len(self.test.path.output), len(self.test.points), 3))
        values = self.named(theta)
        test = self.put(values)
        u = self.moved(test, values)
        modes = self.mesh.modes(u, test)
        plain = replace(test, case=test.case.with_material(prony=(), mullins=None))
        if plain.case.materials != test.case.materials:
            modes = np.concatenate([modes, HISTORY * each(u - self.moved(plain, values))])
        return self._beside(theta, modes - modes[:, self.reference].mean(axis=1, keepdims=True))

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> Tangents:
        """As `Model.tangents`, from the tables. What changes the picture alone asks for no look-up."""
        out, named = Tangents(), self.named(theta)
        test = self.put(named)
        u = self.moved(test, named)
        u = u if self.mesh is None else self.mesh.corrected(u, test)
        surface = _Surface.of(u, test)
        for e in effects:
            model, rows = self.with_effect(e), []
            nulls = {p.name: p.null for p in e.amplitudes}
            seen = self.tables.kind(e, self.test) == "seen"
            for entry in e.tries(self.test):
                values = {**named, **nulls, **entry}
                if seen:
                    own = [model._picture(u, surface, test, values, p) for p in e.amplitudes]
                else:
                    own = [model._secant(values, p) for p in e.amplitudes]
                rows.append(np.array(own))
            out[e.label] = rows
        return out

    def _picture(self, u: Array, surface: "_Surface", test: Test, values: Theta, p: Any) -> Array:
        """The derivative of what is seen to an amplitude that changes the picture alone, at corrected
        displacements u (s, p, 3) mm."""
        changed = {**values, p.name: values[p.name] + p.step}
        own = next(e for e in self.effects if p.name.startswith(f"{e.name}."))
        slips = own.before(replace(test, slips=()), changed).slips
        if slips:
            moved = surface.slipped(replace(test, slips=slips))
            return (moved - moved[self.reference].mean(axis=0)) / p.step
        a, b = u, u
        for e in self.effects:
            a, b = e.after(a, test, changed), e.after(b, test, values)
        change = a - b
        return (change - change[self.reference].mean(axis=0)) / p.step

    def _secant(self, values: Theta, p: object) -> Array:
        h = p.step  # type: ignore[attr-defined]
        try:
            high = self._seen_at({**values, p.name: values[p.name] + h})  # type: ignore[attr-defined]
            return (high - self._seen_at(values)) / h
        except Unsolvable:
            return np.zeros((len(self.test.path.output), len(self.test.points), 3))


@dataclass(frozen=True)
class _Surface:
    """How the lower edge turns under its markers: places x (k,) mm and slopes du/dx (s, k, 3)."""

    x: Array
    slope: Array

    @staticmethod
    def of(u: Array, test: Test) -> "_Surface":
        """That of displacements u (s, p, 3) mm of a test."""
        at = test.points[test.moving]
        low = np.flatnonzero(at[:, 2] < at[:, 2].min() + 1e-6)
        low = low[np.argsort(at[low, 0])]
        x = np.concatenate([[0.0], at[low, 0]])
        edge = np.concatenate([np.zeros((len(u), 1, 3)), u[:, test.moving][:, low]], axis=1)
        return _Surface(x, np.gradient(edge, x, axis=1))

    def slipped(self, test: Test) -> Array:
        """What slips add (s, p, 3) mm: a tag sits further along the surface, which turns as the lower edge
        beside it (`twin.model.firstorder` asks the mesh)."""
        out = np.zeros((len(test.path.output), len(test.points), 3))
        for slip in test.slips:
            at = float(np.clip(test.points[slip.row, 0], self.x[0], self.x[-1]))
            k = min(int(np.searchsorted(self.x, at, side="right")), len(self.x) - 1) - 1
            w = (at - self.x[k]) / (self.x[k + 1] - self.x[k])
            d = (1 - w) * self.slope[:, k] + w * self.slope[:, k + 1]
            turned = d if slip.axis[0] else np.stack([-d[:, 2], np.zeros(len(d)), d[:, 0]], axis=1)
            after = (test.path.output >= slip.time)[:, None]
            out[:, slip.row] += slip.size * after * (turned + slip.axis)
        return out


def has_table(effect: Effect, test: Test) -> bool:
    """Whether the bank can answer for an effect."""
    try:
        kind = kind_of(effect, test)
    except (KeyError, ValueError):
        return False
    wide = effect.laws()[-1]
    name = f"slopes@{wide.label.replace(':', '_')}"
    return kind not in ("case", "course") or complete(bank(), name, len(rows_of(wide, test)))


__all__ = ["ReducedModel", "Tables", "fitted_case", "has_table"]
