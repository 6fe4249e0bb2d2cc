"""The agreement of a fit with tests of the silicone itself, in words and as a picture."""

from collections.abc import Iterator, Sequence

from twin.coupons.pulltest import PullTest
from twin.judging.fitrecord import MaterialTestRow, MaterialTestsRow
from twin.project.folder import Run

PICTURE = "material-tests.png"


def told_of_tests(tests: Sequence[PullTest], agreement: MaterialTestsRow | None) -> Iterator[str]:
    """Sentences on the tests of the silicone that a fit has used; none without tests."""
    if agreement is None:
        return
    for test in tests:
        yield from test.remarks
    for row in agreement.tests:
        yield _row(row)
    yield agreement.sentence


def _row(row: MaterialTestRow) -> str:
    shared = ", ".join(f"{name} {size:+.1f} sd" for name, size in row.shared_sd.items())
    left_out = f"; {row.left_out} rows beyond are left out" if row.left_out else ""
    return (
        f"Material test {row.name}: {row.rms_MPa:.2g} MPa rms up to a stretch of {row.up_to:.2f} "
        f"({row.count} values{left_out}). Its chi2 is {row.chi2:.3g}; errors that all its "
        f"values share: {shared}."
    )


def write_curves(run: Run, agreement: MaterialTestsRow | None) -> None:
    """Write material-tests.png into a run: measured and fitted nominal stress; nothing without tests."""
    if agreement is not None:
        from twin.drawing.fitplots import draw_curves

        run.write_bytes(PICTURE, draw_curves(agreement.tests))
