"""Paper in mm, to a PDF at true scale: rectangles, circles, lines and short texts in black and white."""

import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas

FONT = "DejaVuSans"  # ships with matplotlib; has Latin, Greek, Cyrillic and more letters
NON_ZERO = 1  # PDF's rule by which shapes that overlap are filled


def _font() -> TTFont:
    """The font, registered once; it is embedded in every PDF that uses it."""
    if FONT not in pdfmetrics.getRegisteredFontNames():
        path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{FONT}.ttf"
        pdfmetrics.registerFont(TTFont(FONT, str(path)))
    return pdfmetrics.getFont(FONT)


def text_width(text: str, size: float) -> float:
    """Width in mm of a line of text of a height in mm."""
    _font()
    return float(pdfmetrics.stringWidth(text, FONT, size))


def without_letters(text: str) -> str:
    """The characters of a text that the font cannot show."""
    glyphs = _font().face.charToGlyph
    return "".join(sorted({letter for letter in text if ord(letter) not in glyphs}))


class Paper:
    """Sheets under way; x to the right and y down, mm from the top left corner."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height, self.pages = width, height, 0
        self._buffer = io.BytesIO()
        # invariant: no date and no random id, the same sheets give the same bytes
        size = width * mm, height * mm
        self._canvas = Canvas(self._buffer, pagesize=size, invariant=1, initialFontName=_font().fontName)
        self._canvas.setViewerPreference("PrintScaling", "None")

    def new_page(self) -> None:
        """Begin a sheet."""
        if self.pages:
            self._canvas.showPage()
        self.pages += 1
        self._canvas.scale(mm, mm)
        self._canvas.setLineWidth(0.1)

    def shapes(
        self,
        rectangles: Iterable[Sequence[float]],
        circles: Iterable[Sequence[float]] = (),
        *,
        black: bool = True,
    ) -> None:
        """Fill rectangles (x, y, width, height) and circles (x, y, radius), as one path: no seams between."""
        path = self._canvas.beginPath()
        for x, y, w, h in rectangles:
            path.rect(x, self.height - y - h, w, h)
        for x, y, radius in circles:
            path.circle(x, self.height - y, radius)
        self._canvas.setFillGray(0 if black else 1)
        self._canvas.drawPath(path, stroke=0, fill=1, fillMode=NON_ZERO)

    def line(self, x1: float, y1: float, x2: float, y2: float) -> None:
        """Draw a straight black line, 0.1 mm wide."""
        self._canvas.line(x1, self.height - y1, x2, self.height - y2)

    def text(self, x: float, y: float, text: str, *, size: float = 2.6) -> None:
        """Write a line of text; `y` is its base line, `size` the height of the font, mm."""
        self._canvas.setFillGray(0)
        self._canvas.setFont(FONT, size)
        self._canvas.drawString(x, self.height - y, text)

    def pdf(self) -> bytes:
        """The PDF file of all sheets, which viewers are told not to scale when printing."""
        self._canvas.save()
        return self._buffer.getvalue()
