"""twin.toml: what is written reads back, and every mistake gives one sentence."""

import ast
import dataclasses
import time
import tomllib
from pathlib import Path
from typing import get_args

import pytest

from twin.bodies.kinds import BODIES
from twin.commands.init import film_config
from twin.marktables import PointTable
from twin.project import config as config_module
from twin.project import toml
from twin.project.cameratables import BoardTable
from twin.project.config import Config, StudyTable, TableModel
from twin.project.folder import Project, dataset
from twin.project.toml import dump, parse, with_effects
from vision import Board

IMPORT = '[import]\nfile = "raw/a.csv"\nformat = "csv"\n'
ROOT = Path(__file__).resolve().parents[3]

TEXT = """
[model]
effects = []  # mine
# a comment of mine
[[points]]
name = "tip"
node = 4401
[[points]]
name = "middle"
node = 5848
"""


def read(text: str) -> Config:
    return parse(text.encode(), name="twin.toml")


def film(old: str, new: str) -> str:
    text = dump(film_config("batch"))
    assert old in text
    return text.replace(old, new, 1)


def test_defaults_are_the_studys():
    calibrate = read(TEXT).calibrate
    assert (calibrate.population, calibrate.generations) == (30, 20)
    assert calibrate.bounds == {}
    assert (calibrate.objective_points, calibrate.objective_component) == (("tip", "middle"), 3)


@pytest.mark.parametrize(
    "config",
    [
        film_config("batch-07"),
        Config(
            points=(PointTable(name="tip", node=1), PointTable(name="middle", node=2, position_mm=(1, 2, 3)))
        ),
        read(TEXT).model_copy(update={"study": StudyTable(other_pressure_MPa=0.01)}),
        read(TEXT + IMPORT + "sd_mm = 0.1\n"),
    ],
    ids=["film", "targets", "study", "import"],
)
def test_dump_reads_back(config):
    assert read(dump(config)) == config


def test_dump_is_complete_and_says_units():
    text = dump(film_config("batch"))
    for key in (
        "film_start_s",
        "# static_start_s",
        "max_rms_px",
        "time_shift_s",
        "placement_sd_mm",
        "candidates",
    ):
        assert f"\n{key} = " in text
    assert "mm" in next(line for line in text.splitlines() if line.startswith("square_mm"))
    assert text.count("ArUco id") == 2  # commented once in each array of tables


