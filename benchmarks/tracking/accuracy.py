"""How near vision comes to the physical limit, and whether its stated uncertainty is right.

    python benchmarks/tracking/accuracy.py [--quick] [--json] [--only PART ...]

Runs the parts below, each a script of this folder that prints its own tables, and merges their figures. A
figure whose real data is not there ($SOFTTWIN_DATA, else ../shared/data) is null, and a line says so.
"""

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import parts

# Each part is a module of this folder with `figures(quick: bool) -> dict[str, Any]`: at least these keys,
# None for one whose data is absent.
PARTS = {
    "markers": ("crb_ratio", "registration_pull_sd", "fps_1080p_28_markers"),
    "dots": ("dot_rms_px", "dot_pull_sd", "dots_found"),
    "camera": ("camera_pull_sd", "camera_left_rms_px", "camera_right_rms_px", "gboriginal_rms_px"),
    "photos": ("photo_pull", "photo_pulls"),
    "budget": ("pull_sd",),
    "stereo": ("stereo_mean_mm", "stereo_pull_sd"),
    "dic": ("dic_bias_px", "dic_sd_px"),
}


def figures_of(part: str) -> Callable[[bool], dict[str, Any]]:
    """What makes the figures of a part, None where there is no data for them."""

    def figures(quick: bool) -> dict[str, Any]:
        module = importlib.import_module(f"benchmarks.tracking.{part}")
        found: dict[str, Any] = dict.fromkeys(PARTS[part]) | module.figures(quick)
        for key in PARTS[part]:
            if found[key] is None:
                print(f"{part}: {key} is null, its data is absent (SOFTTWIN_DATA)")
        return found

    return figures


if __name__ == "__main__":
    sys.exit(parts(__doc__, {part: figures_of(part) for part in PARTS}, quick="under five minutes"))
