"""A real pneumatic arm that rings after a step: do the constants of its static fits foretell the frequency?

    SOFTTWIN_DATA=... python benchmarks/diagnosis/ringing_arm.py [--json]

The fits are those of benchmarks/results/real_arm.json, of three holds; recordings are measured as by `twin
ringing`. modulus: the share of the beam's modulus of 0.264 MPa that the measured frequency asks for, as the
square of the frequency is in proportion to it. The density is that published; nothing weighs at the tip.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.realarm import BEAM_E, CELLS, DATA, FITS, FITTED, RIB, ROOT, problem
from benchmarks.kernel.arm import Arm

from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.vibration import modes
from twin.formats.motionfile import read_motion
from twin.ringing.freevibration import Ringing, ringings

HZ = 100.0
SHOWN = (75, 100, 200, 300, 350, 400)  # mbar
SOME = (next(iter(FITS)), list(FITS)[-1])  # constants alone, and with all effects


def measured(mbar: int) -> Ringing:
    """The ringing of a recording."""
    moved = read_motion(Path(DATA, f"arm_{mbar:03d}mbar.csv"), fps=HZ)
    return ringings(moved.time, moved.position)[0]


def foretold(effects: tuple[str, ...], values: dict[str, float], mbar: int) -> float:
    """The slowest frequency in Hz in the plane in which the arm bends, about a held pressure; NaN where the
    model does not carry that."""
    model = problem(Arm(cells=CELLS, rib=RIB, framed=True), FITTED).model(effects)
    loaded = at_rest(model.put(values).case, HeldLoad(1e-4 * mbar))
    if not loaded.converged:
        return float("nan")
    found = modes(loaded, count=2)
    return float(found.frequency[~found.sideways][0])


def table() -> list[dict[str, Any]]:
    """A row a recording: mbar, measured Hz with its sd, of each fit Hz and the modulus that it asks for."""
    fits = json.loads((ROOT / "benchmarks/results/real_arm.json").read_text())["rows"]
    out = []
    for mbar in SHOWN:
        seen, row = measured(mbar), {}
        for name in SOME:
            values = fits[name]["values"]
            f, young = foretold(FITS[name].effects, values, mbar), 6 * (values["C10"] + values["C01"])
            row[name] = {"Hz": f, "modulus": (seen.frequency / f) ** 2 * young / BEAM_E}
        found = {"Hz": seen.frequency, "sd": seen.frequency_sd, "damping": seen.damping}
        out.append({"mbar": mbar, **found, **row})
    return out


def main() -> int:
    """Print the table of docs/records/real-arm.md."""
    typed = options(__doc__, json="one JSON line")
    if not DATA.is_dir():
        print("real recordings are absent: set SOFTTWIN_DATA", file=sys.stderr)
        return 1
    rows = table()
    if typed.json:
        print(json.dumps({"rows": rows}))
        return 0
    print(f"| mbar | measured Hz | damping ratio | {' | '.join(f'{n}: Hz, modulus' for n in SOME)} |")
    print("|---|---|---|" + "---|" * len(SOME))
    for r in rows:
        cells = " | ".join(f"{r[n]['Hz']:.2f}, {r[n]['modulus']:.2f}" for n in SOME)
        print(f"| {r['mbar']} | {r['Hz']:.2f} ± {r['sd']:.2f} | {r['damping']:.3f} | {cells} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
