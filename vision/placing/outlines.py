"""Where a body stands, and how large it is, by its outline in a picture at rest."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.placing.restpictures import RestPicture, RestSight
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import BodySurface, Cut, Silhouette, cut
from vision.placing.waves import count_of
from vision.plane import misplaced

SEARCH_MM, SEARCH_TURN = 6.0, np.deg2rad(4.0)  # how far from where it is stated a body is looked for
# mm, how far from the model's outline the film's is looked for, in turn, and the least sd that judges it
REACHES = ((2.5, 0.5), (1.2, 0.2), (0.8, 0.1), (0.8, 0.0), (0.8, 0.0), (0.8, 0.0))
GOOD_MM, LEAST, SHARE = 0.25, 60, 0.4  # an edge that fits; how many are wanted, and which share of all
TUKEY = 4.7  # sds from which a place does not count
SPARSE = 3  # of the places, for the search on a grid of 0.5 mm
FAR_MM = 0.15  # by which a change of the dimensions moves the outline: beyond, it is made anew
ASIDE_MM = 0.6  # beside the outline, where body and ground are seen
LOOK = 0.5  # sds of the view, for its slopes
TURNS = 10  # of the weights
PIECE_MM, WANDER = 8.0, 0.4  # along the outline, from which to which the edge is off anew, by this share
ROUND_MM = 1.0  # radius at which blur and casting move an edge by the sd of all edges
LIKE = 0.1  # correlation of neighbours that still counts
KNOWN = 0.5  # of what is known before: a dimension whose sd is not below it is not shown


@dataclass(frozen=True)
class Size:
    """A number of the model as the outline shows it."""

    name: str
    off: float  # from what is stated
    sd: float
    shown: bool  # whether the outline tells it: its sd is far below what was known


@dataclass(frozen=True)
class Outline:
    """A body as its outline shows it."""

    pose: BodyPose
    covariance: Array  # (3,3) of x mm, z mm, turn rad
    sizes: tuple[Size, ...]
    pixel: Array  # (k,2) raw px, of the edge where it was found
    residual: Array  # (k,) mm, how far outside the fitted model it lies
    looked: int  # places that were looked at
    fit: "EdgeFit" = field(repr=False)
    counted: int | None = None  # pleats or chambers; None where they are not clear, or there are none

    def combined(self, weight: Mapping[str, float]) -> Size:
        """A sum of sizes with such weights."""
        rows = [k for k, size in enumerate(self.sizes) if size.name in weight]
        w = np.array([weight[self.sizes[k].name] for k in rows])
        spread = self.fit.spread[3:, 3:][np.ix_(rows, rows)]
        off, sd = float(w @ [self.sizes[k].off for k in rows]), float(np.sqrt(w @ spread @ w))
        return Size("", off, sd, True)


Make = Callable[[Mapping[str, float]], BodySurface]  # the solid with such changes of its numbers


def fit_outline(rest: RestPicture, make: Make, start: BodyPose, *, prior: Array | None = None) -> Outline:
    """The body's pose and sizes by its outline.

    make: the solid, from how far its numbers are from those stated.   start: the pose round which it is
    looked for.   prior: (3,) sd of that, mm, mm and rad; None: not known.

    Least squares of the distances along the normals, with Tukey's weights (doi 10.1080/03610927708827533),
    and all that is uncertain beside them as parameters of known sd. Raises ValueError where too little of the
    outline is seen.
    """
    with np.errstate(under="ignore"):  # of curvatures and slopes that are next to nothing
        return _fitted(RestSight(rest), make, start, prior)


def _fitted(sight: RestSight, make: Make, start: BodyPose, prior: Array | None) -> Outline:
    """The body as its outline shows it, as `fit_outline` says."""
    solid = make({})
    pose, sign = _searched(sight, sight.outline(solid, start), start)
    line = sight.outline(solid, pose)
    counted = count_of(sight, solid.waves, line, pose, sign)
    if counted and solid.waves and counted != solid.waves.count:
        make = solid.waves.other(counted)
        solid = make({})
        pose, sign = _searched(sight, sight.outline(solid, start), start)
        line = sight.outline(solid, pose)
    first = sight.edges(line, sign, REACHES[0][0], np.zeros(len(line.place)))
    _check_seen(int(np.isfinite(first).sum()), len(first))
    count = len(solid.changed)
    fit = EdgeFit.of(sight, solid, pose, np.zeros(count + len(sight.steps)), sign)
    for k, (reach, least) in enumerate(REACHES):
        fit = fit.solved(reach, least, start, prior)
        if fit.ahead > FAR_MM and k < len(REACHES) - 1:
            off = np.where(fit.shown | (np.arange(len(fit.off)) >= count), fit.off, 0.0)
            solid = make({c.name: float(v) for c, v in zip(solid.changed, off[:count], strict=True)})
            fit = EdgeFit.of(sight, solid, fit.stands, off, sign)
    return fit.outline(solid, prior, counted)


def _check_seen(count: int, looked: int) -> None:
    """Raise ValueError where the edge is seen at too few of the places that are looked at."""
    if count < max(LEAST, SHARE * looked):
        raise ValueError(
            f"the outline of the finger shows {count} of {looked} places of the model's, wanted "
            f"{max(LEAST, round(SHARE * looked))} or more; wanted a plain ground behind the finger, clearly "
            "darker or lighter, and dimensions as in twin.toml"
        )


def _searched(sight: RestSight, line: Silhouette, start: BodyPose) -> tuple[BodyPose, float]:
    """The pose near a start at which the picture changes most across the outline, and 1 where the ground is
    lighter than the body, else -1."""
    shifts, turns = np.arange(-SEARCH_MM, SEARCH_MM + 0.1, 0.5), np.linspace(-SEARCH_TURN, SEARCH_TURN, 9)
    origin, best = np.array([start.x_mm, start.z_mm]), (0.0, start, 1.0)
    line = line[np.arange(0, len(line.place), SPARSE)]
    for turn in turns:
        c, s = np.cos(turn), np.sin(turn)
        turned = np.array([[c, s], [-s, c]])
        place, normal = (line.place - origin) @ turned + origin, line.normal @ turned
        across = sight.grey(_shifted(place + ASIDE_MM * normal, shifts))
        across -= sight.grey(_shifted(place - ASIDE_MM * normal, shifts))
        usual = np.median(np.abs(across), axis=-1, keepdims=True)
        score = np.clip(across, -2.0 * usual, 2.0 * usual).mean(axis=-1)
        i, j = np.unravel_index(np.abs(score).argmax(), score.shape)
        if abs(score[i, j]) > best[0]:
            x, z = float(shifts[i]), float(shifts[j])
            pose = BodyPose(start.x_mm + x, start.z_mm + z, start.turn + float(turn))
            best = float(abs(score[i, j])), pose, float(np.sign(score[i, j]))
    return best[1], best[2]


def _shifted(place: Array, shifts: Array) -> Array:
    """Places (n,n,k,2) mm, shifted (n,) mm in x and in z."""
    x, z = np.meshgrid(shifts, shifts, indexing="ij")
    return place + np.stack([x, z], axis=-1)[:, :, None]


@dataclass(frozen=True, kw_only=True)
class EdgeFit:
    """The outline of the model, what moves it, and how far from it the film's is."""

    sight: RestSight
    pose: BodyPose  # of the model as it is drawn
    line: Silhouette
    sign: float
    columns: Array  # (k,3+q+n) mm along the normal for 1 mm in x, in z, 1 rad; 1 of a number; 1 sd of else
    known: Array  # (q,) sd of the numbers: the model's, and from where the camera looks
    made: Array  # (q,) what they are off in the model that is drawn
    found: Array  # (3+q+n,) of these columns
    residual: Array  # (k,) mm, NaN where no edge is found
    weight: Array  # (k,)
    spread: Array  # (3+q+n,3+q+n)

    @classmethod
    def of(cls, sight: RestSight, solid: BodySurface, pose: BodyPose, made: Array, sign: float) -> "EdgeFit":
        count = len(solid.changed)
        looks = made[count:]
        view = sight.view_of(looks)
        line = sight.outline(solid, pose, view)
        x, n = line.place, line.normal
        here = sight.flat(solid.faces, pose, view)
        edge = cut(here, x, n)
        moved = [edge.of(sight.flat(c.faces, pose, view) - here, n) / c.change for c in solid.changed]
        sizes = np.nan_to_num(np.array(moved).reshape(-1, len(x)).T)
        looked = view_columns(sight, solid.faces, line, edge, pose, looks)
        stands, beside = rig_columns(sight, x, n, pose, looks)
        columns = np.column_stack([stands, sizes, looked, _edges_beside(sight, line, pose), beside])
        return cls(
            sight=sight, pose=pose, line=line, sign=sign, columns=columns, made=made,
            known=np.array([*(c.sd for c in solid.changed), *np.ones(len(looks))]),
            found=np.zeros(columns.shape[1]), residual=np.full(len(x), np.nan),
            weight=np.zeros(len(x)), spread=np.empty((0, 0)),
        )  # fmt: skip

    @property
    def stands(self) -> BodyPose:
        x, z, turn = (float(v) for v in self.found[:3])
        return BodyPose(self.pose.x_mm + x, self.pose.z_mm + z, self.pose.turn + turn)

    @property
    def off(self) -> Array:
        """The numbers (q,) found, from what is stated."""
        return np.asarray(self.made + self.found[3 : 3 + len(self.known)])

    @property
    def looks(self) -> Array:
        """Amplitudes (r,) found of from where the camera looks."""
        return self.off[len(self.off) - len(self.sight.steps) :]

    @property
    def rig_spread(self) -> Array:
        """Covariance of pose, view, and frame marks, scale and distance, as their columns are."""
        few, count = 3 + len(self.known), len(self.known) - len(self.sight.steps)
        beside = 2 * len(self.sight.rest.marks) + 2
        last = np.arange(len(self.spread) - beside, len(self.spread))
        rows = np.concatenate([np.arange(3), np.arange(3 + count, few), last])
        return np.asarray(self.spread[np.ix_(rows, rows)])

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Which (q,) of the numbers the outline tells: their sd is far below what was known."""
        return np.asarray(np.sqrt(np.diag(self.spread))[3 : 3 + len(self.known)] < KNOWN * self.known)

    @property
    def ahead(self) -> float:
        """Largest distance in mm from the model that is drawn to the one found."""
        few = slice(3 + len(self.known))
        return float(np.abs(self.columns[:, few] @ self.found[few]).max(initial=0.0))

    def solved(self, reach: float, least: float, start: BodyPose, prior: Array | None) -> "EdgeFit":
        """The fit to the edges within `reach` mm of the model found so far; places are judged by an sd of
        `least` mm or more."""
        few = 3 + len(self.known)
        seen = self.sight.edges(self.line, self.sign, reach, self.columns[:, :few] @ self.found[:few])
        beside = self.columns.shape[1] - few
        stands = np.zeros(3) if prior is None else 1 / prior**2
        before = np.concatenate([stands, 1 / self.known**2, np.ones(beside)])
        pull = np.zeros(len(before))
        pull[:3] = start.x_mm - self.pose.x_mm, start.z_mm - self.pose.z_mm, start.turn - self.pose.turn
        pull[3:few] = -self.made
        found = robust(
            self.columns, seen, before=before, pull=pull, edge=self.sight.rest.edge_mm, least=least
        )
        return replace(self, found=found.amplitude, residual=found.left, weight=found.weight,
                       spread=found.spread)  # fmt: skip

    def outline(self, solid: BodySurface, prior: Array | None, counted: int | None) -> Outline:
        """What is found; ValueError where it is not enough."""
        good = self.weight > 0.0
        count, looked = int((good & (np.abs(np.nan_to_num(self.residual)) < GOOD_MM)).sum()), len(good)
        _check_seen(count, looked)
        far = self.sight.far_side(solid)
        sd = np.hypot(np.sqrt(np.diag(self.spread)), far)
        open_pose = np.zeros((3, 3)) if prior is not None else np.diag([1.0, 1.0, 0.0])
        edge = self.line.place + (self.columns @ self.found + self.residual)[:, None] * self.line.normal
        sizes = tuple(
            Size(c.name, float(self.off[k]), float(sd[3 + k]), bool(sd[3 + k] < KNOWN * c.sd))
            for k, c in enumerate(solid.changed)
        )
        return Outline(
            pose=self.stands, covariance=self.spread[:3, :3] + open_pose * far**2, sizes=sizes,
            pixel=self.sight.pixels(edge[good]), residual=self.residual[good], looked=looked, fit=self,
            counted=counted,
        )  # fmt: skip


@dataclass(frozen=True)
class Robust:
    """Amplitudes of columns by what is seen, with Tukey's weights."""

    amplitude: Array  # (n,)
    left: Array  # (k,) mm, NaN where nothing is seen
    weight: Array  # (k,)
    spread: Array  # (n,n) covariance of the amplitudes
    sd: float  # mm, of one place