def test_a_config_is_frozen():
    with pytest.raises(ValueError, match="frozen"):
        read(TEXT).model.mesh = 2  # type: ignore[misc]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("= nothing", "not valid TOML"),
        (TEXT.replace("effects", "efects"), "model.efects is not a known key; did you mean 'effects'?"),
        (TEXT.replace("[model]", "[modle]"), "modle is not a known key; did you mean 'model'?"),
        (
            TEXT.replace("[model]", "[model]\nmesh = 0"),
            "model.mesh = 0: it should be greater than or equal to 1",
        ),
        (TEXT.replace("[model]", '[model]\nmesh = "2"'), "model.mesh = '2': it should be a valid integer"),
        (TEXT.replace("[model]", "[model]\nmesh = true"), "model.mesh = True: it should be a valid integer"),
        (TEXT.replace("node = 5848", ""), "points.middle: where it is on the finger is not stated; wanted position_mm"),
        (TEXT.replace("name = \"middle\"", ""), r"points\[2\].name is missing \(name in targets and reports\); add it"),
        (
            TEXT.replace("node = 5848", "position_mm = [1.0, 2.0, 0.0]").replace("node = 4401", "position_mm = [1.0, 2.0, 0.0]"),
            r"position_mm = '\[1.0, 2.0, 0.0\]' stands twice",
        ),
        (
            TEXT.replace("[model]", '[model]\ndeck = "raw/a.inp"') + "[model.finger]\nlength_mm = 90.0\n",
            r"model.deck = 'raw/a.inp' and \[model.finger\] are both given",
        ),
        (TEXT.replace("node = 5848", "node = 4401"), "node = 4401 stands twice"),
        (TEXT.replace("middle", "tip"), "name = 'tip' stands twice"),
        (
            TEXT.replace("middle", "centre") + '[calibrate]\nobjective_points = ["middle"]\n',
            "objective_points = 'middle': wanted a name in .*tip, centre",
        ),
        (TEXT.replace("[]", '["Creep 2"]'), "model.effects.*'Creep 2'.*creep:2"),
        (TEXT.replace("[]", '["creep", "creep:2"]'), "an effect stands twice"),
        (
            TEXT + "[calibrate.bounds]\nC10 = [0.5, 0.1]",
            r"calibrate.bounds.C10 = \[0.5, 0.1\]: wanted low < high",
        ),
        (TEXT + "[calibrate.bounds]\nc10 = [0.1, 0.5]", "calibrate.bounds.c10: wanted C10 and C01 alone"),
        (TEXT + "[calibrate.bounds]\nC10 = [10.0, 500.0]", "wanted MPa, up to 100; .* are they in kPa"),
        (TEXT + "[calibrate.bounds]\nC10 = [-0.5, 0.5]", r"C10 \+ C01 may be as low as -0.5 MPa"),
        (TEXT.replace("[model]", "[model]\ndensity_kg_m3 = 1.07"), "model.density_kg_m3 = 1.07: wanted .* kg/m3.* is it in g/cm3"),
        (TEXT.replace("[model]", "[model]\ndensity_kg_m3 = 1.07e-9"), "density of the silicone in kg/m3, such as 1070.0$"),
        (film("scale_sd = 0.001", "scale_sd = 2.0"), "measure.scale_sd = 2.0: wanted a share"),
        (film("placement_sd_mm = 0.3", "placement_sd_mm = 300.0"), "measure.placement_sd_mm = 300.0: wanted an sd in mm"),
        (
            TEXT + "[calibrate.bounds]\nC10 = [0.1, nan]",
            "calibrate.bounds.C10.2. = nan: it should be a finite number",
        ),
        (
            TEXT.replace("[model]", "[model]\nfixed = {C10 = 0.7}"),
            r"model.fixed.C10 = 0.7: wanted a value within calibrate.bounds.C10 = \[0.01, 0.5\]",
        ),
        (
            film('"raw/film.mp4"', '"/data/film.mp4"'),
            r"cameras\[1\].film = '/data/film.mp4': wanted a path relative",
        ),
        (film('"raw/film.mp4"', '"C:/film.mp4"'), "wanted a path relative"),
        (film("marker_mm = 11.0", "marker_mm = 16.0"), "marker_mm = 16: wanted less than square_mm = 15 mm"),
        (dump(film_config("batch")) + IMPORT, r"\[import\] and \[\[cameras\]\]"),
        (TEXT + IMPORT + "sd_m = 0.1", "import.sd_m is not a known key; did you mean 'sd_mm'"),
        (TEXT + IMPORT + "rest_steps = 0", r"import.rest_steps = 0: .* 1 \(number of first steps"),
        (TEXT + IMPORT + "min_likelihood = 1.5", "import.min_likelihood = 1.5: "),
        (TEXT + IMPORT.replace('"csv"', '"sleap"'), "import.format = 'sleap': .*'dice'"),
        (TEXT + IMPORT.replace("import", "imported"), "imported is not a known key; did you mean 'import'"),
        (film('role = "fixed"', 'role = "frame"'), "frame.markers: 3 with role 'fixed', wanted 4 or more"),
        (film("size_mm = 6.0", "# size_mm"), "points.tip.size_mm is missing"),
        (film("size_mm = 8.0", "# size_mm"), "frame.markers.R01.size_mm is missing"),
        (dump(film_config("batch").model_copy(update={"pressure": None})), "pressure is missing"),
    ],
)
def test_a_mistake_gives_one_sentence(text, sentence):
    with pytest.raises(ValueError, match=sentence) as caught:
        read(text)
    assert str(caught.value).startswith("twin.toml: ")
    assert "\n" not in str(caught.value)
    assert "pydantic" not in str(caught.value)


def test_several_mistakes_are_counted():
    with pytest.raises(ValueError, match=r"\(and 1 more\)"):
        read(TEXT.replace("[model]", "[model]\nmesh = 0\ndeck = ''"))


