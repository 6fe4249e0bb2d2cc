"""Effects of the measurement: what the camera makes of the positions."""

from calibrate import Parameter
from twin.effects.protocol import Effect, Order, Test, Theta
from twin.targets import Array


class CameraScale(Effect):
    """The picture is magnified: all positions are seen (1 + scale) times as far from the origin."""

    name, order = "camera_scale", Order.CAMERA
    sentence = "the picture's scale (mm per pixel) is wrong by a constant factor"
    parameters = (Parameter("camera_scale.scale", -0.2, 0.2, "", null=0.0, typical=0.01),)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        scale = theta["camera_scale.scale"]
        return u + scale * (test.points + u)