def robust(columns: Array, seen: Array, *, before: Array, pull: Array, edge: float, least: float) -> Robust:
    """The amplitudes of columns (k,n) that explain what is seen (k,) mm.

    before, pull: (n,) 1/variance of each amplitude and its value, as known before.   edge: mm, as of a
    picture.   least: mm, the smallest sd of a place that judges it.
    """
    there = np.isfinite(seen)
    weight, sd = there.astype(float), max(least, edge)
    found, left = np.zeros(len(before)), seen
    for _ in range(TURNS if there.sum() > LEAST / 2 else 0):
        normal = (columns.T * weight) @ columns / sd**2 + np.diag(before)
        right = (columns.T * weight) @ np.nan_to_num(seen) / sd**2 + before * pull
        found = np.linalg.solve(normal, right)
        left = seen - columns @ found
        sd = max(1.4826 * float(np.median(np.abs(left[there]))), WANDER * edge, least)
        share = np.nan_to_num(left) / (TUKEY * max(sd, edge))
        weight = np.where(there, np.maximum(1.0 - share**2, 0.0) ** 2, 0.0)
    alike = _alike(np.where(weight > 0, left, np.nan))
    normal = (columns.T * weight) @ columns / (sd**2 * alike) + np.diag(before)
    return Robust(found, left, weight, np.linalg.pinv(normal, hermitian=True), sd)


