"""What is installed, by package, and what of it each kind of user needs: megabytes on the disk.

    python benchmarks/docs/installsize.py [--json]

Needed is what the commands of a kind of user load, and what that requires in turn. Then the same commands run
again with every other package barred: what runs so runs without them. `films`: from pixels
to the report; `tables`: displacements measured elsewhere to the prediction; `worker`: a structure solved with
`fe`; `cluster`: a worker of dask, with dask, that solves a load path. Results go to
`benchmarks/results/install.json`. About four minutes.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.chain import STAGES, fresh
from benchmarks.commandline import options

from twin.project.folder import dataset

RESULT = ROOT / "benchmarks" / "results" / "install.json"
WATCHED = """
import atexit, sys
barred = {barred!r}
class Bar:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in barred:
            raise ModuleNotFoundError(f"{{name}} is barred", name=name)
sys.meta_path.insert(0, Bar())
def told():
    tops = {{name.partition(".")[0] for name, module in sys.modules.items() if module is not None}}
    with open({out!r}, "a") as stream:
        stream.write("\\n".join(tops) + "\\n")
atexit.register(told)
sys.argv = {argv!r}
"""
COMMAND = "from twin.main import start\nstart()\n"


def ran(words: Sequence[str], folder: Path, *, barred: Sequence[str], script: str = COMMAND) -> set[str]:
    """The modules (top names) that a command loads, with some barred. SystemExit where it fails."""
    out = folder / "loaded.txt"
    out.unlink(missing_ok=True)
    text = WATCHED.format(barred=set(barred), out=str(out), argv=["twin", *words]) + script
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", text], cwd=folder, env=env, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"twin {' '.join(words)} without {', '.join(barred)}: {done.stderr[-800:]}")
    return set(out.read_text(encoding="utf-8").split())


def films(folder: Path, barred: Sequence[str]) -> set[str]:
    """What a film needs, from pixels to the report."""
    fresh(dataset("quick"), folder / "film")
    return set().union(*(ran((stage, "-p", "film"), folder, barred=barred) for stage in STAGES))


def tables(folder: Path, barred: Sequence[str]) -> set[str]:
    """What displacements that were measured elsewhere need, to the prediction."""
    fresh(dataset("study"), folder / "table")
    shutil.copytree(dataset("study") / "targets", folder / "table" / "targets")
    asked = ("predict", "--pressure", "10kPa")
    ways = [("calibrate",), ("compare",), ("diagnose",), asked, ("export", "json")]
    return set().union(*(ran((*words, "-p", "table"), folder, barred=barred) for words in ways))


def worker(folder: Path, barred: Sequence[str]) -> set[str]:
    """What solving a structure needs."""
    script = (ROOT / "examples" / "solve_finger.py").read_text(encoding="utf-8")
    return ran((), folder, barred=barred, script=script)


ON_WORKER = """
import distributed.cli.dask_worker
import numpy as np
from twin.executors.daskcluster import _served
from twin.executors.surroundings import Surroundings
from twin.model.discretisation import _response
from twin.model.loadpaths import NOTHING, along_path
from twin.model.structure import BuiltIn, base_case
case, reduced = base_case(), np.array([0.0, 0.01])
print(Surroundings.here().versions, along_path(case, 0.3, 0.3, reduced, case.nodes[:1], NOTHING).shape)
"""


def cluster(folder: Path, barred: Sequence[str]) -> set[str]:
    """What a worker of dask needs to solve a task of `twin calibrate`."""
    return ran((), folder, barred=barred, script=ON_WORKER)


KINDS = {"films": films, "tables": tables, "worker": worker, "cluster": cluster}


def alone(commands: Callable[[Path, Sequence[str]], set[str]], barred: Sequence[str]) -> set[str]:
    """What commands load in a folder of their own."""
    with tempfile.TemporaryDirectory() as folder:
        return commands(Path(folder), barred)


def required(name: str, seen: set[str]) -> set[str]:
    """A distribution and all that it requires, as far as it is installed."""
    if name in seen:
        return seen
    try:
        wanted = distribution(name).requires or []
    except PackageNotFoundError:
        return seen
    seen.add(name)
    for line in wanted:
        if "extra ==" not in line:
            found = re.match(r"[A-Za-z0-9._-]+", line)
            assert found is not None
            required(plain(found[0]), seen)
    return seen


def plain(name: str) -> str:
    """A distribution's name as pip compares them."""
    return re.sub(r"[-_.]+", "-", name).lower()


def size(name: str) -> float:
    """Megabytes of a distribution's files."""
    some = distribution(name).files or []
    return sum(path.stat().st_size for f in some if (path := Path(str(f.locate()))).is_file()) / 1e6


def main() -> int:
    """Print the table, and write it."""
    typed = options(__doc__, json="one JSON line")
    tops, whole = packages_distributions(), required("softtwin", set()) - {"softtwin"}
    every = whole | required("distributed", set())
    sizes = {name: size(name) for name in every}
    found: dict[str, list[str]] = {}
    for kind, commands in KINDS.items():
        loaded = alone(commands, ())
        names = {plain(n) for top in loaded for n in tops.get(top, ())} & every
        found[kind] = sorted(set().union(*(required(n, set()) for n in names)) & every)
        print(f"{kind}: {', '.join(found[kind])}", file=sys.stderr, flush=True)
        owners = {top: {plain(n) for n in names} for top, names in tops.items()}
        alone(commands, [top for top, n in owners.items() if n & every and not n & set(found[kind])])
    figures = {"whole": sum(sizes[n] for n in whole)}
    figures |= {kind: sum(sizes[n] for n in names) for kind, names in found.items()}
    figures = {kind: round(value) for kind, value in figures.items()}
    largest = dict(sorted(((n, round(sizes[n])) for n in whole), key=lambda row: -row[1])[:12])
    table = {"install_mb": figures, "largest_mb": largest}
    RESULT.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    if typed.json:
        print(json.dumps(table))
    else:
        for name, value in {**figures, **{f"  {n}": x for n, x in largest.items()}}.items():
            print(f"{name:32s} {value:5d} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
