"""Stand-ins for what is seen: a drift, play in the clamp, a wrong picture, markers that slip or peel."""

from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import legval

from twin.effects.mechanism import Mechanism
from twin.effects.phrases import direction
from twin.effects.protocol import Order, Test, Theta, symmetric
from twin.effects.standin import Span, StandIn
from twin.effects.standinpressure import WIDTHS, stop
from twin.targets import Array


class MountingDrift(StandIn):
    """All markers of the finger move and turn as one with time, as its mounting creeps: polynomials of degree
    3, the turn about y and the markers' middle."""

    order, kind, sentence = Order.SLIP, "drift", "the finger as a whole moves with time"
    mechanism = Mechanism.LOAD
    TERMS = (1, 2, 3)

    def __init__(self, span: Span) -> None:
        self.span = span
        names = (f"{axis}{k}" for axis in ("along", "up") for k in self.TERMS)
        super().__init__("drift", names, "mm", most=5.0, step=0.02, likely=0.3)
        turns = (f"{self.name}.turn{k}" for k in self.TERMS)
        self.parameters += symmetric(*turns, most=0.1, unit="rad", step=5e-4, likely=0.01)

    def course(self, time: Array, theta: Theta) -> Array:
        """What moves along and up, in mm, and turns, in rad, (k, 3) at times (k,) s."""
        terms = np.reshape(self.numbers(theta), (3, len(self.TERMS)))
        return np.stack([legval(self.span.across(time), [0.0, *c]) for c in terms], axis=1)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        along, up, angle = self.course(test.path.output, theta).T[:, :, None]
        middle = test.points[np.asarray(test.moving, bool)].mean(axis=0)
        moved = turned(test.points + u - middle, angle) + np.stack([along, 0 * along, up], axis=-1)
        return u + moved * test.moving[:, None]

    def resembles(self, theta: Theta) -> str:
        time = np.linspace(self.span.begin, self.span.end, 41)
        course = self.course(time, theta)
        course = course - course[0]
        moved = np.stack([course[:, 0], 0 * time, course[:, 1]], axis=1)
        k, j = int(np.linalg.norm(moved, axis=1).argmax()), int(np.abs(course[:, 2]).argmax())
        size, angle = float(np.linalg.norm(moved[k])), float(course[j, 2])
        parts = [f"moving by {size:.2g} mm {direction(moved[k])} until {time[k]:.3g} s"] * (size > 0)
        ways = "downwards" if angle > 0 else "upwards"
        parts += [f"turning by {abs(angle):.2g} rad {ways} until {time[j]:.3g} s"] * (angle != 0)
        return f"the whole finger {' and '.join(parts)}"


def turned(arm: Array, angle: Array) -> Array:
    """What points at arms (.., 3) mm from an axis along y move (.., 3) mm as they turn about it by angles
    (..) rad, from z to x."""
    c, s = np.cos(angle) - 1, np.sin(angle)
    along, up = c * arm[..., 0] + s * arm[..., 2], c * arm[..., 2] - s * arm[..., 0]
    return np.stack([along, np.zeros_like(up), up], axis=-1)


class ClampPlay(StandIn):
    """The finger turns as a whole about its clamp, y through the clamp's middle, by the way on which the
    pressure was reached: by `stop` operators of it, of two WIDTHS."""

    order, kind, sentence = Order.SLIP, "play", "the clamp has play: the finger turns in it as a whole"
    mechanism = Mechanism.LOAD
    HALVES = (WIDTHS[0], WIDTHS[-1])

    def __init__(self, span: Span) -> None:
        self.span = span
        names = (f"w{100 * half:.0f}" for half in self.HALVES)
        super().__init__("clamp_play", names, "rad", most=0.1, step=5e-4, likely=0.01)

    def turn(self, share: Array, theta: Theta) -> Array:
        """The rotation (t,) rad along pressures (t,) over the top one."""
        sizes = zip(self.numbers(theta), self.HALVES, strict=True)
        return np.asarray(sum(a * stop(share, half) for a, half in sizes))

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        case, path = test.case, test.path
        low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
        x, z = case.clamp.centre if case.clamp else (low[0], (low[2] + high[2]) / 2)
        turn = np.interp(path.output, path.time, self.turn(path.pressure / self.span.top, theta))[:, None]
        return u + turned(test.points + u - [x, 0.0, z], turn) * test.moving[:, None]

    def resembles(self, theta: Theta) -> str:
        turn = self.turn(np.concatenate([np.linspace(0, 1, 41), np.linspace(1, 0, 41)]), theta)
        apart = turn[:41] - turn[:40:-1]
        k = int(np.abs(apart).argmax())
        return (
            f"the whole finger turned about its clamp by {abs(apart[k]):.2g} rad "
            f"{'downwards' if apart[k] > 0 else 'upwards'} while the pressure rises against while it falls"
        )


