"""What a YAML, XML or JSON file in OpenCV's manner holds, parsed within bounds: OpenCV's parser dies of deep
brackets, and a key that it is not asked for is passed over."""

import re
from pathlib import Path
from typing import Any

import cv2

MOST_BYTES = 2**24
DEEPEST = 32  # brackets, tags or dashes in each other
FILE = "YAML, XML or JSON"
_OPENS, _DASH = re.compile(r"[\[{\]}]"), re.compile(r"-\s")
_TAG = re.compile(r"<(/?)[A-Za-z_][^<>]*?(/?)>?(?=[<>\s]|$)")


def read_opencv(path: Path, *, what: str) -> dict[str, Any]:
    """The tree of an OpenCV file: maps, lists, numbers and texts. ValueError names `what` it should be where
    it is no file, too large, too deep or of another kind.
    """
    text = bounded_text(path, what=what)
    if path.suffix.lower() in (".yml", ".yaml") and not text.startswith("%YAML"):
        text = "%YAML:1.0\n---\n" + text  # ROS writes none
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        tree = _plain(storage.root(), 0)
    except (cv2.error, SystemError, OverflowError, MemoryError, TypeError, ValueError) as error:
        raise ValueError(f"{what} {path} cannot be read as {FILE}: write it again") from error
    return tree if isinstance(tree, dict) else {}


def bounded_text(path: Path, *, what: str) -> str:
    """Text of a file; ValueError for a pipe or device, and beyond the bounds of size and depth."""
    if not path.is_file():
        raise ValueError(f"{what} {path} is no file: wanted {FILE}")
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{what} {path} has {path.stat().st_size / 2**20:.0f} MB: wanted 16 MB or less")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    if max(_depth(text), *(len(_DASH.findall(line)) for line in text.splitlines()), 0) > DEEPEST:
        raise ValueError(f"{what} {path} has brackets or tags more than {DEEPEST} deep: write it again")
    return text


def _depth(text: str) -> int:
    """Brackets, or tags of XML, that lie in each other at most."""
    deepest = depth = 0
    for mark in _OPENS.finditer(text):
        depth += 1 if mark[0] in "[{" else -1
        deepest = max(deepest, depth)
    depth = 0
    for tag in _TAG.finditer(text):
        depth += -1 if tag[1] else 0 if tag[2] else 1
        deepest = max(deepest, depth)
    return deepest


def _plain(node: cv2.FileNode, depth: int) -> Any:
    """What a node holds as maps, lists, numbers and texts."""
    if depth > DEEPEST:
        raise ValueError("too deep")
    if node.isMap():
        return {str(key): _plain(node.getNode(key), depth + 1) for key in node.keys()}  # noqa: SIM118
    if node.isSeq():
        return [_plain(node.at(k), depth + 1) for k in range(node.size())]
    return node.string() if node.isString() else node.real() if node.isReal() else int(node.real())