@pytest.mark.parametrize(
    "text",
    [TEXT, TEXT.replace("[model]", "[model]\nmesh = 2"),
     TEXT.replace("effects = []  # mine\n", ""), TEXT.replace('[]', '[\n "clamp",\n]'),
     TEXT.split("[[points]]")[1].join(["[[points]]", ""]) + '[[points]]\nname = "middle"\nnode = 2\n'],
    ids=["first line", "later line", "no line", "several lines", "no table"],
)  # fmt: skip
def test_effects_are_written_and_nothing_else(text):
    new = with_effects(text, ["creep:2"])
    assert read(new).model.effects == ("creep:2",)
    assert read(with_effects(new, [])) == read(with_effects(text, []))
    kept = [line for line in text.splitlines() if line.startswith("#")]
    assert all(line in new.splitlines() for line in kept)


@pytest.mark.parametrize(
    ("text", "new"),
    [
        ('[model]  # mine\neffects = ["a]b"]  # why\nmesh = 2 # fine\n', '[model]  # mine\neffects = ["creep"]  # why\nmesh = 2 # fine\n'),
        ("# top\r\n[model]\r\neffects = []\r\n", '# top\r\n[model]\r\neffects = ["creep"]\r\n'),
        ("model.mesh = 2\n", 'model.mesh = 2\nmodel.effects = ["creep"]\n'),
        ("model = {mesh = 2}\n", 'model = {mesh = 2,effects = ["creep"]}\n'),
    ],
)  # fmt: skip
def test_every_other_character_of_the_file_stays(text, new):
    assert with_effects(text, ["creep"]) == new


def test_an_edit_that_would_go_wrong_is_refused(monkeypatch):
    monkeypatch.setattr(toml.tomlkit, "dumps", lambda document: "[model]\nmesh = 3\n")
    with pytest.raises(ValueError, match="by hand"):
        with_effects("[model]\nmesh = 2\n", ["creep"])


def test_a_byte_order_mark_does_not_matter(tmp_path):
    (tmp_path / "twin.toml").write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    assert Project.open(tmp_path).config == read(TEXT)
    assert Project.open(tmp_path).set_effects(["creep"]).config.model.effects == ("creep",)


def test_keys_of_older_versions_change_nothing_and_are_named(tmp_path):
    (tmp_path / "twin.toml").write_text(TEXT.replace("[model]", '[model]\ngeometry = "x"\ntop_pressure_MPa = 0.1'))
    project = Project.open(tmp_path)
    assert project.config == read(TEXT)
    assert project.remarks == (
        "model.geometry, model.top_pressure_MPa in twin.toml change nothing: remove those lines.",
    )
    assert project.set_effects([]).remarks == project.remarks
    (tmp_path / "twin.toml").write_text(TEXT)
    assert Project.open(tmp_path).remarks == ()


TABLES = [t for t in vars(config_module).values() if isinstance(t, type) and issubclass(t, TableModel)]


