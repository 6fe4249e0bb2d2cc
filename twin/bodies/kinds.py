"""The kinds of body that twin.toml can name, each with the table of its dimensions.

>>> sorted(BODIES)
['bar', 'finger', 'pneunet', 'tube']
"""

from twin.bodies.bar import BarTable
from twin.bodies.finger import FingerTable
from twin.bodies.pneunet import PneunetTable
from twin.bodies.tube import TubeTable

BodyTable = FingerTable | PneunetTable | TubeTable | BarTable
BODIES: dict[str, type[BodyTable]] = {
    "finger": FingerTable, "pneunet": PneunetTable, "tube": TubeTable, "bar": BarTable
}  # fmt: skip
