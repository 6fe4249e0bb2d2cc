"""Pages in mm in, a PDF at true scale out: rectangles, circles, lines and short texts in black and white."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

MM = 72.0 / 25.4  # PDF units
ARC = 0.26521648983954  # handle length of an eighth of a circle, 4/3 tan(pi/16), relative to its radius
COS = 0.70710678118655
ANSI = "cp1252"  # what the built-in font can show


class Page:
    """A page under way; x to the right and y down, mm from the top left corner."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self._parts: list[str] = []

    def shapes(
        self,
        rectangles: Iterable[Sequence[float]],
        circles: Iterable[Sequence[float]] = (),
        *,
        black: bool = True,
    ) -> None:
        """Fill rectangles (x, y, width, height) and circles (x, y, radius), as one path: no seams between."""
        parts = [f"{_n(x, self.height - y - h, w, h)} re" for x, y, w, h in rectangles]
        parts += [_circle(x, self.height - y, radius) for x, y, radius in circles]
        if parts:
            self._parts.append(f"{0 if black else 1} g\n" + "\n".join(parts) + "\nf")

    def line(self, x1: float, y1: float, x2: float, y2: float, *, width: float = 0.1) -> None:
        """Draw a straight black line."""
        start, end = _n(x1, self.height - y1), _n(x2, self.height - y2)
        self._parts.append(f"0 G {_n(width)} w {start} m {end} l S")

    def text(self, x: float, y: float, text: str, *, size: float = 2.6) -> None:
        """Write a line of text; `y` is its base line, `size` the height of the font, mm."""
        shown = text.encode(ANSI, errors="replace").decode(ANSI)
        shown = shown.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        self._parts.append(f"0 g BT /F1 {_n(size)} Tf {_n(x, self.height - y)} Td ({shown}) Tj ET")

    def content(self) -> bytes:
        """Return what PDF draws."""
        return "\n".join([f"{MM:.9f} 0 0 {MM:.9f} 0 0 cm", *self._parts]).encode(ANSI)


def pdf_bytes(pages: Sequence[Page]) -> bytes:
    """Return the PDF file (version 1.4) of the pages, which viewers are told not to scale when printing."""
    kids = " ".join(f"{4 + 2 * i} 0 R" for i in range(len(pages)))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    for i, page in enumerate(pages):
        content = page.content()
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {_n(page.width * MM, page.height * MM)}] "
            f"/Resources << /Font << /F1 3 0 R >> >> /Contents {5 + 2 * i} 0 R >>".encode()
        )
        objects.append(b"<< /Length %d >>\nstream\n%b\nendstream" % (len(content), content))
    return _file(objects)


def _file(objects: list[bytes]) -> bytes:
    data, offsets = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, 1):
        offsets.append(len(data))
        data += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    size = len(objects) + 1
    return (
        data
        + b"xref\n0 %d\n0000000000 65535 f \n%b" % (size, table)
        + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (size, len(data))
    )


def _circle(x: float, y: float, radius: float) -> str:
    """Return eight cubic arcs, right to 4e-6 of the radius."""
    ring = [(1, 0), (COS, COS), (0, 1), (-COS, COS), (-1, 0), (-COS, -COS), (0, -1), (COS, -COS), (1, 0)]
    path = [f"{_n(x + radius, y)} m"]
    for (a, b), (c, d) in pairwise(ring):
        handles = (a - ARC * b, b + ARC * a, c + ARC * d, d - ARC * c, c, d)
        moved = [(y if k % 2 else x) + radius * value for k, value in enumerate(handles)]
        path.append(f"{_n(*moved)} c")
    return " ".join([*path, "h"])


def _n(*numbers: float) -> str:
    return " ".join(f"{number:.5f}".rstrip("0").rstrip(".") for number in numbers)
