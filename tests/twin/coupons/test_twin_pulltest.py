"""What a tester wrote becomes a curve, whatever its units and form; and what a stranger gets wrong is named."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fe import Material
from fe.homogeneous import nominal_stress
from tests.messages import saying
from twin.coupons.pulltest import POINTS, PullTest, loading_branches, pull_tests
from twin.project.toml import dump, parse
from twin.targets import Array, MaterialCurve

RUBBER = Material(C10=0.2, C01=0.05)
STRAIN = np.linspace(0.0, 0.8, 161)
STRESS = nominal_stress(RUBBER, STRAIN, "uniaxial")
POINT = '[[points]]\nname = "{}"\nnode = {}\n'
PLAIN = {"name": "pull", "file": "raw/pull.csv", "kind": "uniaxial", "sd_MPa": 0.001, "scale_percent": 2.0}
Read = Callable[..., PullTest]


def table(header: str, *columns: Array, mark: str = ",", decimal: str = ".", above: str = "", below: str = "") -> str:
    rows = [mark.join(f"{x:.7g}".replace(".", decimal) for x in row) for row in zip(*columns)]
    return "\n".join([*([above] if above else []), header, *([below] if below else []), *rows]) + "\n"


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """`read(text, **keys)`: the test of a file with this text, as [[material_tests]] with these keys has it."""

    def made(text: str | bytes, **keys: object) -> PullTest:
        own = {key: value for key, value in {**PLAIN, **keys}.items() if value is not None}
        lines = [f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}" for key, value in own.items()]
        toml = POINT.format("tip", 1) + POINT.format("middle", 2) + "[[material_tests]]\n" + "\n".join(lines)
        (tmp_path / "raw").mkdir(exist_ok=True)
        (tmp_path / "raw/pull.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        return pull_tests(parse(toml.encode(), name="twin.toml").material_tests, tmp_path)[0]

    return made


L = 1 + STRAIN
FORMS: dict[str, tuple[str | bytes, dict[str, object]]] = {
    "plain": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {}),
    "Instron": (table('Time,Extension,Load,Tensile strain,Tensile stress', STRAIN, 33 * STRAIN, 18 * STRESS, 100 * STRAIN, STRESS, above="Specimen label,EF-1\nRate 1,450.00000,mm/min\n", below="(s),(mm),(N),(%),(MPa)"), {}),
    "Instron, force": (table('Time,Extension,Load', STRAIN, 33 * STRAIN, 18 * STRESS, below="(s),(mm),(N)"), {"area_mm2": 18.0, "length_mm": 33.0}),
    "Zwick": (table("Prüfzeit;Dehnung;Standardkraft", STRAIN, 100 * STRAIN, 18 * STRESS, mark=";", decimal=",", below="s;%;N").encode("cp1252"), {"area_mm2": 18.0}),
    "kilonewtons and centimetres": (table("crosshead_cm\tforce_kN", 3.3 * STRAIN, 0.018 * STRESS, mark="\t"), {"area_mm2": 18.0, "length_mm": 33.0}),
    "stretch, kPa": (table("stretch,P [kPa]", L, 1e3 * STRESS), {"stress": "P [kPa]"}),
    "true": (table("True strain;True stress (MPa)", np.log(L), STRESS * L, mark=";"), {"true_strain": True, "true_stress": True, "strain_unit": "1"}),
    "units in twin.toml": (table("a,b", 100 * STRAIN, 145.0377 * STRESS), {"strain": "a", "stress": "b", "strain_unit": "%", "stress_unit": "psi"}),
    "UTF-16": (table("Strain (mm/mm);Stress [N/mm2]", STRAIN, STRESS, mark=";").encode("utf-16"), {}),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_one_curve_is_read_from_every_form(read: Read, form: str) -> None:
    text, keys = FORMS[form]
    found = read(text, **keys)
    np.testing.assert_allclose(found.strain, STRAIN, atol=1e-6)  # seven digits are written
    np.testing.assert_allclose(found.stress, STRESS, atol=2e-6)
    assert found.remarks == ()
    assert re.search(r"shear modulus of 0\.(49|50)\d* MPa", found.sentence)


WRONG: dict[str, tuple[str, dict[str, object], str]] = {
    "no unit of strain": (table("Strain,Stress (MPa)", STRAIN, STRESS), {}, r"column 'Strain' has no unit of strain: wanted one of %, 1, .*strain_unit"),
    "two units": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"stress_unit": "kPa"}, "says MPa, stress_unit of twin.toml says kPa"),
    "a unit of something else": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"stress_unit": "N"}, "stress_unit = 'N': wanted a unit of stress"),
    "percent as a share": (table("a,Stress (MPa)", 100 * STRAIN, STRESS), {"strain": "a", "strain_unit": "1"}, "largest strain is 80 .*likely % read as a share"),
    "a share as percent": (table("Strain (%),Stress (MPa)", STRAIN, STRESS), {}, r"largest strain is 0.008 .*likely a share read as %"),
    "kPa as MPa": (table("Strain (%),Stress (MPa)", 100 * STRAIN, 1e3 * STRESS), {}, "shear modulus of 49. MPa.*likely kPa read as MPa"),
    "MPa as kPa": (table("Strain (%),Stress (kPa)", 100 * STRAIN, STRESS), {}, "likely MPa read as kPa"),
    "turned": (table("Strain (%),Stress (MPa)", 100 * STRAIN, -STRESS), {}, "wanted stress that rises with strain"),
    "true read as engineering": (table("True strain (1),Stress (MPa)".replace("(1)", "[mm/mm]"), np.log(L), STRESS), {}, "column 'True strain .*' seems to be true"),
    "engineering read as true": (table("Strain (%),Engineering stress (MPa)", 100 * STRAIN, STRESS), {"true_stress": True}, "seems to be over the size at rest"),
    "two columns": (table("Strain 1 (%),Strain 2 (%),Stress (MPa)", STRAIN, STRAIN, STRESS), {}, r"'Strain 1 \(%\)' and 'Strain 2 \(%\)' may all be meant; say which with strain"),
    "no header": (table("1,2", STRAIN, STRESS), {}, "no line has headings of strain or stretch and stress"),
    "not the named column": (table("Strain (%),Stress (MPa)", STRAIN, STRESS), {"stress": "P"}, "no line has headings of strain or stretch and 'P'"),
    "a word": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS) + "90,broken\n", {}, "line 163, column Stress .*'broken'"),
    "too few": (table("Strain (%),Stress (MPa)", np.array([0.0, 40.0]), np.array([0.0, 0.3])), {}, "1 values up to a stretch of 1.5; wanted 4 or more"),
    "thousands marks": ("Extension (um);Load (N)\n" + "".join(f"{330 * k:,};{0.05 * k:.3f}\n" for k in range(20)), {"length_mm": 33.0, "area_mm2": 12.0}, "',' seems to stand between thousands"),
    "a stretch called strain": (table("Strain (1),Stress (MPa)", L, STRESS), {}, "begins at a strain of 1, where the load is 0; wanted 0 at rest: is it a stretch"),
    "unloading alone": (table("Time (s),Strain (%),Stress (MPa)", 10 * STRAIN, 100 * STRAIN[::-1], STRESS[::-1]), {}, "its strain only falls, as in unloading"),
    "two faults": (table("Strain,Stress", STRAIN, STRESS), {}, "'Strain' has no unit .*; and column 'Stress' has no unit"),
    "no such cycle": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"cycle": 3}, "cycle = 3, but it has 1 loading branches"),
    "force without area": (table("Strain (%),Load (N)", 100 * STRAIN, STRESS), {"force": "Load (N)"}, "force without area_mm2; add area_mm2"),
    "stress and area": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"stress": "Stress (MPa)", "area_mm2": 18.0}, "stress and area_mm2 are both given"),
    "no errors": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"sd_MPa": None}, r"material_tests\[1\].sd_MPa is missing \(sd of one stress"),
    "no error of the area": (table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), {"scale_percent": None}, r"scale_percent is missing \(sd of an error that all its stresses share"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", WRONG)
def test_a_mistake_has_one_sentence(read: Read, mistake: str) -> None:
    text, keys, said = WRONG[mistake]
    with pytest.raises(ValueError, match=said) as error:
        read(text, **keys).curve(1.5)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there(read: Read) -> None:
    with pytest.raises(ValueError, match=saying("gone.csv", "CSV")):
        read("", file="raw/gone.csv")


def test_unloading_is_left_out_and_cycles_are_counted(read: Read) -> None:
    once = read(table("Strain (%),Stress (MPa)", 100 * np.append(STRAIN, STRAIN[::-1]), np.append(STRESS, 0.8 * STRESS[::-1])))
    np.testing.assert_allclose(once.stress, STRESS, atol=1e-6)
    assert "161 of 322 rows, those of unloading, are left out" in once.remarks[0]
    up = np.tile(np.append(STRAIN, STRAIN[::-1]), 3)
    soft = np.concatenate([k * np.append(STRESS, 0.7 * STRESS[::-1]) for k in (1.0, 0.9, 0.85)])
    text = table("Strain (%),Stress (MPa)", 100 * up, soft)
    assert "of 3 loading branches number 1 is used" in read(text).remarks[0]
    np.testing.assert_allclose(read(text, cycle=3).stress[-1], 0.85 * STRESS[-1], rtol=1e-6)


def test_noise_makes_no_branch_of_its_own() -> None:
    rng = np.random.default_rng(2)
    rise = np.linspace(0, 1, 400) + 0.005 * rng.standard_normal(400)
    assert len(loading_branches(rise)) == 1
    assert len(loading_branches(np.concatenate([rise, rise[::-1], rise]))) == 2
    assert loading_branches(np.linspace(1, 0, 50)) == []


def test_compression_and_shear_are_read(read: Read) -> None:
    pressed = -np.linspace(0, 0.4, 81)
    stress = nominal_stress(RUBBER, pressed, "uniaxial")
    for sign in (1.0, -1.0):
        found = read(table("Strain (%),Stress (MPa)", sign * 100 * pressed, sign * stress), kind="compression")
        np.testing.assert_allclose(found.stress, stress, atol=1e-6)
        assert found.curve().predicted(RUBBER) == pytest.approx(found.curve().stress, abs=1e-3)  # means of a bin
    sheared = read(table("Weg (mm);Kraft (N)", 2 * STRAIN, 400 * 0.5 * STRAIN, mark=";"), kind="shear", length_mm=2.0, area_mm2=400.0)
    assert sheared.curve().predicted(RUBBER) == pytest.approx(sheared.curve().stress, abs=1e-6)


def pulled(strain: Array = STRAIN, stress: Array = STRESS, *, head: str = "Extension (mm),Load (N)", first: float = 0.0) -> str:
    return table(head, first + 33 * strain, 12 * stress)


SIZE = {"length_mm": 33.0, "area_mm2": 12.0}
KEPT = STRAIN <= 0.4
FELL = np.where(KEPT, STRESS, 0.7 * STRESS)
TORN = np.where(KEPT, STRESS, 0.0)
COURSES: dict[str, tuple[str, str, Array]] = {
    "a position": (pulled(head="Position (mm),Load (N)", first=33.0), r"Position \(mm\) begins at 33 mm: a position", STRESS),
    "a crosshead": (pulled(head="Crosshead (mm),Load (N)", first=102.4), r"begins at 102\.4 mm: a position", STRESS),
    "an extension far from 0": (pulled(first=17.0), r"begins at 17 mm: a position", STRESS),
    "slip": (pulled(stress=FELL), r"falls by 29% at a strain of 40 % while the strain goes on: it slipped .* the 81 rows", STRESS[KEPT]),
    "a tear": (pulled(stress=TORN), r"falls by 100% at a strain of 40 % .* the specimen tore; the 81 rows", STRESS[KEPT]),
    "newest first": (pulled(STRAIN[::-1], STRESS[::-1]), "its rows stand newest first.* they are turned round", STRESS),
    "two specimens": ("Specimen 1\n" + pulled() + "\nSpecimen 2\n" + pulled(stress=1.1 * STRESS), r"2 specimens, whose headers are the lines 2, 166: number 1 is used", STRESS),
}  # fmt: skip


@pytest.mark.parametrize("course", COURSES)
def test_the_course_of_a_test_is_told_with_what_was_used(read: Read, course: str) -> None:
    text, told, stress = COURSES[course]
    found = read(text, **SIZE)
    assert re.search(told, " ".join(found.remarks))
    np.testing.assert_allclose(found.stress, stress, atol=2e-6)
    np.testing.assert_allclose(found.strain[[0, -1]], [0, STRAIN[len(stress) - 1]], atol=1e-6)


def test_another_specimen_is_taken_by_its_number(read: Read) -> None:
    text = COURSES["two specimens"][0]
    np.testing.assert_allclose(read(text, **SIZE, export_number=2).stress, 1.1 * STRESS, atol=2e-6)
    with pytest.raises(ValueError, match="stands there 2 times; wanted 3"):
        read(text, **SIZE, export_number=3)


def test_held_strains_are_told_and_give_either_curve(read: Read) -> None:
    steps = np.arange(0.1, 0.85, 0.1)
    instant = nominal_stress(RUBBER, steps, "uniaxial")
    relaxing = 1 - 0.15 * (1 - np.exp(-np.arange(20) / 4)) / (1 - np.exp(-19 / 4))
    text = table("Strain (%),Stress (MPa)", np.repeat(100 * steps, 20), np.outer(instant, relaxing).ravel())
    first = read(text)
    assert re.search(r"held 8 times, .* by up to 15% \(relaxation\): the beginning .* instant, is used; holds = .relaxed.", first.remarks[0])
    np.testing.assert_allclose(first.stress, instant, rtol=1e-6)
    assert first.time is None
    np.testing.assert_allclose(read(text, holds="relaxed").stress, 0.85 * instant, rtol=1e-6)
    ramp = np.append(STRAIN, np.full(40, STRAIN[-1]))  # one hold at the top of a ramp
    top = read(table("Strain (%),Stress (MPa)", 100 * ramp, np.append(STRESS, STRESS[-1] * np.linspace(1, 0.8, 40))))
    np.testing.assert_allclose(top.stress, STRESS, atol=1e-6)
    assert "held 1 times" in top.remarks[0]


def test_noise_is_neither_slip_nor_a_hold(read: Read) -> None:
    for seed in range(5):
        noise = 0.01 * STRESS[-1] * np.random.default_rng(seed).standard_normal(len(STRAIN))
        assert len(read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS + noise)).strain) >= 155
    odd = STRESS.copy()
    odd[90] = 0.0  # one row that the load cell dropped
    assert len(read(table("Strain (%),Stress (MPa)", 100 * STRAIN, odd)).strain) == len(STRAIN)


def test_a_preload_is_told(read: Read) -> None:
    found = read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS + 0.05))
    assert "MPa at no strain, 7% of the largest stress" in found.remarks[0]
    slack = read(table("Strain (%),Stress (MPa)", 100 * STRAIN + 10, STRESS))
    assert "a preload, a slack specimen" in slack.remarks[0]


def test_a_curve_stands_for_more_values_than_it_has(read: Read) -> None:
    curve = read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), sd_percent=3.0).curve(1.5)
    assert len(curve.strain) == POINTS
    assert curve.up_to == pytest.approx(1.5, abs=0.005)
    assert (curve.recorded, curve.left_out) == (161, 61)  # the first row, at rest, says nothing
    np.testing.assert_allclose(curve.stress, nominal_stress(RUBBER, curve.strain, "uniaxial"), atol=1e-4)  # of the mean strain: half a bin squared times the curvature
    np.testing.assert_allclose(curve.sd, np.hypot(0.001, 0.03 * curve.stress))
    assert read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), stretch_up_to=1.2).curve(1.5).up_to == pytest.approx(1.2)


def test_errors_that_all_values_share_are_whitened_together(read: Read) -> None:
    curve = read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS), zero_percent=1.0).curve()
    assert curve.mode_names == ("scale", "zero of the strain")
    np.testing.assert_allclose(curve.modes[0], 0.02 * curve.stress)
    ahead = nominal_stress(RUBBER, curve.strain + 0.01, "uniaxial") - curve.predicted(RUBBER)
    np.testing.assert_allclose(curve.modes[1][1:-1], ahead[1:-1], rtol=0.03)  # a slope by differences of 20 values
    rng, n = np.random.default_rng(3), len(curve.strain)
    drawn = rng.standard_normal((4000, n)) * curve.sd + rng.standard_normal((4000, 2)) @ curve.modes
    z = curve.whiten(drawn)
    np.testing.assert_allclose(z.T @ z / 4000, np.eye(n), atol=0.1)  # 4 sds of a covariance by 4000 draws: 0.09
    # a scale that is off by 2 sds is found, and costs 2^2 rather than 20 values of 40 sds
    z = curve.whiten(2 * curve.modes[0])
    assert z @ z == pytest.approx(4.0, rel=0.05)
    assert curve.shared(2 * curve.modes[0])[0] == pytest.approx(2.0, rel=0.05)


def test_a_curve_of_a_silicone_that_creeps_wants_its_times(read: Read) -> None:
    creeping = Material(C10=0.2, C01=0.05, prony=((0.2, 2.0),))
    time = 10 * STRAIN
    stress = nominal_stress(creeping, STRAIN[1:], "uniaxial", time=time[1:])
    text = table("Time (min),Strain (%),Stress (MPa)", (5 + time) / 60, 100 * STRAIN, np.append(0.0, stress))
    curve = read(text).curve()
    assert curve.time is not None
    np.testing.assert_allclose(curve.time, 10 * curve.strain, atol=0.01)
    np.testing.assert_allclose(curve.predicted(creeping), curve.stress, rtol=0.01)  # 20 values for 160
    for bare in (read(table("Strain (%),Stress (MPa)", 100 * STRAIN, STRESS)), read(text.replace("Time (min)", "Tame"))):
        with pytest.raises(ValueError, match=r"material_tests.pull: the model's silicone creeps.*rising times"):
            bare.curve().predicted(creeping)


def test_two_tests_want_two_names() -> None:
    text = POINT.format("tip", 1) + POINT.format("middle", 2)
    one = '[[material_tests]]\nname = "a"\nfile = "raw/a.csv"\nkind = "planar"\nsd_MPa = 0.1\nscale_percent = 1\n'
    with pytest.raises(ValueError, match="a name stands twice"):
        parse((text + one + one).encode(), name="twin.toml")
    config = parse((text + one).encode(), name="twin.toml")
    assert parse(dump(config).encode(), name="twin.toml") == config


@pytest.mark.parametrize("name", ["Ecoflex_00-30", "Dragon_Skin_20", "Dragon_Skin_30"])
def test_real_silicones_are_read_as_they_were_recorded(read: Read, shared_data: Any, name: str) -> None:
    data = (shared_data / "hyperelastic" / f"{name}.csv").read_bytes()
    keys: dict[str, object] = {"strain": "Engineering Strain", "stress": "Engineering Stress (MPa)", "strain_unit": "1"}
    curve: MaterialCurve = read(data, **keys).curve(1.7)
    # moduli at 100 % by the maker: 0.07, 0.34 and 0.59 MPa; secants at half of that are above in rubber
    stiff = {"Ecoflex_00-30": 0.07, "Dragon_Skin_20": 0.34, "Dragon_Skin_30": 0.59}[name]
    assert 0.3 * stiff < curve.stress[-1] < stiff
    true = read(data, strain="True Strain", stress="True Stress (MPa)", strain_unit="1", true_strain=True, true_stress=True)
    np.testing.assert_allclose(true.curve(1.7).stress[2:], curve.stress[2:], rtol=0.12)
