"""Turn data into files that are written whole or not at all, and read them back without pickle."""

import glob
import hashlib
import io
import json
import math
import os
import platform
import shlex
import shutil
import stat
import time
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from filelock import FileLock, Timeout
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel

from twin.validation import checked

MOST_BYTES = 4 * 2**30  # of the arrays of one file
MOST_READ = 2**30  # bytes of any other file
LOOKS, LOOK_S = 10, 0.05  # how often the name of the other command is looked for, and the time between, s
UNREADABLE = (ValueError, OSError, MemoryError)  # errors of a file that another file must not suffer from
AGAIN = "remove it and run its stage again"
Model = TypeVar("Model", bound=BaseModel)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """The path of a draft beside `path`, moved there in one step when the block ends: the one atomic writer.

    A killed or failed writer leaves the old file. The draft has the suffix of `path`, by which many programs
    choose a format. An OSError names the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield draft
        _to_disk(draft)
        os.replace(draft, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) if error.filename is None else error from None
    finally:
        draft.unlink(missing_ok=True)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """The path of a draft folder, moved to `folder` in one step when the block ends.

    The draft of a killed writer is removed. ValueError where `folder` is there and holds something.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is never overwritten; name a folder that does not exist"
        )
    for partial in folder.parent.glob(f".{glob.escape(folder.name)}.*.partial"):
        if not _lives(partial.name.split(".")[-2]):
            shutil.rmtree(partial, ignore_errors=True)
    draft = folder.with_name(f".{folder.name}.{os.getpid()}.partial")
    try:
        draft.mkdir(parents=True)
        yield draft
        if folder.is_dir():
            folder.rmdir()
        os.rename(draft, folder)
    except OSError as error:
        unnamed = error.filename in (None, str(draft))
        raise OSError(error.errno, error.strerror, str(folder)) if unnamed else error from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _lives(process: str) -> bool:
    """True where a process of this number runs, whose draft must stay."""
    if os.name == "nt":  # where signal 0 is Ctrl-C
        return True
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, ValueError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _to_disk(path: Path) -> None:
    with open(path, "rb") as file:
        os.fsync(file.fileno())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with whole(path) as draft:
        draft.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, data: Any) -> None:
    """Write JSON or a record whole or not at all; NaN and infinity become null, arrays become lists."""
    write_text(path, json.dumps(plain(data), indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def write_npz(path: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write named arrays whole or not at all; an array that would need pickle raises ValueError."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **{name: np.asarray(a) for name, a in arrays.items()})
    write_bytes(path, buffer.getvalue())


def append_jsonl(path: Path, record: Mapping[str, Any]) -> None:
    """Append one record as one line that is on the disk when this returns."""
    line = json.dumps(plain(record), allow_nan=False, ensure_ascii=False) + "\n"
    try:
        with open(path, "ab") as file:
            file.write(line.encode("utf-8"))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:  # a full disk is said without the file
        raise OSError(error.errno, error.strerror, str(path)) from None


def is_special(path: Path) -> bool:
    """True for a FIFO, a socket or a device, from which a reader would wait or read for ever.

    >>> is_special(Path(os.devnull)), is_special(Path()), is_special(Path("none"))
    (True, False, False)
    """
    return path.exists() and not path.is_file() and not path.is_dir()


def read_bytes(path: Path, *, most: int = MOST_READ) -> bytes:
    """The bytes of a file: the one function that opens files to read. OSError where the system refuses, which
    says nothing against the file; ValueError for no file, such as a FIFO, and for more than `most` bytes."""
    with open(path, "rb", opener=_open_at_once) as stream:
        about = os.fstat(stream.fileno())
        if not stat.S_ISREG(about.st_mode):
            raise ValueError(f"{path}: a FIFO, a socket or a device; wanted a file")
        if about.st_size > most:
            raise ValueError(f"{path}: {about.st_size / 2**30:.1f} GB; wanted at most {most / 2**30:g} GB")
        try:
            return stream.read()
        except MemoryError:
            raise MemoryError(f"{path} has {about.st_size / 2**20:.1f} MB") from None


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # else a FIFO waits for who writes to it


def read_text(path: Path, *, encoding: str = "utf-8", errors: str = "strict") -> str:
    """The text of a file with ends of lines as here; as `read_bytes`."""
    return read_bytes(path).decode(encoding, errors).replace("\r\n", "\n").replace("\r", "\n")


def read_jsonl(path: Path) -> list[dict[str, Any]]:
    """The records of a log, [] without a file; a last line cut off by a kill is left out."""
    if not path.exists():
        return []
    lines = read_bytes(path).split(b"\n")[:-1]  # what follows the last newline was cut off
    try:
        records = [json.loads(line) for line in lines if line.strip()]
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not valid JSON ({error}); remove the folder {path.parent}") from None
    if not all(isinstance(record, dict) for record in records):
        raise ValueError(f"{path}: wanted one record a line; remove the folder {path.parent}")
    return records


def mend_jsonl(path: Path) -> None:
    """Drop a last line cut off by a kill, so that the next record starts on its own line."""
    if path.exists():
        data = read_bytes(path)
        complete = data[: data.rfind(b"\n") + 1]
        if complete != data:
            write_bytes(path, complete)


def read_json(path: Path) -> Any:
    """The content of a JSON file; ValueError names the file and the place where it is broken."""
    try:
        return json.loads(read_text(path))
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except RecursionError:
        raise ValueError(f"{path}: its brackets lie in each other too deeply; {AGAIN}") from None
    except ValueError as error:  # of JSON, of UTF-8, or for a number of more than 4300 digits
        raise ValueError(f"{path}: not valid JSON ({error}); {AGAIN}") from None


def read(model: type[Model], path: Path) -> Model:
    """The record in a JSON file; ValueError names the file, and the key that is not what it should be."""
    data = read_json(path)
    try:
        return checked(model, data, name=str(path))
    except ValueError as error:
        raise ValueError(f"{error}; {AGAIN}") from None


def read_npz(path: Path, *required: str) -> dict[str, NDArray[Any]]:
    """The named arrays of a file: numbers of 8 bytes at most, booleans and text. The one reader of arrays.

    ValueError names the file where it is damaged or too large, or an array of `required` is not in it.
    """
    data = read_bytes(path, most=MOST_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            entries = packed.infolist()
            size = sum(entry.file_size for entry in entries)
            if size > MOST_BYTES:  # some kilobytes may unpack to more than any memory holds
                raise ValueError(f"unpacked it would have {size / 2**30:.0f} GB")
            arrays = {entry.filename.removesuffix(".npy"): _array(packed, entry) for entry in entries}
        if len(arrays) < len(entries):
            raise ValueError("an array stands twice")
        if missing := [name for name in required if name not in arrays]:
            raise ValueError(f"it has no array {missing[0]!r}")
    except MemoryError:  # the file is sound for all that is known
        raise MemoryError(f"{path} has {size / 2**20:.1f} MB of arrays") from None
    except Exception as error:  # zipfile and numpy each raise their own kinds
        raise ValueError(f"{path}: not a readable npz file ({error}); {AGAIN}") from None
    return arrays


def _array(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of a file; ValueError for another data type, or a header whose size is wrong."""
    with packed.open(entry) as stream:
        version = npy.read_magic(stream)
        head = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = head(stream)
        if kind.kind not in "biufU" or (kind.kind != "U" and kind.itemsize > 8):
            raise ValueError(f"{entry.filename} holds {kind}: wanted numbers, booleans or text, no pickle")
        if math.prod(shape) * kind.itemsize != entry.file_size - stream.tell():
            raise ValueError(f"{entry.filename} has not the size that it says: {shape} of {kind}")
    with packed.open(entry) as stream:
        return np.asarray(npy.read_array(stream, allow_pickle=False))


def check_plain(path: Path) -> Path:
    """The path of a file or folder, or of nothing; ValueError for a pipe or a device, whose end may never
    come."""
    if is_special(path):
        raise ValueError(f"{path}: is a pipe or a device; wanted a file")
    return path


def typed(path: Path) -> str:
    """A path as a user types it after an option, in quotes where a shell wants them.

    >>> print(typed(Path("my film.mp4")), typed(Path("-a.csv")))
    'my film.mp4' ./-a.csv
    """
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def digest_of(paths: Iterable[Path], *, root: Path) -> dict[str, str]:
    """The SHA-256 of every file, a folder standing for all files in it, by its path from `root`."""
    digests = {}
    for path in paths:
        for file in sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]:
            if not file.is_file():
                raise ValueError(f"{file}: {'a FIFO or a device' if is_special(file) else 'no such file'}")
            with open(file, "rb") as stream:
                digests[_from(file, root)] = hashlib.file_digest(stream, "sha256").hexdigest()
    return digests


def digest_text(data: Any) -> str:
    """The SHA-256 of plain data, whatever the order of its keys.

    >>> digest_text({"a": 1, "b": 2}) == digest_text({"b": 2, "a": 1})
    True
    """
    text = json.dumps(plain(data), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def plain(data: Any) -> Any:
    """Data as lists, dicts, numbers, strings and None; NaN and infinity become None. Of a record
    the fields that were set.

    >>> plain({"u": np.array([1.5, np.nan]), "file": Path("a/b.csv")})
    {'u': [1.5, None], 'file': 'a/b.csv'}
    """
    if isinstance(data, BaseModel):
        return plain(data.model_dump(exclude_unset=True, by_alias=True))
    if isinstance(data, Mapping):
        return {str(key): plain(value) for key, value in data.items()}
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    if isinstance(data, list | tuple | set | frozenset):
        return [plain(value) for value in data]
    if isinstance(data, np.generic):
        return plain(data.item())
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if data is None or isinstance(data, bool | int | str):
        return data
    if isinstance(data, Path):
        return data.as_posix()
    raise TypeError(f"{type(data).__name__} cannot be written as JSON")


def _from(file: Path, root: Path) -> str:
    """The path relative to the project, or the bare name of a file that lies elsewhere."""
    return file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name


@contextmanager
def lock(path: Path, command: str) -> Iterator[None]:
    """Hold the lock file while the block runs; ValueError says which command holds it already."""
    owner = path.with_name(f"{path.name}.json")  # beside it: on some systems nobody can read a locked file
    try:
        with FileLock(path, blocking=False):
            try:  # from before the file is there: an interrupt may come at once
                write_json(owner, {"command": command, "process": os.getpid(), "host": platform.node()})
                yield
            finally:
                owner.unlink(missing_ok=True)
    except Timeout:
        raise ValueError(f"{path}: {_who(owner)} is writing to this project; wait for it to end") from None


def _who(owner: Path) -> str:
    for _ in range(LOOKS):
        try:
            owner_data = read_json(owner)
            return f"`twin {owner_data['command']}` (process {owner_data['process']} on {owner_data['host']})"
        except (ValueError, KeyError, TypeError, OSError):  # one that has just begun is about to write it
            time.sleep(LOOK_S)
    return "another command"
