"""Keywords of an Abaqus input deck, with parameters, data lines and their place in the file."""

import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

from fe.deck.expressions import value_of

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
LARGEST = 10**9  # of a label: Abaqus takes nine digits


@dataclass(frozen=True)
class Place:
    """A line of a file."""

    file: Path
    line: int

    def __str__(self) -> str:
        return f"{self.file} line {self.line}"


@dataclass(frozen=True)
class Keyword:
    """One keyword: name and parameters in capitals, data as (place, words), and where it stands."""

    name: str
    parameters: dict[str, str]
    data: list[tuple[Place, list[str]]]
    place: Place

    def error(self, what: str, place: Place | None = None) -> ValueError:
        """A ValueError that names the keyword's line, or the line of its data at `place`."""
        return ValueError(f"{place or self.place}: {what}")

    def numbers(self, place: Place, words: list[str]) -> list[float]:
        """The words as finite numbers; an empty word is 0."""
        numeric = all(NUMBER.fullmatch(w) for w in words if w)
        values = [float(w.lower().replace("d", "e") or 0) for w in words] if numeric else [math.nan]
        if not all(map(math.isfinite, values)):
            raise self.error(f"{_shown(words)}: wanted finite numbers, such as 0.03 or 3e-2", place)
        return values

    def rows(self, size: int, what: str) -> list[tuple[Place, list[str]]]:
        """Place and fields of each data line, `size` of them: absent ones are empty. ValueError for more,
        which names what they are."""
        for place, words in self.data:
            if any(words[size:]):
                raise self.error(f"*{self.name}: {len(words)} {what} on a line; wanted at most {size}", place)
        return [(place, filled(words, *[""] * size)) for place, words in self.data]

    def whole(self, place: Place, word: str, *, low: int = -LARGEST, high: int = LARGEST) -> int:
        """A word as a whole number from low to high."""
        return self.wholes(place, [word], low=low, high=high)[0]

    def wholes(
        self, place: Place, words: list[str], *, low: int = -LARGEST, high: int = LARGEST
    ) -> list[int]:
        """The words as whole numbers from low to high, such as labels: 1 to LARGEST."""
        values = self.numbers(place, words)
        for word, x in zip(words, values, strict=True):
            if not x.is_integer() or not low <= x <= high:
                shown = _shown([word]) or "an empty field"
                raise self.error(f"{shown}: wanted a whole number, {low} to {high}", place)
        return [int(x) for x in values]

    def text(self, parameter: str) -> str:
        """Value of a parameter. ValueError without it."""
        if not self.parameters.get(parameter):
            raise self.error(f"*{self.name} without {parameter}: wanted *{self.name}, {parameter}=...")
        return self.parameters[parameter]

    def only(self, *allowed: str) -> None:
        """ValueError for a parameter that is not among `allowed`."""
        unsupported = sorted(set(self.parameters) - set(allowed))
        if unsupported:
            raise self.error(f"*{self.name}, {unsupported[0]}: not supported; wanted *{self.name} without it")


def filled(words: list[str], *defaults: str) -> list[str]:
    """First fields of a data line, as many as `defaults`; an empty or absent one is its default, where "" is
    the number 0.

    >>> filled(["1.1", "", "0.5", ""], "", "0.2", "0.3", "0.4", "0.5")
    ['1.1', '0.2', '0.5', '0.4', '0.5']
    """
    return [word or default for word, default in zip_longest(words[: len(defaults)], defaults)]


def _shown(words: list[str]) -> str:
    text = ", ".join(words)
    return text if len(text) <= 60 else text[:57] + "..."


@dataclass(frozen=True)
class DeckText:
    """Keywords of a deck in order, all files read (the deck first), and the units declared by a comment such
    as `** units: mm, N, s`, with its line."""

    keywords: tuple[Keyword, ...]
    files: tuple[Path, ...]
    units: tuple[Place, str] | None = None


def read_keywords(path: Path) -> DeckText:
    """Keywords of a deck in order; comments and empty lines are left out, continued lines joined.

    *INCLUDE, and INPUT= of any keyword, read another file, relative to the deck's folder; <name> stands for
    the value that *PARAMETER gives it above. ValueError for a file that does not exist, lies outside that
    folder or includes itself, for too many or too deeply nested files, and for a parameter without a value.
    """
    reading = _Reading(path)
    return DeckText(tuple(_keywords(reading)), tuple(reading.files), reading.units)


UNITS = re.compile(r"\*\*\s*units?\s*[:=](.+)", re.IGNORECASE)  # a comment that declares them
DEEPEST, MOST_FILES, MOST_BYTES = 16, 1000, 2**30  # of includes in each other; of all that is read


