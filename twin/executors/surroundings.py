"""Versions, sources, threads and processor: all that the last bit of a result may depend on beside the task.

Workers must agree with this computer in all of it but the processor, of which the user is told.
"""

import os
import platform
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata

from twin.model.arraycache import ROOT, sources_digest

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pypardiso", "mkl", "pymoo")
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Surroundings:
    """Versions of Python, softtwin and the libraries by name ("none" where one is not installed), a digest of
    softtwin's sources, threads by environment variable, and what the processor can do."""

    versions: tuple[tuple[str, str], ...]
    sources: str
    threads: tuple[tuple[str, str], ...]
    processor: tuple[str, ...]

    def differences(self, here: "Surroundings") -> list[str]:
        """Differences of a worker that may change its results, a few words each."""
        theirs, expected = dict(self.versions), dict(here.versions)
        differing = [f"{name} {theirs.get(name, 'none')}, here {expected[name]}" for name in expected
                 if theirs.get(name, "none") != expected[name]]  # fmt: skip
        if not differing and self.sources != here.sources:
            differing.append(f"another state of softtwin's sources ({self.sources}, here {here.sources})")
        return differing

    @property
    def many_threads(self) -> list[str]:
        """Settings that allow more than one thread to numerical libraries, a few words each."""
        return [f"{name} = {value}" for name, value in self.threads if value != "1"]

    @staticmethod
    @cache
    def here() -> "Surroundings":
        """The surroundings of this process."""
        versions = [("python", platform.python_version()), ("machine", _machine())]
        versions += [(name, _version(name)) for name in ("softtwin", *LIBRARIES)]
        threads = tuple((name, os.environ.get(name, "not set")) for name in THREADS)
        sources = sources_digest(ROOT, ("vision", "fe", "calibrate", "twin"))[:12]
        return Surroundings(tuple(versions), sources, threads, _features())


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"


def _features() -> tuple[str, ...]:
    """The instructions of the processor by which numpy chooses its loops; MKL chooses likewise."""
    loops = import_module("numpy._core._multiarray_umath")  # what numpy.show_runtime() prints
    features = getattr(loops, "__cpu_features__", {})
    return tuple(sorted(name for name, has in features.items() if has))
