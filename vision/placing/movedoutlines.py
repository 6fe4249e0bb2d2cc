"""How far the film's edges lie from the outline of a moved model, between rest and a moment, and how the body
moves beyond that model."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from vision.camera import Array
from vision.placing.outlines import WANDER, EdgeFit, rig_columns, robust, view_columns
from vision.placing.planeerrors import principal
from vision.placing.restpictures import RestSight
from vision.placing.silhouettes import BodySurface, Cut, Silhouette, cut

REACHES = 2.5, 0.8  # mm from the moved model's outline, and then from what was found, for the film's
SAME_MM = 0.5  # from a place of the outline at rest to one on the body that is seen at both times
STATIONS, SMOOTH = 40, 5  # along the body; degree of its middle, which takes no part in pleats
AWAY_MM, STRETCH, SHIFT_MM = 3.0, 0.02, 0.3  # how far model and body may be apart: at the tip, along, all
STRAIN = 0.15  # of the body: an edge that is elsewhere at rest moves by as much of that more
FAR, LEAST_MM, TWICE = 3.0, 0.2, 2  # sds and mm from which a tag is off its place, at so many moments
BENDS, STRETCHES = 4, 3  # terms of the polynomials along the body


@dataclass(frozen=True)
class Spine:
    """The middle of a moved body, and what bends and stretches it."""

    station: Array  # (m,) mm from the clamp at rest
    middle: Array  # (m,2) mm in the plane, as it is moved

    @staticmethod
    def of(faces: Array, flat: Array) -> "Spine":
        """That of faces (f,c,3) mm at rest in the body's axes, which are at flat (f,c,2) mm in the plane."""
        along = faces[..., 0].ravel()
        station = np.linspace(along.min(), along.max(), 2 * STATIONS + 1)[1::2]
        middle = [Polynomial.fit(along, x.ravel(), SMOOTH)(station) for x in (flat[..., 0], flat[..., 1])]
        return Spine(station, np.column_stack(middle))

    @cached_property
    def along(self) -> Array:
        """Directions (m,2) along the body."""
        tangent = np.gradient(self.middle, axis=0)
        return np.asarray(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))

    def direction(self, x: Array) -> Array:
        """Directions (k,2) along the body at x (k,) mm from the clamp."""
        return np.column_stack([np.interp(x, self.station, a) for a in self.along.T])

    def motions(self, x: Array, place: Array) -> Array:
        """Motion (k,2,g) mm of places (k,2) mm that are x (k,) mm from the clamp at rest, 1 sd each: the body
        bends otherwise, is longer, and all of it is elsewhere."""
        step = float(self.station[1] - self.station[0])
        length = step * STATIONS
        beyond = step * np.clip((x[:, None] - self.station) / step + 0.5, 0.0, 1.0)  # (k,m)
        away = place[:, None] - self.middle
        turned = np.stack([-away[..., 1], away[..., 0]], axis=-1)
        terms = np.polynomial.legendre.legvander(2 * (self.station - self.station[0]) / length - 1, BENDS - 1)
        bends = np.einsum("km,kmx,mg->kxg", beyond, turned, terms) * 2 * AWAY_MM / length**2
        longer = np.einsum("km,mx,mg->kxg", beyond, self.along, terms[:, :STRETCHES]) * STRETCH
        shifts = np.broadcast_to(SHIFT_MM * np.eye(2), (len(x), 2, 2))
        return np.concatenate([bends, longer, shifts], axis=2)


