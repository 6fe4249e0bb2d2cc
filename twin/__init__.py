"""The whole chain: a recorded inflation test becomes a calibrated twin that names its missing effect.

    data = twin.read_table("tip.csv", points={"tip": (110, 11.5, 0)}, sd_mm=0.02)
    fit = twin.calibrate(twin.finger(length_mm=92), data)
    found = twin.diagnose(fit, data)

These names are what a notebook (docs/python.md) and a file of your own effect (docs/own-effect.md) need. Each
is imported when it is first used, so that `import twin` stays quick.

Beside the rooms lie `targets`, the measurement as arrays; `gravity` and `sanity`, what targets obey;
`fitmemory`, how many steps of them a fit holds;
`tablemodel`, the kinds of values in tables of TOML, and `validation`, which checks them; `marktables`,
points and markers; `records`, the base of JSON files; `files`, which writes every file whole or not at all;
`csvtable`, the reader of CSV, and `table`, rows as lines, CSV or a DataFrame; `messages` to the user;
`chain`, the one list of commands, and `signatures`, their options, which `cli` parses, `main` starts and
`console` prints; `notebook` and `results`, the same for Python; `numerals`, numbers as text; and `effort`,
the number and the cost of solves.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibrate import Parameter
    from twin.calibrated.actuators import bar, deck, finger, pneunet, tube
    from twin.calibrated.calibration import calibrate, diagnose
    from twin.calibrated.measurements import read_table
    from twin.contract.promises import check_effect
    from twin.effects.protocol import Effect, Order, Test
    from twin.foreign.programs import simulator
    from twin.judging.comparison import compare
    from twin.judging.fitting import whitener_of
    from twin.model.prediction import Model
    from twin.notebook import open_project
    from twin.targets import Noise, Targets

__all__ = [
    "Effect",
    "Model",
    "Noise",
    "Order",
    "Parameter",
    "Targets",
    "Test",
    "bar",
    "calibrate",
    "check_effect",
    "compare",
    "deck",
    "diagnose",
    "finger",
    "open_project",
    "pneunet",
    "read_table",
    "simulator",
    "tube",
    "whitener_of",
]

_HOME = {
    "Effect": "twin.effects.protocol",
    "Model": "twin.model.prediction",
    "Noise": "twin.targets",
    "Order": "twin.effects.protocol",
    "Parameter": "calibrate",
    "Targets": "twin.targets",
    "Test": "twin.effects.protocol",
    "bar": "twin.calibrated.actuators",
    "calibrate": "twin.calibrated.calibration",
    "check_effect": "twin.contract.promises",
    "compare": "twin.judging.comparison",
    "deck": "twin.calibrated.actuators",
    "diagnose": "twin.calibrated.calibration",
    "finger": "twin.calibrated.actuators",
    "open_project": "twin.notebook",
    "pneunet": "twin.calibrated.actuators",
    "read_table": "twin.calibrated.measurements",
    "simulator": "twin.foreign.programs",
    "tube": "twin.calibrated.actuators",
    "whitener_of": "twin.judging.fitting",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'twin' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
