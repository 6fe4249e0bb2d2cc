"""Rows as aligned lines, as CSV and back, and as a DataFrame."""

from pathlib import Path

import pandas as pd

from twin.table import DataTable

TABLE = DataTable(("point", "u3_mm", "beyond"), [("1", -12.345678, False), ("tip, left", None, True)])


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(TABLE.csv(digits=4), encoding="utf-8")
    assert path.read_text(encoding="utf-8").splitlines() == ["point,u3_mm,beyond", "1,-12.35,false", '"tip, left",,true']
    again = DataTable.read(path, text=("point",))
    assert again.records == [{"point": "1", "u3_mm": -12.35, "beyond": False}, {"point": "tip, left", "u3_mm": None, "beyond": True}]
    assert DataTable.read(path).rows[0][0] == 1.0
    assert "-12.345678" in TABLE.csv(digits=None)


def test_columns_stand_below_each_other() -> None:
    lines = TABLE.lines("<>")
    assert len({line.index("u3_mm") + len("u3_mm") if k == 0 else line.index("-12.345678") + len("-12.345678") for k, line in enumerate(lines[:2])}) == 1
    assert [line.split()[-1] for line in lines] == ["beyond", "false", "true"]
    assert len(set(map(len, lines))) == 1  # the last column ends at the right


def test_a_dataframe_has_every_column_without_rows_too() -> None:
    assert list(DataTable(("a", "b"), []).to_pandas().columns) == ["a", "b"]
    assert isinstance(TABLE.to_pandas(), pd.DataFrame)
    assert TABLE.to_pandas()["beyond"].tolist() == [False, True]