@dataclass(frozen=True)
class MovedOutline:
    """The film's edges beside the outline of a model at a moment."""

    line: Silhouette  # of the model, (k,) places in the plane
    body: Array  # (k,3) mm, the places on the body at rest, in its axes
    off: Array  # (k,) mm outside the model's that the film's edge has moved since the rest; NaN: not seen
    sd: Array  # (k,) mm
    pixel: Array  # (k,2) raw px of the film's edge
    left: Array  # (k,) mm, without what moves the whole body
    fit: EdgeFit  # at rest
    far: float  # mm, of the pose at rest, 1 sd, beside what its fit states
    spine: Spine
    amplitude: Array  # (g,) of motions of the body beyond the model's, of errors of the rig, and of light
    spread: Array  # (g,g)
    misfit: float  # mm, rms of `left`

    def beside(self, rest: Array, place: Array) -> tuple[Array, Array, Array]:
        """Motion (2,) mm of the body beyond the model's at a place (2,) mm of the plane, which is seen at
        rest (2,) mm, along the body and across it; its covariance (2,2); and these two directions (2,2).

        Where the body stands shows as motion as far as it turns: the whole error of that counts here, as its
        fit at rest may be wrong in which side of the body is the outer one.
        """
        pose, looks = self.fit.stands, self.fit.looks
        axis = np.array([np.cos(pose.turn), np.sin(pose.turn)])
        x = np.array([(rest - [pose.x_mm, pose.z_mm]) @ axis])
        before, now = (np.array([a, [-a[1], a[0]]]) for a in (axis, self.spine.direction(x)[0]))
        ends = [
            rig_columns(self.fit.sight, np.array([at, at]), own, pose, looks)
            for at, own in ((place, now), (rest, before))
        ]
        stands, beside = (a - b for a, b in zip(*ends, strict=True))
        rig = np.column_stack([stands, np.zeros((2, len(looks))), beside]) @ principal(self.fit.rig_spread).T
        columns = np.zeros((2, len(self.amplitude)))
        motions = now @ self.spine.motions(x, place[None])[0]
        columns[:, : motions.shape[1] + rig.shape[1]] = np.column_stack([motions, rig])
        elsewhere = self.fit.spread[:3, :3] + self.far**2 * np.diag([1.0, 1.0, 0.0])
        spread = columns @ self.spread @ columns.T + stands @ elsewhere @ stands.T
        return columns @ self.amplitude, spread + self.misfit**2 * np.eye(2), now


def apart_at(off: Array, sd: Array) -> NDArray[np.intp]:
    """Moments (n,) at which a tag no longer sits where it did on the body; none of a single moment.

    off, sd: (m,2) mm against the body beside it, along it and across, NaN where it is not seen.
    """
    moments = np.flatnonzero((np.abs(off) > np.maximum(FAR * sd, LEAST_MM)).any(axis=1))
    return moments if len(moments) >= TWICE else moments[:0]


@dataclass(frozen=True)
class _Edges:
    """The outline of a solid and how far outside it the film's edge lies, rig errors found at rest taken
    off."""

    line: Silhouette
    edge: Cut
    off: Array  # (k,) mm
    rig: Array  # (k,m) mm, 1 sd each, and 1 mm or rad of the pose
    taken: Array  # (k,) mm, by errors of the rig

    @staticmethod
    def of(fit: EdgeFit, sight: RestSight, solid: BodySurface) -> "_Edges":
        view, pose = sight.view_of(fit.looks), fit.stands
        line = sight.outline(solid, pose, view)
        edge = cut(sight.flat(solid.faces, pose, view), line.place, line.normal)
        looked = view_columns(sight, solid.faces, line, edge, pose, fit.looks)
        stands, beside = rig_columns(sight, line.place, line.normal, pose, fit.looks)
        rig, taken = np.column_stack([stands, looked, beside]), beside @ fit.found[-beside.shape[1] :]
        here = _Edges(line, edge, np.empty(0), rig, taken)
        return here.seen(fit, sight, np.zeros(len(line.place)), REACHES[0])

    def seen(self, fit: EdgeFit, sight: RestSight, ahead: Array, reach: float) -> "_Edges":
        """The same with the film's edges within `reach` mm of `ahead` (k,) mm."""
        off = sight.edges(self.line, fit.sign, reach, ahead + self.taken) - self.taken
        return replace(self, off=off)

    def material(self, faces: Array) -> Array:
        """Places (k,..) of faces (f,c,..) that are the outline."""
        start, end = (x.reshape(-1, x.shape[-1])[self.edge.side] for x in (faces, np.roll(faces, -1, axis=1)))
        return np.asarray(start + self.edge.share[:, None] * (end - start))


