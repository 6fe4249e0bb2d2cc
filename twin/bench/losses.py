"""Which stages know normal errors alone, and what to do where twin.toml states others."""

from twin.project.config import LEAST_SQUARES
from twin.project.folder import Project


def check_least_squares(project: Project, stage: str) -> None:
    """ValueError for a stage that weighs all values alike, where the fit does not."""
    loss = project.config.calibrate.loss
    if loss != LEAST_SQUARES:
        raise ValueError(
            f"calibrate.loss = {loss!r}: {stage} counts every value in full, gross errors too, and would "
            "take these for physics; take the values that fit.json names (down_weighted) out of the "
            f'targets, set loss = "{LEAST_SQUARES}" under [calibrate] and run twin calibrate again'
        )
