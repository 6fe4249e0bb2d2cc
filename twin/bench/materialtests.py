"""What a fit says of the tests of the silicone itself, in words and as a picture."""

from collections.abc import Iterator, Sequence

from twin.coupons.pulltest import PullTest
from twin.judging.fitrecord import MaterialTestRow, MaterialTestsRow
from twin.project.folder import Run

PICTURE = "material-tests.png"


def told_of_tests(tests: Sequence[PullTest], found: MaterialTestsRow | None) -> Iterator[str]:
    """What is to be said of the tests that a fit has taken, a sentence each; nothing without them."""
    if found is None:
        return
    for test in tests:
        yield from test.remarks
    for row in found.tests:
        yield _row(row)
    yield found.sentence


def _row(row: MaterialTestRow) -> str:
    shared = ", ".join(f"{name} {size:+.1f} sd" for name, size in row.shared_sd.items())
    left = f"; {row.left_out} rows beyond are left out" if row.left_out else ""
    return (
        f"Material test {row.name}: {row.rms_MPa:.2g} MPa rms up to a stretch of {row.up_to:.2f} "
        f"({row.count} values{left}). Its chi2 is {row.chi2:.3g}; errors that all its values share: {shared}."
    )


def write_curves(run: Run, found: MaterialTestsRow | None) -> None:
    """Write material-tests.png into a run: measured and fitted nominal stress; nothing without tests."""
    if found is not None:
        from twin.drawing.fitplots import draw_curves

        run.write_bytes(PICTURE, draw_curves(found.tests))