@dataclass(frozen=True)
class RestEdges:
    """The film's edges beside a model at rest, from which those of later moments are counted."""

    fit: EdgeFit
    solid: BodySurface
    edges: _Edges

    @staticmethod
    def of(fit: EdgeFit, solid: BodySurface) -> "RestEdges":
        """Those of a picture at rest.   solid: the model that is to move, at rest."""
        return RestEdges(fit, solid, _Edges.of(fit, fit.sight, solid))

    def moved(self, picture: Array, faces: Array) -> MovedOutline:
        """The outline in a picture (h,w) in which the model's faces are at (f,c,3) mm.

        What is seen is what has moved between both: an edge that lies elsewhere on the body does so at both.
        Of errors of the rig the differences count; light moves an edge as far as this has turned.
        """
        with np.errstate(under="ignore"):  # of curvatures and slopes that are next to nothing
            return self._moved(picture, faces)

    def _moved(self, picture: Array, faces: Array) -> MovedOutline:
        fit, sight = self.fit, self.fit.sight.with_picture(picture)
        now = _Edges.of(fit, sight, BodySurface(faces, self.solid.held))
        view, rest = sight.view_of(fit.looks), self.edges
        before = now.material(sight.flat(self.solid.faces, fit.stands, view))
        apart, same = (np.asarray(x) for x in scipy.spatial.cKDTree(rest.line.place).query(before))
        at_rest = np.where(apart < SAME_MM, rest.off[same], np.nan)
        turned = now.line.normal - rest.line.normal[same]
        rig = (now.rig - rest.rig[same]) @ principal(fit.rig_spread).T
        body = now.material(self.solid.faces)
        light = sight.rest.edge_mm * np.column_stack([turned, _pieces(turned, same)])
        x, _, z = (body / np.abs(body).max(axis=0)).T
        strained = STRAIN * np.nan_to_num(at_rest)[:, None] * np.column_stack([x**0, x, z, x * z])
        spine = Spine.of(self.solid.faces, sight.flat(faces, fit.stands, view))
        motions = np.einsum("kxg,kx->kg", spine.motions(body[:, 0], now.line.place), now.line.normal)
        columns, few = np.column_stack([motions, rig, light, strained]), motions.shape[1]
        known, edge_mm = np.zeros(columns.shape[1]), sight.rest.edge_mm
        found = robust(columns, now.off - at_rest, before=known + 1.0, pull=known, edge=edge_mm, least=0.0)
        now = now.seen(fit, sight, columns @ found.amplitude, REACHES[1])
        found = robust(columns, now.off - at_rest, before=known + 1.0, pull=known, edge=edge_mm, least=0.0)
        used = found.weight > 0.0
        misfit = float(np.sqrt(np.mean(found.left[used] ** 2))) if used.any() else np.nan
        return MovedOutline(
            line=now.line, body=body, off=np.where(used, now.off - at_rest, np.nan),
            sd=np.sqrt((columns[:, few:] ** 2).sum(axis=1) + found.sd**2),
            pixel=sight.pixels(now.line.place + (now.off + now.taken)[:, None] * now.line.normal),
            left=found.left, fit=fit, far=sight.far_side(self.solid), spine=spine,
            amplitude=found.amplitude, spread=found.spread, misfit=misfit,
        )  # fmt: skip


def _pieces(turned: Array, same: NDArray[np.intp]) -> Array:
    """Light on each piece of the outline (k,n), as far as it has turned."""
    piece = same // PIECE
    return WANDER * np.linalg.norm(turned, axis=1)[:, None] * (piece[:, None] == np.unique(piece))


PIECE = 20  # places at rest, 0.4 mm apart
