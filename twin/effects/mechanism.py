"""The six mechanisms by which a model may be wrong; every effect and every stand-in is of one. And to what an
effect belongs, which says where else it is found."""

from enum import StrEnum


class Owner(StrEnum):
    """What has an effect: another finger of the same silicone has those of the silicone."""

    SILICONE = "silicone"
    BODY = "body"
    RIG = "rig"


class Mechanism(StrEnum):
    """A class of physics, as a verdict tells it: sure where one effect cannot be told from its like."""

    HISTORY = "history of the silicone"
    LAW = "law of the silicone"
    BODY = "shape and stiffness of the body"
    LOAD = "load and supports"
    COURSE = "course of the pressure and clock"
    PICTURE = "camera and markers"

    @property
    def owner(self) -> Owner:
        """What has the effects of this mechanism, where one states nothing else."""
        if self in (Mechanism.HISTORY, Mechanism.LAW):
            return Owner.SILICONE
        return Owner.BODY if self is Mechanism.BODY else Owner.RIG

    @property
    def film(self) -> str:
        """The film that tells most of its effects apart."""
        return {
            Mechanism.HISTORY: "at another rate",
            Mechanism.LAW: "up to another pressure",
            Mechanism.BODY: "with a second camera from above",
            Mechanism.LOAD: "with a weight at the tip",
            Mechanism.COURSE: "at another rate",
            Mechanism.PICTURE: "with the camera set up anew",
        }[self]
