"""The examples (`>>>`) in the docstrings of the four packages run and print what they say."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _modules() -> list[str]:
    """Dotted names of the modules whose text holds an example."""
    files = [p for name in ("vision", "fe", "calibrate", "twin") for p in sorted((ROOT / name).rglob("*.py"))
             if re.search(r"^\s*>>> ", p.read_text(encoding="utf-8"), re.M)]  # fmt: skip
    parts = [p.relative_to(ROOT).with_suffix("").parts for p in files]
    return [".".join(p[:-1] if p[-1] == "__init__" else p) for p in parts]


@pytest.mark.parametrize("name", _modules())
def test_examples_of_a_module_print_what_they_say(name, tmp_path, monkeypatch):
    module = importlib.import_module(name)
    monkeypatch.chdir(tmp_path)
    options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    runner = doctest.DocTestRunner(optionflags=options)
    report: list[str] = []
    examples = doctest.DocTestFinder(exclude_empty=True).find(module, name)
    for example in examples:
        runner.run(example, out=report.append)
    assert not runner.failures, "".join(report)
    assert runner.tries, f"{name} has `>>>` outside of a docstring that doctest finds"


def test_there_are_examples_to_learn_from() -> None:
    files = [p for name in ("vision", "fe", "calibrate", "twin") for p in (ROOT / name).rglob("*.py")]
    assert sum(len(re.findall(r"^\s*>>> ", p.read_text(encoding="utf-8"), re.M)) for p in files) >= 150
