"""How a mark was placed in a frame: the codes of `Tracks.method`, by name."""

from enum import IntEnum


class Method(IntEnum):
    """Ways to place a mark; the numbers are those of the stored arrays."""

    LOST = 0
    REGISTERED = 1  # from where it was in the last frame
    FOUND_AGAIN = 2  # registered from where its code was read
    DOT = 3  # the contour of a plain dot
    ECC = 4  # smoothed correlation, where registration fails
    CORNERS = 5  # its four corners, where that fails too
    BY_HAND = 6  # where a person says that it is
    ADJUSTED = 7  # registered, with its blur and the slope of its light fitted beside the place


FIRM = (Method.REGISTERED, Method.FOUND_AGAIN, Method.ADJUSTED)
COARSE = (Method.ECC, Method.CORNERS, Method.BY_HAND)  # less certain than registration, and stated so
