"""From a table to a calibrated model without a folder: `twin.read_table`, `calibrate`, `predict`, `add`, `drop`."""

from collections.abc import Callable

import numpy as np
import pandas
import pytest

import fe
import twin
from twin.calibrated.calibration import Calibration
from twin.targets import PointKind

PLACES = {"tip": (43.3, 11.5, 0.0), "middle": (20.6, 11.5, 0.0)}
HIDDEN, SD = {"C10": 0.214, "C01": 0.083}, 0.02  # MPa, mm
WIDE = pandas.DataFrame({"time_s": [0, 1, 2], "p [kPa]": [0, 10, 20], "tip_x_mm": [0, -0.4, -1.7], "tip_z_mm": [0, -6, -13]})
LONG = pandas.DataFrame({"time_s": [0, 1, 2], "pressure_kPa": [0, 10, 20], "point": "tip", "u1_mm": [0, -0.4, -1.7], "u3_mm": [0, -6, -13]})


@pytest.mark.parametrize("frame", [WIDE, LONG], ids=["wide", "long"])
def test_a_table_has_a_row_a_step_or_a_row_a_point(frame: pandas.DataFrame, tmp_path) -> None:
    frame.to_csv(tmp_path / "tip.csv", index=False)
    for source in (frame, tmp_path / "tip.csv"):
        data = twin.read_table(source, points={"tip": (110, 11.5, 0)}, sd_mm=0.05)
        assert data.points[0].kind is PointKind.PLACE
        assert data.pressure == pytest.approx([0, 0.01, 0.02])  # MPa
        assert data.value[:, 0, [0, 2]] == pytest.approx(np.array([[0, 0], [-0.4, -6], [-1.7, -13]]))
        assert np.isnan(data.value[:, 0, 1]).all()
        assert data.noise is not None
        assert data.noise.sd[0, 0] == 0.05


def test_a_table_of_targets_is_read_again() -> None:
    data = twin.read_table(WIDE, points={"tip": 4401}, sd_mm=0.05)
    again = twin.read_table(data.to_pandas(), points={"tip": 4401}, sd_mm=0.05)
    np.testing.assert_allclose(again.value, data.value)
    assert again.points[0].node == 4401


@pytest.mark.parametrize(
    ("source", "points", "told"),
    [
        ("nowhere.csv", {"tip": 1}, "nowhere.csv"),
        (WIDE, {"middle": 1}, "middle"),
        (WIDE.drop(columns="p [kPa]"), {"tip": 1}, "pressure"),
        (WIDE.rename(columns={"tip_z_mm": "tip_z_cm"}), {"tip": 1}, "unit"),
        (pandas.concat([LONG, LONG]), {"tip": 1}, "twice"),
    ],
)
def test_a_wrong_table_is_named(source: object, points: dict[str, int], told: str) -> None:
    with pytest.raises(ValueError, match=told) as error:
        twin.read_table(source, points=points, sd_mm=0.05)  # type: ignore[arg-type]
    assert "/tmp" not in str(error.value)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: twin.finger(lenght_mm=92), "length_mm"),
        (lambda: twin.tube(fixed={"C11": 1.0}), "C10"),
        (lambda: twin.finger(law="rubber"), "rubber"),
        (lambda: twin.deck("nowhere.inp"), "nowhere.inp"),
    ],
)
def test_a_wrong_actuator_is_named(make: Callable[[], object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        make()


@pytest.fixture(scope="module")
def fit() -> Calibration:
    """Fit of data that another mesh made, with noise."""
    shape = fe.Finger(length=43.3, bellows=3, tip_node=PLACES["tip"], middle_node=PLACES["middle"])
    other = fe.Lattice(per_bellow=2, centred=False)
    time, pressure = np.arange(6.0), np.array([0.0, 0.0, 0.01, 0.02, 0.03, 0.015])
    case = fe.finger_case(fe.Material(**HIDDEN), finger=shape, lattice=other)
    u = fe.solve(case, fe.Path(time, pressure, time)).at(np.array([*PLACES.values()]))
    u += SD * np.random.default_rng(2).standard_normal(u.shape)
    columns = {f"{n}_{a}_mm": u[:, p, i] for p, n in enumerate(PLACES) for i, a in ((0, "x"), (2, "z"))}
    frame = pandas.DataFrame({"time_s": time, "pressure_MPa": pressure} | columns)
    data = twin.read_table(frame, points=PLACES, sd_mm=SD, rest_steps=2)
    coarse = fe.Lattice(per_bellow=2, ring=False, centred=False)
    return twin.calibrate(twin.finger(length_mm=43.3, pleats=3, lattice=coarse, mesh_error=False), data)


@pytest.mark.slow
def test_a_fit_holds_the_hidden_constants(fit: Calibration) -> None:
    table = fit.to_pandas().set_index("parameter")
    total = table.value["C10"] + table.value["C01"]
    assert total == pytest.approx(sum(HIDDEN.values()), rel=0.02)  # the meshes differ by about 1 %
    assert "C10" in str(fit)
    assert "C01" in fit._repr_html_()
    assert set(fit.compare().to_pandas()["by"]) >= {"marker", "direction"}
    assert len(fit.plot().axes) == 2


@pytest.mark.slow
def test_a_fit_predicts_and_profiles(fit: Calibration) -> None:
    row = fit.predict("20kPa", at=["tip"]).to_pandas().iloc[0]
    measured = fit.problem.targets.value[3, 0, 2]  # at 20 kPa
    assert row["u3_mm"] == pytest.approx(measured, abs=6 * SD)
    assert fit.profile("C10").name == "C10"
    with pytest.raises(ValueError, match="C10"):
        fit.profile("C11")
    with pytest.raises(ValueError, match="unit"):
        fit.predict("20")


@pytest.mark.slow
def test_an_effect_is_added_and_dropped(fit: Calibration) -> None:
    more = fit.add("pressure_offset")
    assert more.problem.labels == ("pressure_offset",)
    assert "pressure_offset.offset" in more.values
    assert more.drop("pressure_offset").values == pytest.approx(fit.values, rel=0.05)
    with pytest.raises(ValueError, match="creep"):
        fit.drop("creep")
