"""Another law of strain_limiting_layer: sloped layer."""

from dataclasses import replace

import numpy as np

from fe.case import Layer
from twin.effects.protocol import Test
from twin.effects.supports import flat_bottom
from twin.virtual.hidden import Kind


def sloped_layer(test: Test, size: float) -> Test:
    """A sheet in the bottom of `size` N/mm on average, whose thickness grows evenly from almost nothing at
    the base."""
    case, name, parts = test.case, "sloped_layer", 10
    stiffness = tuple(float(size * s) for s in (2 * np.arange(parts) + 1) / parts)
    surfaces = {**case.surfaces, name: flat_bottom(case)}
    return replace(test, case=replace(case, surfaces=surfaces, layer=Layer(name, stiffness)))


KIND = Kind(
    name="sloped_layer",
    physics="strain_limiting_layer",
    law="other",
    unit="N/mm",
    sizes=(0.75, 1.5, 3.0, 4.5, 6.0),
    part="static",
    before=sloped_layer,
)
