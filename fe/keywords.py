"""The text of an Abaqus deck -> its keywords, each with parameters, data lines and its place."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Keyword:
    """One keyword: name and parameters in capitals, data as (line, words), and where it stands."""

    name: str
    parameters: dict[str, str]
    data: list[tuple[int, list[str]]]
    file: Path
    line: int

    def error(self, what: str, line: int | None = None) -> ValueError:
        """An error at the keyword, or at one of its data lines."""
        return ValueError(f"{self.file} line {line or self.line}: {what}")

    def numbers(self, line: int, words: list[str]) -> list[float]:
        """The words as numbers, an empty one as 0."""
        try:
            return [float(w.lower().replace("d", "e")) if w else 0.0 for w in words]
        except ValueError:
            raise self.error(f"{', '.join(words)}: wanted numbers", line) from None

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
    """The keywords of a deck in order; comments and empty lines are left out, continued lines joined."""
    open_, head, start = None, "", 0
    for number, raw in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        text = raw.strip()
        if text.startswith("**") or not text:
            continue
        if not text.startswith("*") and not head:
            if open_ is not None:
                open_.data.append((number, [w.strip() for w in text.split(",")]))
            continue
        head, start = head + text, start if head else number
        if head.endswith(","):  # goes on in the next line
            continue
        if open_ is not None:
            yield open_
        words = [w.strip() for w in head[1:].split(",")]
        pairs = (w.partition("=") for w in words[1:] if w)
        parameters = {" ".join(k.upper().split()): v.strip() for k, _, v in pairs}
        open_, head = Keyword(" ".join(words[0].upper().split()), parameters, [], path, start), ""
    if open_ is not None:
        yield open_
