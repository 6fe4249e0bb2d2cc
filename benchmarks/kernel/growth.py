"""What a cold solve costs as the mesh grows: seconds, peak memory, factorisations, on one thread and on two.

    python benchmarks/kernel/growth.py [--quick] [--json]

The default finger on finer lattices, as a half and whole, at 0.03 MPa; each solve in a process of its own,
so that its peak memory (the imports' included) is its own. Up to 105,000 nodes; --quick stops at 40,000.
"""

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# cells a bellow, every cell divided so many times, and whether the finger is whole
MESHES = ((6, 1, False), (6, 1, True), (12, 1, True), (6, 2, False), (6, 2, True), (6, 3, False))
QUICK = 40_000  # nodes


@dataclass(frozen=True)
class Row:
    """One solve: the mesh, threads, U3 of the tip in mm, factorisations, seconds, and peak memory in MB."""

    per_bellow: int
    refine: int
    whole: bool
    threads: int
    nodes: int
    tip: float
    factorisations: int
    seconds: float
    peak_MB: float


def solved(per_bellow: int, refine: int, whole: bool, threads: int) -> Row:
    """The row of one mesh, solved in this process; what is done once for a mesh is done before."""
    from benchmarks.kernel.convergence import PRESSURE, SILICONE

    import numpy as np

    from fe import Finger, Lattice, Path, finger_case, solve

    case = finger_case(SILICONE, lattice=Lattice(per_bellow=per_bellow, refine=refine), full=whole)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.array([1.0]))
    solve(case, Path(path.time, 1e-3 * path.pressure, path.output))
    start = time.perf_counter()
    found = solve(case, path)
    seconds = time.perf_counter() - start
    tip = float(found.at(np.array([Finger().tip_node]))[0, 0, 2]) if found.converged else float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Row(per_bellow, refine, whole, threads, len(case.nodes), tip, found.iterations, seconds, peak)


def alone(mesh: tuple[int, int, bool], threads: int) -> Row:
    """The row of one mesh, solved in a process of its own."""
    arguments = [sys.executable, __file__, "--one", json.dumps([*mesh, threads])]
    environment = {**os.environ, **dict.fromkeys(THREADS, str(threads))}
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=True)
    return Row(**json.loads(done.stdout.splitlines()[-1]))


def main() -> int:
    """Print the table."""
    typed = options(__doc__, {"--one": {"help": "one mesh, in this process"}},
                    quick="stop at 40,000 nodes", json="one JSON line")  # fmt: skip
    if typed.one:
        print(json.dumps(asdict(solved(*json.loads(typed.one)))))
        return 0
    rows: list[Row] = []
    for mesh in MESHES:
        one = alone(mesh, 1)
        rows += [one, alone(mesh, 2)]
        if typed.quick and one.nodes > QUICK / 2:
            break
    if typed.json:
        print(json.dumps({"rows": [asdict(r) for r in rows]}))
        return 0
    print("| nodes | finger | threads | U3 tip / mm | factorisations | s | peak / MB |")
    print("|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r.nodes} | {'whole' if r.whole else 'half'} | {r.threads} | {r.tip:.3f} "
            f"| {r.factorisations} | {r.seconds:.2f} | {r.peak_MB:.0f} |"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
