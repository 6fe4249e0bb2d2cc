"""What `twin diagnose` says where it should name nothing: no hidden effect, and one outside its library.

    python benchmarks/controls.py [--seeds 20] [--only null|tube] [--library]

null: the truth is the bare material -> `none needed`. tube: a supply tube pulls the tip up all the time,
which no effect of the library can do -> `none of these`, and the base error must be at least three times the
noise. The candidates are those of a new project, with --library all effects. Each truth is solved once, a few
minutes. The exit code is 1 where fewer than 19 of 20 draws are right.
"""

import argparse
import sys

import _first  # noqa: F401
from trials import CANDIDATES, Laboratory, report

from fe import Material
from twin import virtual
from twin.diagnosis.verdicts import Diagnosis
from twin.effects.library import all_effects

MATERIAL = Material(0.214, 0.083)
TUBE_N = 0.02  # upward on the whole tip face: soft as the finger is, its base error is six noise sds
CLEAR = 3.0  # base error over noise that makes a wrong model plain


def none_needed(said: Diagnosis) -> bool:
    """Whether the verdict is that nothing is missing."""
    return said.verdict == "none needed"


def none_of_these(said: Diagnosis) -> bool:
    """Whether a plain error is there and nothing of the library is named for it."""
    plain = said.base is not None and said.base.rms_mm >= CLEAR * said.base.noise_sd_mm
    return plain and said.verdict == "none of these" and not said.named


CONTROLS = {
    "null": (virtual.Truth(MATERIAL), none_needed),
    "tube": (virtual.Truth(MATERIAL, tip_force=(0.0, 0.0, TUBE_N)), none_of_these),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="draws of each control")
    parser.add_argument("--only", choices=sorted(CONTROLS), help="one control instead of all")
    parser.add_argument("--library", action="store_true", help="try every effect that there is")
    options = parser.parse_args()
    if options.seeds < 1:
        parser.error(f"--seeds {options.seeds}: wanted one or more")
    bench, good, effects = virtual.Bench(), True, all_effects() if options.library else CANDIDATES
    for name in [options.only] if options.only else CONTROLS:
        truth, right = CONTROLS[name]
        good &= report(name, Laboratory.of(truth, bench), options.seeds, right=right, effects=effects)[0]
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
