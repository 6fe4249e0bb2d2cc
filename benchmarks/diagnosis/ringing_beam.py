"""A real silicone beam that falls and rings: does Young's modulus from the falls foretell its frequencies?

    SOFTTWIN_DATA=... python benchmarks/diagnosis/ringing_beam.py [--json]

The beam of `tests/fe/hungbeam.py`: 30 x 30 x 100 mm of Dragon Skin 10, own weight, 52 g and 101 g hung at its
tip. Its modulus is fitted to how far the tip falls, nothing else. Frequencies are those about the rest, the
hung mass fixed to the middle of the end face. Measured: the three markers of the tip, those of the base
taken off.
"""

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import Attached
from fe.dynamics.vibration import modes
from fe.element import Array
from tests.fe import hungbeam as real
from twin.ringing.freevibration import Ringing, ringing

HZ = 100.0  # of the recordings
QUIET = 20  # frames at the beginning, in which markers jump
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Foretold:
    """A recording: grams hung; the frequency in Hz that all falls foretell, with its sd, and that of its own
    fall alone; and what rings."""

    load: float
    frequency: float
    sd: float
    own: float
    seen: Ringing

    @property
    def apart(self) -> tuple[float, float]:
        """Relative differences to the measured frequency, without damping: from all falls, from its own."""
        undamped = self.seen.frequency / np.sqrt(1 - self.seen.damping**2)
        return self.frequency / undamped - 1, self.own / undamped - 1


def foretold(folder: Path, cells: tuple[int, int, int] = real.CELLS) -> tuple[float, list[Foretold]]:
    """Young's modulus in MPa from all three falls, and each recording."""
    case, data = real.beam(cells), real.measured(folder)
    fit = real.fitted(data, case, [0, 1, 2], (real.SILICONE,))
    C10, share = float(fit.theta[0]), float(np.sqrt(fit.covariance[0, 0]) / fit.theta[0])
    out = []
    for k, (load, name) in enumerate(real.FILES.items()):
        alone = float(real.fitted(data, case, [k], (real.SILICONE,)).theta[0])
        f, own = (frequency(case.with_material(C10=c), load) for c in (C10, alone))
        seen = ringing(*tip(folder / f"{name}.c3d"))
        out.append(Foretold(load, f, f * share / 2, own, seen))  # f ~ sqrt(C10)
    return 6 * C10, out


def frequency(case: Case, grams: float) -> float:
    """The lowest frequency in Hz up and down, about the rest under weight and load."""
    mass, down = 1e-6 * grams, np.array([0.0, 0.0, -real.G])
    held = HeldLoad(0.0, down, real.ENDS[:1], mass * down[None])
    found = modes(at_rest(case, held), count=2, attached=[Attached(real.ENDS[0], mass)] if grams else [])
    return float(found.frequency[~found.sideways][0])


def tip(path: Path) -> tuple[Array, Array]:
    """Times (t,) s and the tip's markers (t, 3, 3) mm, the base's rigid motion taken off."""
    import ezc3d

    every = 1e3 * np.moveaxis(ezc3d.c3d(str(path))["data"]["points"][:3], 0, 2)[..., [2, 1, 0]]
    x = np.swapaxes(every, 0, 1)[QUIET:] if every.shape[0] == 6 else every[QUIET:]
    base = x[-100:].mean(axis=0)
    return np.arange(len(x)) / HZ, np.array([real.settled(frame, base)[:3] for frame in x])


def main() -> int:
    """Print the table of docs/records/real-data.md."""
    typed = options(__doc__, json="one JSON line")
    folder = Path(os.environ.get("SOFTTWIN_DATA", DATA)) / "real_beam"
    if not folder.is_dir():
        print("real recordings are absent: set SOFTTWIN_DATA", file=sys.stderr)
        return 1
    young, rows = foretold(folder)
    told = {"young_MPa": young, "largest_apart": max(abs(r.apart[0]) for r in rows),
            "largest_apart_own": max(abs(r.apart[1]) for r in rows)}  # fmt: skip
    if typed.json:
        table = [[r.load, r.frequency, r.own, r.seen.frequency, r.seen.damping] for r in rows]
        print(json.dumps(told | {"rows": table}))
        return 0
    print(f"E from the falls: {young:.4f} MPa")
    print("| hung g | foretold Hz | apart | from its own | measured Hz | damping ratio | at mm | per mm |")
    print("|---|---|---|---|---|---|---|---|")
    for r in rows:
        s = r.seen
        print(f"| {r.load:g} | {r.frequency:.2f} ± {r.sd:.2f} | {100 * r.apart[0]:+.1f} % | {r.own:.2f}, "
              f"{100 * r.apart[1]:+.1f} % | {s.frequency:.2f} ± {s.frequency_sd:.2f} | "
              f"{s.damping:.3f} ± {s.damping_sd:.3f} | {s.amplitude:.1f} | "
              f"{s.frequency_slope:+.3f} Hz, {s.damping_slope:+.4f} |")  # fmt: skip
    for r in rows:
        for p in r.seen.pieces:
            print(f"{r.load:g} g, {p.time:.2f} s: {p.largest:.3g} mm, {p.frequency:.3f} Hz "
                  f"(sd {p.sd[0]:.3f}), damping {p.damping:.4f} (sd {p.sd[1]:.4f})")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