def rig_columns(
    sight: RestSight, place: Array, normal: Array, pose: BodyPose, looks: Array
) -> tuple[Array, Array]:
    """What moves places (k,2) mm of a body along normals (k,2) and is of the rig: 1 mm in x, in z and 1 rad
    (k,3); frame marks, the scale and the distance from the camera (k,m), 1 sd each.   looks: (r,) of the
    view."""
    rest, view, x, n = sight.rest, sight.view_of(looks), place, normal
    turning = n[:, 1] * (x[:, 0] - pose.x_mm) - n[:, 0] * (x[:, 1] - pose.z_mm)
    frame = rest.frame_mm * (misplaced(sight.plane, x[None])[:, 0] * n).sum(axis=-1).T
    scale = rest.scale * (x * n).sum(axis=1)
    nearer = rest.height_mm * ((x - view.foot) * n).sum(axis=1) / view.distance
    return np.column_stack([n, turning]), np.column_stack([frame, scale, nearer])


def view_columns(
    sight: RestSight, faces: Array, line: Silhouette, edge: Cut, pose: BodyPose, looks: Array
) -> Array:
    """What moves an outline of faces (f,c,3) mm along its normals as the camera looks from elsewhere (k,r),
    1 sd each.   edge: where the faces are the outline."""
    here = sight.flat(faces, pose, sight.view_of(looks))
    views = (sight.view_of(looks + LOOK * one) for one in np.eye(len(looks)))
    looked = [edge.of(sight.flat(faces, pose, other) - here, line.normal) / LOOK for other in views]
    return np.nan_to_num(np.array(looked).reshape(-1, len(line.place)).T)


