"""The film with the models over it, for report and talk: a still of the worst moment, and a clip."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from twin.drawing.painting import Image, still
from twin.project.folder import Project
from twin.review.filmed import Filmed

if TYPE_CHECKING:
    from vision import Video


@dataclass(frozen=True)
class Footage:
    """The film of a project, and the models as its camera would see them."""

    project: Project
    filmed: Filmed

    @property
    def film(self) -> "Video":
        """The film of the first camera."""
        from vision.film.series import open_film

        table = self.project.config.cameras[0]
        return open_film(self.project.path(table.film), fps=table.fps, mirrored=table.mirrored)

    @property
    def worst(self) -> bytes:
        """PNG of the film at the worst moment, with the models beside each other."""
        return still(self._frame(int(self.filmed.frame[self.filmed.worst])), self.filmed)

    @property
    def caption(self) -> str:
        """What is seen in it."""
        return (
            f"At {self.filmed.time_s[self.filmed.worst]:.1f} s of the film, when the model without effects "
            "is farthest off. Red arrows: from the model's marker to the film's, "
            f"{self.filmed.magnified} times as long. What many values share, such as a wrong scale, is in "
            "them, as it is in the errors above."
        )

    def clip(self, path: Path) -> str:
        """Write the clip; returns what is to be known of its speed, or nothing."""
        from twin.drawing.clip import write_clip

        speed = write_clip(path, self.film, self.filmed)
        return f", {speed:.1f} times as fast as the film" if speed > 1 else ""

    def _frame(self, wanted: int) -> Image:
        """A frame of the film, (h,w,3)."""
        grey = next(picture for index, _, picture in self.film.frames() if index == wanted)
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
