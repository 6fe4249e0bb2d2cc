"""What a message must say: the thing, its value and the way out, in whatever words."""


class Lines(list[str]):
    """A `say` that keeps its lines."""

    def __call__(self, text: str, /) -> None:
        self.append(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        assert 0 <= done <= total, stage

    @property
    def lines(self) -> list[str]:
        return self


def run(*arguments: object) -> None:
    """The command line, as a user types it."""
    from twin import cli

    assert cli.app(args=[str(a) for a in arguments], standalone_mode=False) in (None, 0)


def saying(*parts: str) -> str:
    """A pattern for `match=` that finds all parts, each a regular expression, in any order."""
    return "(?s)" + "".join(f"(?=.*{part})" for part in parts)


def says(message: str, *parts: str) -> None:
    """Fails where a message lacks one of the parts, and names those."""
    missing = [part for part in parts if part not in message]
    assert not missing, f"{message!r} does not say {missing}"
