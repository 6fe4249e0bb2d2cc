"""The whole chain: a recorded inflation test becomes a calibrated twin that names its missing effect."""

from twin.targets import Noise, Targets

__all__ = ["Noise", "Targets"]
