"""The keywords of an Abaqus input deck, each with its parameters, its data lines and where it stands."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path


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
        """An error at the keyword, or at one of its data lines."""
        return ValueError(f"{place or self.place}: {what}")

    def numbers(self, place: Place, words: list[str]) -> list[float]:
        """The words as numbers, an empty one as 0."""
        try:
            return [float(w.lower().replace("d", "e")) if w else 0.0 for w in words]
        except ValueError:
            raise self.error(f"{', '.join(words)}: wanted numbers", place) from None

    def whole(self, place: Place, word: str) -> int:
        """A word as a whole number."""
        (x,) = self.numbers(place, [word])
        if not x.is_integer():
            raise self.error(f"{word}: wanted a whole number", place)
        return int(x)

    def text(self, parameter: str) -> str:
        """A parameter that must be there."""
        if not self.parameters.get(parameter):
            raise self.error(f"*{self.name} without {parameter}: wanted *{self.name}, {parameter}=...")
        return self.parameters[parameter]

    def only(self, *allowed: str) -> None:
        """ValueError for a parameter that is not one of `allowed`."""
        other = sorted(set(self.parameters) - set(allowed))
        if other:
            raise self.error(f"*{self.name}, {other[0]}: not supported; wanted *{self.name} without it")


def read_keywords(path: Path) -> Iterator[Keyword]:
    """The keywords of a deck in order; comments and empty lines are left out, continued lines joined.

    *INCLUDE, and INPUT= of any keyword, read another file, named from the deck's folder. ValueError where it
    is not there or includes itself.
    """
    open_, head, start = None, "", Place(path, 0)
    for place, text in _lines(path, ()):
        if not text.startswith("*") and not head:
            if open_ is not None:
                open_.data.append((place, _words(text)))
            continue
        head, start = head + text, start if head else place
        if head.endswith(","):  # goes on in the next line
            continue
        if open_ is not None:
            yield open_
        words = _words(head[1:])
        pairs = (w.partition("=") for w in words[1:] if w)
        parameters = {" ".join(k.upper().split()): v.strip() for k, _, v in pairs}
        open_, head = Keyword(" ".join(words[0].upper().split()), parameters, [], start), ""
        if "INPUT" in parameters:
            lines = _lines(_other(open_, path), ())
            open_.data.extend((place, _words(text)) for place, text in lines)
            del parameters["INPUT"]
    if open_ is not None:
        yield open_


def files_of(keywords: Iterable[Keyword]) -> tuple[Path, ...]:
    """The files that keywords were read from, each once."""
    places = (place for k in keywords for place in (k.place, *(place for place, _ in k.data)))
    return tuple(dict.fromkeys(place.file for place in places))


def _lines(path: Path, within: tuple[Path, ...]) -> Iterator[tuple[Place, str]]:
    """The lines that say something, each *INCLUDE replaced by those of its file."""
    for number, raw in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        text, place = raw.strip(), Place(path, number)
        if not text or text.startswith("**"):
            continue
        named = re.fullmatch(r"\*\s*include\s*,\s*input\s*=\s*(.+)", text, flags=re.IGNORECASE)
        if not named:
            yield place, text
            continue
        root, within_ = (within or (path,))[0], (*within, path)
        keyword = Keyword("INCLUDE", {"INPUT": named.group(1)}, [], place)
        file = _other(keyword, root)
        if file in within_:
            raise keyword.error(f"*INCLUDE, INPUT={file.name}: the file includes itself")
        yield from _lines(file, within_)


def _other(keyword: Keyword, deck: Path) -> Path:
    file = deck.parent / keyword.text("INPUT").strip(' "')
    if not file.is_file():
        raise keyword.error(f"*{keyword.name}, INPUT={file.name}: no such file in {file.parent}")
    return file


def _words(text: str) -> list[str]:
    """The parts between commas, but for those in quotation marks."""
    return [w.strip() for w in re.findall(r'((?:"[^"]*"|[^,"])*)(?:,|$)', text)[: _commas(text) + 1]]


def _commas(text: str) -> int:
    return re.sub(r'"[^"]*"', "", text).count(",")
