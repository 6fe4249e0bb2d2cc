"""What a message must say: the thing, its value and the way out, in whatever words."""


def saying(*parts: str) -> str:
    """A pattern for `match=` that finds all parts, each a regular expression, in any order."""
    return "(?s)" + "".join(f"(?=.*{part})" for part in parts)


def says(message: str, *parts: str) -> None:
    """Fails where a message lacks one of the parts, and names those."""
    missing = [part for part in parts if part not in message]
    assert not missing, f"{message!r} does not say {missing}"
