"""What no fit has seen, for the report: held-out films, their errors before and after, and a picture each."""

from typing import Any

from twin.drawing import plots
from twin.report.found import Story


def held_out_rows(story: Story) -> list[dict[str, Any]]:
    """The films that no fit has seen: error of the calibrated model and of that with effects."""
    before = story.json(("calibrate",), "comparison.json").get("held_out", [])
    after: dict[str, Any] = {row["film"]: row["after"] for row in story.diagnosis.get("held_out", [])}
    after |= {row["film"]: row for row in story.added.get("held_out", [])}
    return [_row(row, after.get(row["film"])) for row in before]


def held_out_pictures(story: Story) -> list[dict[str, Any]]:
    """A picture for each held-out film: its error before and after, and its noise."""
    return [_drawn(row) for row in held_out_rows(story)]


def _drawn(row: dict[str, Any]) -> dict[str, Any]:
    bars = [("calibrated", row["before_mm"])]
    bars += [("with effects", row["after_mm"])] if row["after_mm"] is not None else []
    drawing = plots.falling(bars, noise_mm=row["noise_mm"])
    caption = "No fit has seen this film."
    return {"title": row["film"], "caption": caption, "half": True, "svg": drawing, "place": "held_out"}


def _row(before: dict[str, Any], after: dict[str, Any] | None) -> dict[str, Any]:
    """One held-out film as the report shows it."""
    error = after["rms_mm"] if after else None
    return {
        "film": before["film"], "before_mm": before["rms_mm"], "after_mm": error,
        "ratio": before["rms_mm"] / error if error else None, "noise_mm": before["noise_sd_mm"],
    }  # fmt: skip