@pytest.fixture(scope="module")
def read_keys():
    """Attributes in the code that has the configuration at hand, other than the configuration itself."""
    names = ("bodies", "project", "gauge", "coupons", "inputs", "formats", "bench", "study", "batches", "report", "commands")
    rooms = [path for room in names for path in (ROOT / "twin" / room).glob("*.py")]
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in rooms if path.name != "config.py"]
    return {node.attr for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


@pytest.mark.parametrize("table", [t for t in TABLES if t not in (TableModel, BoardTable)])
def test_every_key_is_read_somewhere(table, read_keys):
    tables = set(BODIES)  # read by the kind that twin.toml names
    assert [key for key in table.model_fields if key not in read_keys | tables] == []


def test_every_key_of_the_board_goes_to_a_kind_of_board():
    taken = {field.name for kind in Board.kinds().values() for field in dataclasses.fields(kind)}
    assert set(BoardTable.model_fields) <= {"kind", *taken}
    assert get_args(BoardTable.model_fields["kind"].annotation) == tuple(Board.kinds())


def test_the_study_says_its_second_pressure():
    config = parse((dataset("study") / "twin.toml").read_bytes(), name="twin.toml")
    assert config.study is not None
    top = Project.open(dataset("study")).targets().pressure.max()
    assert top / config.study.other_pressure_MPa == pytest.approx(3, rel=1e-12)
    assert tomllib.loads(dump(config)) == tomllib.loads((dataset("study") / "twin.toml").read_text())


@pytest.mark.parametrize("text", ["x = " + "[" * 100_000, "x = " + "{a = " * 50_000, "a." * 50_000 + "a = 1",
                                  '"a".' * 50_000 + "a = 1", "[" + "a." * 50_000 + "a]", "x = {" + "a." * 50_000 + "a = 1}"])  # fmt: skip
def test_brackets_and_keys_without_end_are_refused_at_once(text):
    start = time.monotonic()
    with pytest.raises(ValueError, match=r"too deeply|keys of at most 100 parts"):
        parse(text.encode(), name="twin.toml")
    assert time.monotonic() - start < 2.0  # the parser alone takes a minute for a key of 50,000 parts


def test_dots_in_texts_and_numbers_are_no_keys():
    long = "raw/" + ".".join("abcdefghijklmnopqrstuvwxyz") + ".mp4"
    assert "model.x is not a known key" in str(parse_error(f'[model]\ndeck = "{long}"\nx = [{", ".join(["0.5"] * 50)}]\n'))


def parse_error(text):
    with pytest.raises(ValueError, match=r"twin\.toml: ") as told:
        parse(text.encode(), name="twin.toml")
    return told.value


@pytest.mark.parametrize("name", ["+1", "-x", ".", "..", ".hidden", "=cmd", "@x", "a b", "", "a\\n", "ü"])
def test_a_name_is_no_formula_and_no_path(name):
    with pytest.raises(ValueError, match=r"points\[2\]\.name = .*wanted a name of the letters .*; rename it"):
        read(TEXT.replace('"middle"', f'"{name}"'))
    assert read(TEXT + '[[points]]\nname = "_p+1.-x"\nnode = 3\n').points[-1].name == "_p+1.-x"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (TEXT.replace("5848", "99999999999999999999999"), r"points\[2\].node = 9+: it should be less than or equal to 1000000000 \(label of the node"),
        (TEXT.replace("[model]", "[model]\nmesh = 64"), r"model.mesh = 64: it should be less than or equal to 8 \(mesh refinement: 2 halves all elements\)"),
        (TEXT.replace("[model]", "[model]\ngravity = [1e308, 0.0, 0.0]"), r"model.gravity\[1\] = 1e\+308: it should be less than or equal to 1000000"),
        (TEXT.replace("[model]", "[model]\ngravity = [1e-320, 0.0, 0.0]"), r"model.gravity = \[1e-320, 0.0, 0.0\]: wanted a direction, such as"),
        (TEXT.replace("[model]", "[model]\ngravity = [0.0, 0.0, 0.0]"), r"model.gravity = \[0.0, 0.0, 0.0\]: wanted a direction, such as"),
        (TEXT.replace("node = 5848", "position_mm = [1.0, -1e308, 0.0]"), r"points\[2\].position_mm\[2\] = -1e\+308: .* -1000000 \(its centre without load, mm"),
        (TEXT.replace("node = 5848", "node = 5848\nsize_mm = 1e308"), r"points\[2\].size_mm = 1e\+308: it should be less than or equal to 1000000000 .* mm"),
        (TEXT.replace("node = 5848", "node = 5848\nmarker = 10000000"), r"points\[2\].marker = 10000000: it should be less"),
        (TEXT + "[calibrate]\npopulation = 9223372036854775807", r"calibrate.population = 9223372036854775807: .* 10000 \(number of candidates"),
        (TEXT + "[calibrate]\ngenerations = 9223372036854775807", "calibrate.generations = .*: it should be less"),
        (TEXT + f"[model.finger]\npleats = 1{'0' * 400}", "model.finger.pleats = 10.*: it should be less"),
        (film("columns = 9", "columns = 1000000"), "cameras.*.board.columns = 1000000: it should be less"),
    ],
)
def test_a_number_beyond_any_finger_is_refused_where_it_is_read(text, sentence):
    with pytest.raises(ValueError, match=sentence):
        read(text)
