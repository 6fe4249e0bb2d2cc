"""How many pleats or chambers a body has along its upper side, by its edge in a picture."""

import numpy as np

from vision.camera import Array
from vision.following.edges import edge_places
from vision.placing.restpictures import STEP_PX, RestSight
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import Silhouette, Waves

STEP_MM = 0.4  # along the body
ABOVE_MM = 4.0  # the model, where the edge is looked for
LEAST, MOST = 0.5, 2.2  # of the stated count, between which it is looked for
TRIED = 400  # counts between these
SURE = 0.5  # of the profile's variance that one wave explains


def count_of(
    sight: RestSight, waves: Waves | None, line: Silhouette, pose: BodyPose, sign: float
) -> int | None:
    """The number of waves that the film shows; None for a body without, or where it is not clear.

    line: the outline of the model that stands so.
    The film's profile and the model's are read off one picture plane, so that what perspective does to both
    cancels.
    """
    if waves is None or waves.count < 2:
        return None
    along = np.arange(waves.start, waves.end, STEP_MM)
    film, model = _film(sight, waves, along, pose, sign), _model(line, along, pose)
    seen, drawn = _count(film, along, waves), _count(model, along, waves)
    return round(waves.count * seen / drawn) if seen and drawn else None


def _film(sight: RestSight, waves: Waves, along: Array, pose: BodyPose, sign: float) -> Array:
    """Heights (k,) mm of the film's edge over places along the body; NaN where none is clear."""
    up = np.arange(waves.low, waves.high + ABOVE_MM, STEP_PX / sight.px_per_mm)
    x, z = np.meshgrid(along, up, indexing="ij")
    grey = sight.grey(sight.flat(np.stack([x, np.zeros_like(x), z], axis=-1), pose))
    return waves.low + edge_places(grey, STEP_PX, sign) * (up[1] - up[0])


def _model(line: Silhouette, along: Array, pose: BodyPose) -> Array:
    """Heights (k,) mm of the model's outline over places along the body."""
    place = line.place - [pose.x_mm, pose.z_mm]
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    x, z = (place @ np.array([[c, -s], [s, c]])).T
    which = np.round((x - along[0]) / STEP_MM).astype(int)
    out = np.full(len(along), -np.inf)
    inside = (which >= 0) & (which < len(along))
    np.maximum.at(out, which[inside], z[inside])
    return np.where(np.isfinite(out), out, np.nan)


def _count(height: Array, along: Array, waves: Waves) -> float | None:
    """The number of waves that explains heights (k,) mm best; None where none does."""
    there = np.isfinite(height)
    if there.sum() < 0.5 * len(height):
        return None
    y, share = height[there], ((along - waves.start) / (waves.end - waves.start))[there]
    y = y - y.mean()
    counts = np.linspace(max(LEAST * waves.count, 1.0), MOST * waves.count, TRIED)
    left = []
    for count in counts:
        phase = 2 * np.pi * count * share
        columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
        left.append(((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2).sum())
    best = int(np.argmin(left))
    return float(counts[best]) if left[best] < (1 - SURE) * float((y**2).sum()) else None
