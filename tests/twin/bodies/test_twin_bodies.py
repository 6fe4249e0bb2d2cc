"""Every kind of body: its mesh has the shape that its dimensions say, and it moves as mechanics says."""

import re

from benchmarks.kernel.bodies import SILICONE, bar_against_beam, draws, measured, tube_against_lame

import numpy as np
import pytest
from pydantic import ValidationError

from fe import Case, Path, solve
from fe.deck.soundness import jacobians
from fe.mesh.finger import NAMED_NODES
from fe.mesh.mirror import mirrored, symmetry_support
from fe.mesh.points import nearest
from twin.bench.workbench import Workbench
from twin.bodies.kinds import BODIES
from twin.bodies.tube import TubeTable
from twin.commands.init import run_init
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Test
from twin.model.keptmodel import base_test
from twin.project.config import ModelTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.validation import checked

KINDS = list(BODIES)
OWN = [kind for kind in KINDS if kind != "finger"]


def half(kind: str, **dimensions: object) -> Case:
    body = BODIES[kind].model_validate(dimensions).body
    return body.case(body.lattice, SILICONE)


def volume(case: Case) -> float:
    return float((jacobians(case) * case.element.weights).sum())


def volumes() -> list[tuple[str, dict[str, object], float]]:
    """Dimensions, and the volume in mm3 of half of the body by elementary geometry."""
    chambers = 2 * 8.0 * 16.0 * (18.0 - 2.5) + (2 * 1.5 + 2.0) * 4.0 * 2.0  # and the channel between them
    outline = 20.0 * 20.0 * (10.0 + 2 * 8.0 + 5.0 + 5.0) - 2.0 * 20.0 * (20.0 - 6.5)
    tube = np.pi * 8.0**2 * 80.0 - np.pi * 5.5**2 * 70.0
    square = 16.0**2 * 80.0 - (11.0**2 - (4 - np.pi) * 1.5**2) * 70.0
    return [
        ("bar", {}, 100.0 * 30.0 * 30.0 / 2),
        ("pneunet", {"chambers": 2}, (outline - chambers) / 2),
        ("tube", {}, tube / 2),
        ("tube", {"section": "rectangular"}, square / 2),
    ]


@pytest.mark.parametrize(("kind", "dimensions", "wanted"), volumes())
def test_a_mesh_has_the_volume_of_its_dimensions(kind, dimensions, wanted):
    # arcs are parabolas over an angle a: off by about a^4 / 180, 2e-4 of a corner's and 1e-4 of all
    assert volume(half(kind, **dimensions)) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_body_promises_holds_on_every_lattice(kind):
    body = BODIES[kind]().body
    lattices = {"own": body.lattice, **body.finer(body.lattice)}
    counts, keys = {}, set()
    for name, lattice in lattices.items():
        case = body.case(lattice, SILICONE)
        counts[name] = len(case.nodes)
        keys.add(body.key(lattice))
        assert jacobians(case).min() > 0
        assert symmetry_support(case) is not None
        assert case.nodes[case.node_sets["clamp"], 0].max() < 1e-9
        assert (case.pressurised == "chamber") == (kind != "bar")
        assert "outside" in case.surfaces
        for label in NAMED_NODES.values():
            case.position(label)
    assert len(keys) == len(lattices)
    assert max(counts, key=lambda name: counts[name]) == "check"
    own = body.case(body.lattice, SILICONE)
    for at in map(np.array, body.places.values()):  # markers lie on the body
        assert np.linalg.norm(nearest(own, at) - at) < 0.05


def test_the_chamber_is_closed_but_for_the_plane_of_symmetry():
    """The flux of a constant field through the chamber of the whole body is 0 (Gauss)."""
    for kind in ("pneunet", "tube"):
        case = mirrored(half(kind))
        faces = case.nodes[case.face_nodes("chamber")]
        N, dN = case.element.on_face(case.element.face_points)
        s, t = np.einsum("fai,qak->kfqi", faces, dN)
        area = np.cross(s, t) * case.element.face_weights[:, None]
        assert np.abs(area.sum(axis=(0, 1))).max() < 1e-9 * np.abs(area).sum()
        assert -(area * np.einsum("qa,fai->fqi", N, faces)).sum() / 3 > 0  # normals point into the chamber


@pytest.mark.parametrize("kind", KINDS)
def test_random_dimensions_can_be_meshed_and_solved(kind):
    """A small part of `benchmarks/kernel/bodies.py`, which solves thirty of each kind."""
    table = next(iter(draws(kind, 1, seed=3)))
    body = table.body
    case = body.case(body.lattice, SILICONE)
    assert jacobians(case).min() > 0
    if kind == "bar":  # the others take longer
        row = measured(kind, table)
        assert row.reason == ""
        assert row.mesh_error < 0.05


def test_a_bar_sags_as_a_beam():
    # the clamp holds the section's width too, over about half a width of the length of 20 widths
    assert bar_against_beam() < 0.02


def test_a_tube_widens_as_a_thick_wall():
    assert tube_against_lame() < 0.01