class WrongPicture(StandIn):
    """The picture is wrong: by an affine map of x and z, by keystones, and by a lens (r^2)."""

    order, kind, sentence = Order.CAMERA, "camera", "the camera's picture is distorted"
    WORDS: ClassVar[dict[str, str]] = {
        "xx": "stretched along the finger by {:.2g} %", "xz": "sheared along the finger by {:.2g} %",
        "zx": "turned or sheared upwards by {:.2g} %", "zz": "stretched upwards by {:.2g} %",
        "kx": "a keystone along the finger, {:.2g} % over 100 mm",
        "kz": "a keystone upwards, {:.2g} % over 100 mm", "r2": "distorted by the lens, {:.2g} % at 100 mm",
    }  # fmt: skip

    def __init__(self) -> None:
        super().__init__("picture", self.WORDS, "", most=0.3, step=0.01, likely=0.03)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        a = {name: self.of(theta, name) for name in self.WORDS}
        seen = test.points + u - test.points.mean(axis=0)
        x, z = seen[..., 0], seen[..., 2]
        radial = (a["kx"] * x + a["kz"] * z) / 100.0 + a["r2"] * (x**2 + z**2) / 1e4
        wrong_x = a["xx"] * x + a["xz"] * z + radial * x
        wrong_z = a["zx"] * x + a["zz"] * z + radial * z
        return u + np.stack([wrong_x, np.zeros_like(x), wrong_z], axis=-1)

    def resembles(self, theta: Theta) -> str:
        name = max(self.WORDS, key=lambda n: abs(self.of(theta, n)))
        return f"a picture {self.WORDS[name].format(100 * abs(self.of(theta, name)))}"


class MarkerJump(StandIn):
    """One marker jumps in the picture, at any of some times (k,) s."""

    order, kind, sentence = Order.SLIP, "slip", "one marker has slipped or was mistaken"

    def __init__(self, marker: str, times: Array) -> None:
        self.marker, self.times = marker, tuple(float(t) for t in times)
        names = (f"{axis}{k}" for k in range(len(self.times)) for axis in ("along", "up"))
        super().__init__(_name("slip_of", marker), names, "mm", most=5.0, step=0.05, likely=0.5)

    def _jumps(self, theta: Theta) -> Array:
        """The jumps (k, 3) mm."""
        along, up = np.reshape(self.numbers(theta), (-1, 2)).T
        return np.stack([along, np.zeros_like(up), up], axis=1)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        after = np.asarray(test.path.output[:, None] >= np.array(self.times), float)
        on_marker = np.array([m == self.marker for m in test.markers], float)
        return u + on_marker[:, None] * (after @ self._jumps(theta))[:, None]

    def resembles(self, theta: Theta) -> str:
        sizes = np.linalg.norm(self._jumps(theta), axis=1)
        k = int(sizes.argmax())
        return f"marker {self.marker} slipping by {sizes[k]:.2g} mm at {self.times[k]:.3g} s"


class MarkerPeel(StandIn):
    """One marker moves slowly in the picture, by as much over the film, evenly in time."""

    order, kind, sentence = Order.SLIP, "slip", "one marker peels off slowly"

    def __init__(self, marker: str, span: Span) -> None:
        self.marker, self.span = marker, span
        super().__init__(_name("peel_of", marker), ("along", "up"), "mm", most=5.0, step=0.05, likely=0.5)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        gone = (1 + self.span.across(test.path.output)) / 2
        on_marker = np.array([m == self.marker for m in test.markers], float)
        return u + gone[:, None, None] * on_marker[:, None] * self._shift(theta)

    def _shift(self, theta: Theta) -> Array:
        """By how much (3,) mm in all."""
        return np.array([self.of(theta, "along"), 0.0, self.of(theta, "up")])

    def resembles(self, theta: Theta) -> str:
        shift = self._shift(theta)
        much = f"{float(np.linalg.norm(shift)):.2g} mm {direction(shift)}"
        return f"marker {self.marker} peeling by {much} from {self.span.begin:.3g} s to {self.span.end:.3g} s"


def _name(prefix: str, marker: str) -> str:
    """A name of small letters and digits, of a marker's whatever that has."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in marker.lower())
    return f"{prefix}_{plain}"