@dataclass
class _Reading:
    """The files that a deck has made read so far."""

    deck: Path
    files: list[Path] = field(default_factory=list)
    opened: int = 0
    size: int = 0
    units: tuple[Place, str] | None = None
    parameters: dict[str, float | str] = field(default_factory=dict)

    def define(self, place: Place, text: str) -> None:
        """Give a parameter the value that a data line of *PARAMETER states."""
        name, is_there, expression = text.partition("=")
        if not is_there or not name.strip().isidentifier():
            raise ValueError(f"{place}: {_shown([text])}: wanted NAME = EXPRESSION, as in wall = 2.5")
        try:
            self.parameters[name.strip().lower()] = value_of(expression, self.parameters)
        except ValueError as error:
            raise ValueError(f"{place}: *PARAMETER {name.strip()}: {error}") from None

    def filled(self, place: Place, text: str) -> str:
        """A line with the values of its parameters in the place of their names."""

        def value(match: re.Match[str]) -> str:
            if match[1].lower() not in self.parameters:
                raise ValueError(
                    f"{place}: <{match[1]}>: no such parameter; define it above, under *PARAMETER"
                )
            return str(self.parameters[match[1].lower()])

        return re.sub(r"<\s*(\w+)\s*>", value, text) if "<" in text else text

    def text(self, file: Path, keyword: Keyword | None, depth: int) -> str:
        """The text of a file. ValueError for a pipe or a folder, and for one file too many."""
        if file.exists() and not file.is_file():
            raise ValueError(f"{file}: no file; wanted an input deck, no pipe, device or folder")
        self.opened, self.size = self.opened + 1, self.size + file.stat().st_size
        too = ""
        if depth > DEEPEST:
            too = f"files that include each other {depth} deep: wanted at most {DEEPEST}"
        elif self.opened > MOST_FILES:
            too = f"more than {MOST_FILES} files are read in all: wanted fewer"
        elif self.size > MOST_BYTES:
            too = f"more than {MOST_BYTES / 2**30:g} GB are read in all: wanted less"
        if too:
            raise ValueError(f"{keyword.place if keyword else file}: {too}; write the mesh into one file")
        if file not in self.files:
            self.files.append(file)
        return file.read_text(encoding="utf-8-sig", errors="replace")

    def other(self, keyword: Keyword) -> Path:
        """Path of the file that a keyword includes, relative to the deck's folder. ValueError where the file
        does not exist or lies outside that folder."""
        parameter, root = keyword.text("INPUT").strip(' "'), self.deck.parent
        name = parameter.replace("\\", "/")  # as a deck written on Windows has it
        file = root / os.path.normpath(name)
        what = f"*{keyword.name}, INPUT={parameter}:"
        if os.path.isabs(name) or "\0" in name or not file.resolve().is_relative_to(root.resolve()):
            raise keyword.error(f"{what} not in the folder of {self.deck.name}: wanted a file there or "
                                "below; copy it there")  # fmt: skip
        if not file.is_file():
            raise keyword.error(f"{what} no such file in {root}")
        return file


def _keywords(reading: _Reading) -> Iterator[Keyword]:
    open_: Keyword | None = None
    head: list[str] = []
    start = Place(reading.deck, 0)
    for place, raw in _lines(reading, reading.deck, (), None):
        if not raw.startswith("*") and not head and open_ is not None and open_.name == "PARAMETER":
            reading.define(place, raw)
            continue
        text = reading.filled(place, raw)
        if not text.startswith("*") and not head:
            if open_ is not None:
                open_.data.append((place, _words(text)))
            continue
        start = start if head else place
        head.append(text)
        if text.endswith(","):  # goes on in the next line
            continue
        if open_ is not None:
            yield open_
        open_, head = _keyword("".join(head), start), []
        if "INPUT" in open_.parameters:
            lines = _lines(reading, reading.other(open_), (reading.deck,), open_)
            open_.data.extend((at_line, _words(reading.filled(at_line, line))) for at_line, line in lines)
            del open_.parameters["INPUT"]
    if open_ is not None:
        yield open_


def _keyword(head: str, start: Place) -> Keyword:
    """The keyword of a whole head line, without data."""
    words = _words(head[1:])
    pairs = (w.partition("=") for w in words[1:] if w)
    parameters = {" ".join(k.upper().split()): v.strip() for k, _, v in pairs}
    return Keyword(" ".join(words[0].upper().split()), parameters, [], start)


def _lines(
    reading: _Reading, path: Path, within: tuple[Path, ...], keyword: Keyword | None
) -> Iterator[tuple[Place, str]]:
    """Lines of a file without comments and blank lines; the lines of an included file take the place of its
    *INCLUDE."""
    for number, raw in enumerate(reading.text(path, keyword, len(within)).splitlines(), start=1):
        text, place = raw.strip(), Place(path, number)
        if not text or text.startswith("**"):
            if match := UNITS.match(text):
                reading.units = place, match[1].strip()
            continue
        included = _keyword(text, place) if text[:40].upper().lstrip("* ").startswith("INCLUDE") else None
        if included is None or included.name != "INCLUDE" or not text.startswith("*"):
            yield place, text
            continue
        file = reading.other(included)
        if file in (*within, path):
            raise included.error(f"*INCLUDE, INPUT={file.name}: the file includes itself")
        yield from _lines(reading, file, (*within, path), included)


def _words(text: str) -> list[str]:
    """Comma-separated words of a line up to the last that is not empty; commas in quotation marks do not
    separate.

    >>> _words('*NSET, NSET="A, B", GENERATE'), _words("0.3, , 0.1, ,")
    (['*NSET', 'NSET="A, B"', 'GENERATE'], ['0.3', '', '0.1'])
    """
    text = text.rstrip(", \t")
    if '"' not in text:
        return [w.strip() for w in text.split(",")]
    parts = text.split('"')
    words: list[list[str]] = [[]]
    for k, part in enumerate(parts):
        if k % 2 and k < len(parts) - 1:
            words[-1].append(f'"{part}"')
            continue
        head, *rest = (f'"{part}' if k % 2 else part).split(",")
        words[-1].append(head)
        words += [[w] for w in rest]
    return ["".join(w).strip() for w in words]
