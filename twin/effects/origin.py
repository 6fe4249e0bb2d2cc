"""The file that a user's own effect comes from: its text travels with the effect into worker processes."""

import linecache
import sys
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from multiprocessing.reduction import ForkingPickler
from types import ModuleType
from typing import Any


@dataclass(frozen=True)
class Origin:
    """A Python file of a user's effects: its path as twin.toml has it, and its text.

    Every process runs this text, once. A file that is edited meanwhile changes nothing.
    """

    path: str
    text: str

    def module(self) -> ModuleType:
        """The module that the file defines. ValueError names the line at which it stops."""
        return _run(self)


@cache
def _run(origin: Origin) -> ModuleType:
    # the name is of the text, so that two projects in one process do not meet
    name = f"effect_file_{sha256(f'{origin.path} {origin.text}'.encode()).hexdigest()[:16]}"
    sys.dont_write_bytecode = True  # what it imports is trusted by digests: no file may join it
    module = ModuleType(name)
    module.__file__ = origin.path
    lines = origin.text.splitlines(keepends=True)
    linecache.cache[origin.path] = (len(origin.text), None, lines, origin.path)  # for tracebacks
    sys.modules[name] = module  # dataclasses in the file look for it
    try:
        exec(compile(origin.text, origin.path, "exec"), module.__dict__)
    except (Exception, SystemExit) as error:  # a file that exits would end the command as if all were well
        del sys.modules[name]
        raise ValueError(f"{origin.path}, line {_line(error, origin.path)}: {_said(error)}") from error
    return module


def _line(error: BaseException, path: str) -> int:
    """The line of the file at which it stopped: the last one of it in the traceback."""
    line, frame = getattr(error, "lineno", None) or 0, error.__traceback__
    while frame is not None:
        if frame.tb_frame.f_code.co_filename == path:
            line = frame.tb_lineno
        frame = frame.tb_next
    return line


def _said(error: BaseException) -> str:
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"


def sent(origin: Origin, effect: object) -> tuple[Any, ...]:
    """The pickle of an effect from a file, for a worker process: the file, and the attributes apart from it,
    since they may be of classes that the file defines."""
    attributes = bytes(ForkingPickler.dumps(vars(effect)))
    return _received, (origin, type(effect).__qualname__, attributes)


def _received(origin: Origin, name: str, attributes: bytes) -> object:
    effect_class: Any = getattr(origin.module(), name)
    effect = effect_class.__new__(effect_class)
    effect.__dict__.update(ForkingPickler.loads(attributes))
    return effect
