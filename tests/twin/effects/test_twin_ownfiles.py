"""Files of a user's own effects: what they give, what is wrong with them, and that workers have them too."""

from functools import partial
from pathlib import Path

import pytest

from tests.messages import saying
from twin.effects.library import effect
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect
from twin.executors.local import Processes

FAN = '''"""A fan blows on the finger."""
from dataclasses import dataclass

from calibrate import Parameter
from twin.effects.protocol import Effect, Order


@dataclass(frozen=True)
class Wind:
    speed: float


class Fan(Effect):
    name, order = "fan", Order.SUPPORT
    sentence = "a fan blows on the finger"
    parameters = (Parameter("fan.speed", 0.0, 9.0, "m/s", null=0.0),)

    def __init__(self, wind=Wind(2.0)):
        self.wind = wind

    def start(self, theta):
        return {**theta, "fan.speed": self.wind.speed}


class _Draught(Fan):
    name = "draught"
'''


def write(folder: Path, text: str, name: str = "effects/fan.py") -> str:
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return name


def test_public_effects_of_a_file_join_the_library(tmp_path: Path) -> None:
    (fan,) = own_effects(tmp_path, [write(tmp_path, FAN)])
    assert (fan.label, fan.sentence) == ("fan", "a fan blows on the finger")
    assert effect("fan", users=[fan]) is fan
    with pytest.raises(ValueError, match=r"effect 'fan' is not in the library, .* \[model\] effect_files"):
        effect("fan")
    assert own_effects(tmp_path, []) == ()


def started(e: Effect) -> tuple[float, str]:
    return e.start({})["fan.speed"], type(e).__name__


def test_workers_have_the_effects_of_a_file_as_they_were_read(tmp_path: Path) -> None:
    name = write(tmp_path, FAN)
    (fan,) = own_effects(tmp_path, [name])
    (slow,) = own_effects(tmp_path, [write(tmp_path, FAN.replace("Wind(2.0)", "Wind(1.0)"))])
    (tmp_path / name).unlink()  # a worker needs no file, and sees no later one
    tasks = [partial(started, e) for e in (fan, slow)]
    assert dict(Processes(2).ended(tasks)) == {0: (2.0, "Fan"), 1: (1.0, "Fan")}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x = 1\n", r"effects/fan\.py: no effect in it; wanted a class such as `class Cable\(Effect\):`"),
        ("from twin.effects.protocol import Effect\n", r"effects/fan\.py: no effect in it"),
        (FAN.replace("null=0.0", "null=zero"), r"effects/fan\.py, line 16: NameError: name 'zero' is not defined"),
        (FAN + "import sys\nsys.exit(0)\n", r"effects/fan\.py, line 28: SystemExit: 0"),
        (FAN + "def (:\n", r"effects/fan\.py, line 27: SyntaxError: invalid syntax"),
        (FAN.replace("from calibrate", "from calibration"), r"effects/fan\.py, line 4: ModuleNotFoundError"),
        (FAN.replace("Order.SUPPORT", "20"), r"effects/fan\.py, line 13: effect 'fan': order = 20, wanted one of"),
        (FAN.replace('"fan"', '"creep"'), r"effects/fan\.py: effect 'creep' has the name of one in the library"),
        (FAN.replace("_Draught", "Draught").replace('"draught"', '"fan"'), "has the name of one in effects/fan"),
        (FAN.replace("wind=Wind(2.0)", "wind"), r"effects/fan\.py: Fan\(\) cannot be made without arguments"),
    ],
    ids=["none", "imported", "name", "exit", "syntax", "import", "order", "taken", "twice", "arguments"],
)
def test_what_is_wrong_with_a_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        own_effects(tmp_path, [write(tmp_path, text)])


def test_a_file_that_is_not_there_or_not_in_the_project_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=saying(r"model\.effect_files", r"effects/fan\.py")):
        own_effects(tmp_path, ["effects/fan.py"])
    write(tmp_path, FAN, "fan.py")
    (tmp_path / "project").mkdir()
    with pytest.raises(ValueError, match=saying(r"model\.effect_files", r"\.\./fan\.py")):
        own_effects(tmp_path / "project", ["../fan.py"])
    (tmp_path / "fan.py").write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match=saying(r"fan\.py", "UTF-8")):
        own_effects(tmp_path, ["fan.py"])