def test_a_chamber_above_the_axis_bends_a_tube_down_and_below_it_up():
    ends = []
    for offset in (1.0, -1.0):
        body = BODIES["tube"].model_validate({"length_mm": 40.0, "offset_mm": offset}).body
        case = body.case(body.lattice, SILICONE)
        p = np.array([0.0, 0.01])
        tip = np.array([40.0, 0.0, 8.0])
        ends.append(float(solve(case, Path(np.arange(2.0), p, np.ones(1))).at(tip[None])[0, 0, 2]))
    assert ends[0] < -0.01
    assert ends[1] == pytest.approx(-ends[0], rel=1e-6)  # mirror images of each other


def test_wound_fibres_keep_a_tube_from_widening_and_not_from_lengthening():
    found = {}
    for fibre in (0.0, 50.0):
        body = BODIES["tube"].model_validate({"length_mm": 40.0, "offset_mm": 0.0, "fibre_N_per_mm": fibre}).body
        case = body.case(body.lattice, SILICONE)
        p = np.array([0.0, 0.005])
        points = np.array([[20.0, 8.0, 8.0], [40.0, 0.0, 8.0]])
        found[fibre] = solve(case, Path(np.arange(2.0), p, np.ones(1))).at(points)[0]
    assert found[50.0][0, 1] < 0.3 * found[0.0][0, 1]
    assert found[50.0][1, 0] > found[0.0][1, 0] > 0


WRONG = [
    ("pneunet", {"chamber_length_mm": 1.0}, "chamber_length_mm = 1.*wanted 1.5 mm of chamber or more"),
    ("pneunet", {"width_mm": 5.0}, "width_mm = 5: the chamber is 1 mm there.*side_wall_mm = 2 mm is thicker"),
    ("pneunet", {"height_mm": 9.0}, "height_mm = 9.*wanted 2 mm of chamber or more above the gaps"),
    ("pneunet", {"channel_width_mm": 16.0}, "channel_width_mm = 16: wanted less than the chambers' width of 16"),
    ("tube", {"chamber_width_mm": 15.9}, "chamber_width_mm = 15.9: it leaves 0.05 mm for the side walls"),
    ("tube", {"offset_mm": 2.4}, "chamber_height_mm = 11: it leaves 0.1 mm for the wall it is nearest to"),
    ("tube", {"length_mm": 12.0}, "length_mm = 12: the caps of 5 and 5 mm leave 2 mm for the chamber"),
    ("tube", {"section": "rectangular", "edge_radius_mm": 5.0}, "edge_radius_mm = 5: wanted 4.4 mm or less"),
    ("bar", {"length_mm": 10.0}, "length_mm = 10: shorter than its larger side of 30 mm"),
]


@pytest.mark.parametrize(("kind", "dimensions", "sentence"), WRONG)
def test_dimensions_that_do_not_fit_together_are_refused_in_one_sentence(kind, dimensions, sentence):
    with pytest.raises(ValidationError, match=f"model.{kind}.{sentence}"):
        BODIES[kind].model_validate(dimensions)


MIXED = [
    ({"body": "deck"}, 'model.body = .deck. and model.deck = None: wanted body = "deck" with the file'),
    ({"body": "tube", "pneunet": {}}, r"\[model.pneunet\] has the dimensions of another body than tube"),
    ({"deck": "raw/a.inp", "tube": {}}, r"model.deck = 'raw/a.inp' and \[model.tube\] are both given"),
    ({"body": "tub"}, "model.body"),
    ({"tube": {"length": 3.0}}, "tube.length is not a known key; did you mean 'length_mm'"),
]


@pytest.mark.parametrize(("table", "sentence"), MIXED)
def test_a_body_and_its_dimensions_go_together(table, sentence):
    with pytest.raises(ValueError, match=sentence.replace("model.body", "body") if "tub'" in str(table) else sentence):
        checked(ModelTable, table, name="twin.toml")


def test_the_kind_of_body_follows_from_what_is_stated():
    assert ModelTable().kind == "finger"
    assert checked(ModelTable, {"tube": {"length_mm": 90.0}}, name="x").kind == "tube"
    assert ModelTable(deck="raw/a.inp").kind == "deck"
    assert checked(ModelTable, {"body": "pneunet"}, name="x").dimensions == BODIES["pneunet"]()


@pytest.mark.parametrize("kind", OWN)
def test_every_effect_changes_every_body_or_says_that_it_has_no_chamber(kind):
    """At a step from null the maps give another test, or name what the body lacks."""
    case = half(kind)
    tip = case.position(NAMED_NODES["tip"])
    path = Path(np.linspace(0, 4, 9), np.linspace(0, 0.01, 9), np.array([0.0, 2.0, 4.0]), gravity=np.array([0, 0, -1.0]))
    test = Test(case, path, tip[None], np.array([True]))
    lacking: list[str] = []
    for one in all_effects():
        if one.breaks_symmetry(test):
            continue
        entry = one.tries(test)[0]
        theta = {p.name: entry.get(p.name, (p.null + p.step) if p.null is not None else (p.low + p.high) / 2)
                 for p in one.parameters}  # fmt: skip
        changed = one.before(test, theta).case
        if one.lacks(case):  # and so it changes nothing
            assert changed is case
            lacking.append(one.name)
    wanted = {"bar": {"wall_taper", "eccentric_core", "ballooning"}, "tube": {"strain_limiting_layer"}}
    assert set(lacking) == wanted.get(kind, set())


