"""What exposure and rolling shutter take from a vibration that a camera sees."""

from dataclasses import dataclass

import numpy as np

SHRUNK = 0.01  # of an amplitude, that the longest exposure may take


@dataclass(frozen=True)
class Exposure:
    """How long a frame is exposed, and how long the camera reads from its first row to its last, in s."""

    seconds: float
    readout: float = 0.0

    def smear(self, frequency: float, amplitude: float) -> float:
        """The largest motion during an exposure, in the unit of the amplitude; frequency in Hz.

        >>> round(Exposure(0.005).smear(4.0, 17.0), 2)
        2.13
        """
        return 2 * amplitude * abs(float(np.sin(np.pi * min(frequency * self.seconds, 0.5))))

    def shrink(self, frequency: float) -> float:
        """The share of the amplitude that the mean over an exposure lacks: 1 - sin(x) / x, x = pi f t.

        >>> round(Exposure(0.010).shrink(8.0), 4)
        0.0105
        """
        return 1.0 - float(np.sinc(frequency * self.seconds))

    def skew(self, frequency: float, amplitude: float) -> float:
        """The largest motion while the rows are read: by so much a marker at one edge of the picture lies off
        one at the other edge that moves as it does."""
        return Exposure(self.readout).smear(frequency, amplitude)


def longest(frequency: float) -> float:
    """The exposure in s that takes SHRUNK of the amplitude of a vibration in Hz.

    sin(x) / x is 1 - x^2 / 6, to a thousandth of the result.

    >>> abs(Exposure(longest(8.0)).shrink(8.0) - SHRUNK) < 1e-4
    True
    """
    return float(np.sqrt(6 * SHRUNK)) / (np.pi * frequency)
