"""Effects of the structure: its supports and its shape."""

from dataclasses import replace

from calibrate import Parameter
from twin.effect import Effect, Test, Theta


class ElasticClamp(Effect):
    """The clamped face turns about the y axis in proportion to the moment on it."""

    name, order = "clamp", 20
    sentence = "the clamp gives way and turns with the moment on it"
    parameters = (Parameter("clamp.compliance", 0.0, 1e-2, "rad/(N mm)", null=0.0, typical=1e-5),)

    def before(self, test: Test, theta: Theta) -> Test:
        if test.case.clamp is None:
            return test
        clamp = replace(test.case.clamp, compliance=theta["clamp.compliance"])
        return replace(test, case=replace(test.case, clamp=clamp))