def _edges_beside(sight: RestSight, line: Silhouette, pose: BodyPose) -> Array:
    """What moves the outline and is of its edges (k,n), 1 sd each: each side's edge is elsewhere, and anew
    from piece to piece, and what is curved is rounder."""
    rest, x, n = sight.rest, line.place, line.normal
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    own = n @ np.array([[c, -s], [s, c]])
    side = np.where(np.abs(own[:, 0]) > np.abs(own[:, 1]), own[:, 0] > 0, 2 + (own[:, 1] > 0))
    edges = rest.edge_mm * (side[:, None] == np.arange(4))
    piece = (np.cumsum(np.linalg.norm(np.diff(x, axis=0, prepend=x[:1]), axis=1)) / PIECE_MM).astype(int)
    pieces = WANDER * rest.edge_mm * (piece[:, None] == np.unique(piece))
    return np.column_stack([edges, pieces, rest.edge_mm * ROUND_MM * line.curvature])


def _alike(residual: Array) -> float:
    """How many neighbours' worth of residuals (k,) of the outline say the same: 1 of white noise."""
    there = np.isfinite(residual)
    x = np.where(there, residual, 0.0)
    power, total = float((x * x).sum()), 1.0
    for lag in range(1, len(x) // 4):
        shared = float((x[lag:] * x[:-lag]).sum()) / max(power, 1e-300)
        if shared < LIKE:
            break
        total += 2.0 * shared
    return total