SINGLE = re.compile(r"(?:[a-z]+ )+([0-9.]+)")  # a text with one number


@pytest.mark.parametrize("kind", KINDS)
def test_an_arrow_is_as_long_as_it_says_and_lies_in_what_it_names(kind):
    body = BODIES[kind]().body
    case, sketch = body.case(body.lattice, SILICONE), body.sketch
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    checked_some = False
    for arrow in (*sketch.side, *sketch.along, *sketch.across):
        length = float(np.hypot(*np.subtract(arrow.end, arrow.start)))
        if found := SINGLE.fullmatch(arrow.text):
            checked_some = True
            assert float(found[1]) == pytest.approx(length, abs=0.005), arrow.text
    for arrow in sketch.along:
        at = np.mean([arrow.start, arrow.end], axis=0)
        assert (at >= low[[0, 2]] - 1e-9).all()
        assert (at <= high[[0, 2]] + 1e-9).all()
        if arrow.text.split()[0] in ("bottom", "top", "roof"):  # in the silicone, on the plane y = 0
            place = np.array([at[0], 0.0, at[1]])
            assert np.linalg.norm(nearest(case, place) - place) < 0.02, arrow.text
    assert checked_some


@pytest.mark.slow
def test_what_is_measured_of_a_tube_is_what_the_model_of_its_project_predicts(tmp_path, say, make_targets):
    """Targets of a finer lattice of the same tube, through `init` and the workbench."""
    body = TubeTable(length_mm=24.0, offset_mm=1.8).body
    at = body.case(body.lattice, SILICONE)
    places = np.array([at.position(NAMED_NODES[name]) for name in ("tip", "middle")])
    truth, plain = body.case(body.finer(body.lattice)["section"], SILICONE), make_targets()
    u = np.zeros_like(plain.value)
    u[:, :2] = solve(truth, base_test(plain, at).path, count=4).at(np.array([nearest(truth, x) for x in places]))
    write_targets(tmp_path / "t", make_targets(value=u - u[:2].mean(axis=0)))
    run_init(tmp_path / "p", say, targets=tmp_path / "t", body="tube:length_mm=24,offset_mm=1.8")
    bench = Workbench.of(Project.open(tmp_path / "p"))
    assert bench.structure.body == body
    assert bench.scales
    predicted = bench.model().predict(np.array([SILICONE.C10, SILICONE.C01]))
    moved = np.abs(bench.targets.value[:, 0]).max()
    assert moved > 0.05
    assert np.abs(predicted - bench.targets.value)[:, :2].max() < 0.05 * moved
    with pytest.raises(ValueError, match=r"'strain_limiting_layer': the model \(tube\) has no flat bottom"):
        bench.model(["strain_limiting_layer"])


def test_a_sheet_of_its_own_stays_beside_that_of_the_effect():
    case = half("pneunet", chambers=1, sheet_N_per_mm=10.0)
    test = Test(case, Path(np.arange(2.0), np.arange(2.0), np.ones(1)), case.nodes[:1], np.ones(1, bool))
    changed = effect("strain_limiting_layer").before(test, {"strain_limiting_layer.stiffness": 2.5}).case
    assert [sheet.stiffness for sheet in changed.sheets] == [10.0, 2.5]
    assert set(map(tuple, changed.surfaces[changed.layer.surface])) == set(map(tuple, case.surfaces["bottom"]))


def test_init_refuses_a_body_that_there_is_not_and_dimensions_that_do_not_fit(tmp_path, say):
    for given, sentence in (
        ({"body": "octopus"}, "--body octopus: wanted one of finger, pneunet, tube, bar"),
        ({"body": "tube:wall=2"}, "--body tube: wall is not a known key"),
        ({"body": "tube", "finger": ["length_mm=80"]}, "--finger length_mm=80: of a bellows finger"),
        ({"body": "bar:length_mm=1"}, "length_mm = 1: shorter than its larger side"),
        ({"body": "bar:length_mm"}, r"--body bar 'length_mm': wanted KEY=VALUE of \[model.bar\]"),
    ):
        with pytest.raises(ValueError, match=sentence):
            run_init(tmp_path / "x", say, **given)
        assert not (tmp_path / "x").exists()
    run_init(tmp_path / "y", say, body="pneunet:chambers=3")
    model = Project.open(tmp_path / "y").config.model
    assert (model.body, model.pneunet.chambers) == ("pneunet", 3)
    assert "# [model.finger]" not in (tmp_path / "y" / "twin.toml").read_text()
