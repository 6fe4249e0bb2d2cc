"""How near vision comes to the physical limit, and whether its stated uncertainty is right.

    python benchmarks/tracking/accuracy.py [--quick] [--json] [--only PART ...]

Runs the parts below, each a script of this folder that prints its own tables, and merges their figures. A
figure whose real data is not there ($SOFTTWIN_DATA, else ../shared/data) is null, and a line says so.
"""

import argparse
import importlib
import json
import os
import sys
import time
from contextlib import redirect_stdout
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
import benchmarks  # noqa: F401

# Each part is a module of this folder with `figures(quick: bool) -> dict[str, Any]`: at least these keys,
# None for one whose data is absent. What it prints on the way goes to stderr.
PARTS = {
    "markers": ("crb_ratio", "registration_pull_sd", "fps_1080p_28_markers"),
    "dots": ("dot_rms_px", "dot_pull_sd", "dots_found"),
    "camera": ("camera_pull_sd", "camera_left_rms_px", "camera_right_rms_px", "gboriginal_rms_px"),
    "photos": ("photo_pull", "photo_film_pull"),
    "budget": ("pull_sd",),
    "stereo": ("stereo_mean_mm", "stereo_pull_sd"),
    "dic": ("dic_bias_px", "dic_sd_px"),
}


def collect(parts: list[str], quick: bool) -> dict[str, Any]:
    """Figures of the parts, None where there is no data for them."""
    found: dict[str, Any] = {}
    for part in parts:
        began, spent = time.perf_counter(), time.process_time()
        print(f"{part} ...", file=sys.stderr, flush=True)
        with redirect_stdout(sys.stderr):  # the tables: stdout holds the figures alone
            told = importlib.import_module(part).figures(quick)
        found |= dict.fromkeys(PARTS[part]) | told
        took, spent = time.perf_counter() - began, time.process_time() - spent
        print(f"{part}: {took:.0f} s, {spent:.0f} s of the processor", file=sys.stderr, flush=True)
        for key in PARTS[part]:
            if found[key] is None:
                print(f"{part}: {key} is null, its data is absent (SOFTTWIN_DATA)", file=sys.stderr)
    return found


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer draws: under five minutes")
    parser.add_argument("--json", action="store_true", help="one JSON line instead of the table")
    parser.add_argument("--only", nargs="+", choices=sorted(PARTS), default=list(PARTS), metavar="PART")
    options = parser.parse_args()
    found = collect(options.only, options.quick)
    if options.json:
        print(json.dumps(found))
        return 0
    print("| figure | measured |\n|---|---|")
    for key, value in found.items():
        print(f"| {key} | {f'{value:.4g}' if isinstance(value, float) else json.dumps(value)} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
