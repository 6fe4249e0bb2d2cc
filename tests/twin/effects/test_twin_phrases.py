"""Every effect tells what was found with its fitted values: size, unit and direction."""

import re

import pytest

from twin.effects.library import all_effects, effect
from twin.effects.phrases import at_ends, listed, number, pull
from twin.effects.protocol import Effect

TOLD = {
    "creep": ({"g1": 0.12, "tau1": 8.0}, "the silicone creeps: 12 % of its stiffness relaxes with 8 s"),
    "creep:2": (
        {"g1": 0.0321, "tau1": 2.03, "g2": 0.0078, "tau2": 13.2},
        "the silicone creeps: 3.2 % of its stiffness relaxes with 2 s, 0.78 % with 13 s",
    ),
    "creep:wide": (
        {f"w{k}": w for k, w in enumerate((0.0, 0.001, 0.02, 0.03, 0.0, -0.01, 0.0, 0.0), start=1)},
        "the silicone creeps: 4.1 % of its stiffness relaxes, 2 % with 1.4 s, 3 % with 3.2 s and -1 % with 16 s",
    ),
    "pressure_lag": ({"tau": 0.12}, "the pressure in the chamber lags 0.12 s behind the gauge (hose and orifice)"),
    "pressure_lag:wide": (
        {"w1": 0.0, "w2": 0.0, "w3": 0.5, "w4": 0.1, "w5": 0.0},
        "the pressure in the chamber is 0.32 s behind the gauge, by more than one delay",
    ),
    "inertia": (
        {"share": 1.02, "hz": 6.23, "damping": 0.064},
        "the finger swings at 6.2 Hz after a fast change of the pressure, with a damping ratio of 0.064",
    ),
    "inertia:2": (
        {"share": 0.95, "hz": 6.0, "damping": 0.03, "faster": 0.2, "drag": 0.15},
        "the finger swings at 6 Hz after a fast change of the pressure, with a damping ratio of 0.03 and 0.15 more for "
        "a swing over the whole range of the pressure",
    ),
    "stiffening": (
        {"C20": 0.005},
        "the silicone stiffens with strain, other than the Mooney-Rivlin law says, by 0.012 MPa of its shear "
        "modulus at a stretch of 1.5",
    ),
    "stiffening:2": (
        {"C20": -0.01, "C30": 0.001},
        "the silicone softens with strain, other than the Mooney-Rivlin law says, by 0.021 MPa of its shear "
        "modulus at a stretch of 1.5",
    ),
    "clamp": ({"compliance": 8e-4}, "the clamp turns by 0.8 mrad per N mm of moment on it"),
    "pressure_gain": ({"gain": 0.03}, "the pressure gauge reads too little: the pressure is 3 % higher"),
    "pressure_gain:wide": (
        {"offset": 1e-4, "gain": -0.02, "bend": 0.3, "turn": 0.0},
        "the pressure gauge is not straight: it reads 0.1 kPa too little at 0 kPa, 0.2 kPa too little at 10 kPa and "
        "2.2 kPa too little at 30 kPa",
    ),
    "pressure_offset": ({"offset": -5e-4}, "the pressure gauge reads 0.5 kPa too much"),
    "pressure_offset:wide": (
        {"offset": 2e-4, "slope": -5e-4, "bend": 0.0},
        "the zero of the pressure gauge drifts: it reads 0.2 kPa too little at first, 0.3 kPa too much a minute later",
    ),
    "gravity": ({"density": 1.05e-9}, "the finger bends under its own weight, of 1.05 g/cm3 more than in the model"),
    "camera_scale": ({"scale": -0.021}, "the picture's scale is wrong: lengths look 2.1 % too short"),
    "wall_taper": (
        {"mm": 0.3}, "the walls get 0.3 mm thicker from base to tip (the core was thinner at one end)",
    ),
    "wall_taper:wide": (
        {"c0": -0.1, "c1": 0.2, "c2": 0.0, "c3": 0.0, "c4": 0.0, "c5": 0.0},
        "the walls of the chamber are not as drawn: 0.3 mm thinner at its base and 0.1 mm thicker at its tip",
    ),
    "eccentric_core": ({"mm": 0.4}, "the core lies 0.4 mm too high (towards +z)"),
    "eccentric_core:wide": (
        {"c0": 0.1, "c1": -0.3, "c2": 0.0, "c3": 0.0},
        "the core lies 0.4 mm too high at its base and 0.2 mm too low at its tip",
    ),
    "eccentric_core_y": ({"mm": -0.25}, "the core lies 0.25 mm off the middle plane, towards -y"),
    "ballooning": (
        {"depth": 0.2, "place": 0.3, "width": 8.0},
        "the wall is 0.2 mm thinner at 0.3 of the chamber's length, over about 16 mm, and balloons there",
    ),
    "ballooning:wide": (
        {"d1": 0.0, "d2": 0.2, "d3": 0.1, "d4": 0.0, "d5": 0.0},
        "the wall is thinner along the chamber, by 0.2 mm at 0.3 and 0.1 mm at 0.5 of its length, and balloons there",
    ),
    "precurvature": ({"per_mm": -5e-4}, "the finger is curved without any load, up with a radius of 2000 mm"),
    "precurvature:wide": (
        {"c0": 5e-4, "c1": 5e-4, "c2": 0.0, "c3": 0.0},
        "the finger is curved without any load, not at all at the clamp and down with a radius of 1000 mm at the tip",
    ),
    "strain_limiting_layer": (
        {"stiffness": 0.52}, "a sheet in the bottom (fabric, paper, glue) of 0.52 N/mm keeps it from stretching",
    ),
    "hoop_reinforcement": (
        {"stiffness": 1.6}, "fibres or a sleeve of 1.6 N/mm around the body keep it from widening",
    ),
    "hoop_reinforcement:2": (
        {"stiffness": 1.6, "angle": 12.0},
        "fibres or a sleeve of 1.6 N/mm around the body at 12 degrees keep it from widening",
    ),
    "mullins": (
        {"softening": 0.15, "m": 2e-3},
        "the silicone is up to 15 % softer below the largest load it has carried (Mullins)",
    ),
    "mullins:2": (
        {"softening": 0.15, "m": 2e-3, "beta": 0.5},
        "the silicone is up to 15 % softer below the largest load it has carried (Mullins)",
    ),
    "compressibility": (
        {"excess": 0.02}, "the silicone changes its volume by 0.2 % under 100 kPa (bubbles, low bulk modulus)",
    ),
    "thermal": ({"rate": -2e-4}, "the silicone gets 1.2 % softer a minute (its temperature drifts)"),
    "thermal:wide": (
        {"a": 0.03, "b": 0.1, "c": 0.0},
        "the silicone gets 3 % stiffer in the first minute of the pressure log (its temperature drifts)",
    ),
    "contact": ({"stiffness": 0.2, "distance": 8.0}, "the finger touches a table 8 mm below it"),
    "contact:2": (
        {"stiffness": 0.2, "distance": -1.0, "friction": 0.3},
        "the finger touches a table 1 mm above its lowest point and rubs on it (friction 0.3)",
    ),
    "tube": (
        {"up": 0.12, "along": -0.001, "place": 0.8},
        "the supply line, or something else outside, pulls the finger with 0.12 N up, at 0.8 of its length",
    ),
    "tube:2": (
        {"up": -0.1, "along": 0.05, "place": 1.0, "up_per_MPa": 3.0, "along_per_MPa": 0.0},
        "the supply line, or something else outside, pulls the finger with 0.1 N down and 0.05 N towards the tip, "
        "and with 0.03 N up more per 10 kPa, at its tip",
    ),
    "tube:wide": (
        {**{f"{way}{per}{k}": 0.0 for k in (1, 2, 3) for way in ("along", "up") for per in ("", "_per_MPa")},
         "up1": 0.05, "up3": -0.2},
        "the supply line, or something else outside, pulls the finger with 0.05 N up at 0.4 of its length and 0.2 N "
        "down at its tip",
    ),
    "time_shift": ({"s": 0.2}, "the film shows everything 0.2 s later than the pressure log"),
    "camera_rotation": ({"angle": -0.0209}, "the picture is turned by 1.2 degrees, the tip down"),
    "camera_tilt": (
        {"aside": 0.035, "up": -0.0175},
        "the camera looks at the finger obliquely, by 2 degrees with the tip too far and by 1 degree with the top too "
        "near",
    ),
    "camera_breathing": (
        {"scale": -0.012},
        "the picture's scale changes with the motion: at its farthest, lengths look 1.2 % too short",
    ),
    "camera_breathing:2": (
        {"scale": -0.012, "square": 0.032},
        "the picture's scale changes with the motion: at its farthest, lengths look 2 % too long",
    ),
    "camera_breathing:3": (
        {"scale": -0.012, "square": 0.032, "along": 20.0, "up": -8.0},
        "the picture's scale changes with the motion: at its farthest, lengths look 2 % too long",
    ),
    "marker_standoff": ({"mm": -1.5}, "the markers stand 1.5 mm below the surface, and turn with it"),
    "marker_standoff:one": ({"mm": 0.8, "marker": 2.0}, "a marker stands 0.8 mm above the surface, and turns with it"),
    "marker_standoff:tip": ({"mm": 0.8}, "marker tip stands 0.8 mm above the surface, and turns with it"),
    "marker_slip": (
        {"along": 0.8, "across": 0.0, "marker": 3.0, "time": 19.0},
        "a marker slipped by 0.8 mm along the finger towards the tip at 19 s",
    ),
    "marker_slip:p5@19.04s": (
        {"along": -0.8, "across": 0.2},
        "marker p5 slipped by 0.8 mm along the finger towards the clamp and 0.2 mm across it (up on a side face, to "
        "+y elsewhere) at 19 s",
    ),
}  # fmt: skip


def made() -> dict[str, Effect]:
    """Every effect of the library in every law that can be named."""
    own = {law.label: law for e in all_effects() for law in e.laws()}
    wide = [w for e in all_effects() if (w := e.wide()) is not None]
    return own | {w.label: w for w in wide}


@pytest.mark.parametrize("label", sorted({*made(), *TOLD}))
def test_an_effect_tells_its_fitted_values(label: str) -> None:
    found = effect(label)
    values = {p.name: p.typical or 0.1 for p in found.parameters}
    general = found.told(values)  # of a family that is new here too
    assert re.search(r"\d", general)
    assert general[0].islower()
    assert not general.endswith(".")
    if label in TOLD:
        own, wanted = TOLD[label]
        assert found.told({f"{found.name}.{k}": x for k, x in own.items()} | {"C10": 0.2}) == wanted


def test_every_narrow_effect_has_words_of_its_own() -> None:
    assert {law.label for e in all_effects() for law in e.laws()} - set(TOLD) == set()


def test_a_direction_turns_with_the_sign() -> None:
    for e in all_effects():
        for p in e.amplitudes:
            if p.low < 0:
                values = {q.name: q.typical or 0.1 for q in e.parameters}
                assert e.told(values) != e.told({**values, p.name: -values[p.name]}), p.name


def test_an_effect_without_words_of_its_own_says_its_sentence() -> None:
    class Cable(Effect):
        name, sentence = "cable", "the cable of a sensor pulls the tip"

    assert Cable().told({"cable.up": 0.4}) == "the cable of a sensor pulls the tip"


def test_numbers_have_two_digits_and_no_exponent() -> None:
    assert [number(x) for x in (0.0321, -8.0, 13.24, 123.4, 99.7, 2e-3)] == ["0.032", "8", "13", "123", "100", "0.002"]
    assert listed(()) == ""
    assert listed(("a",)) == "a"
    assert listed(("a", "b", "c")) == "a, b and c"
    assert pull(0.0, 0.0, "N") == "0 N"
    assert at_ends(0.1, -0.2, "mm", "up", "down") == "0.1 mm up at its base and 0.2 mm down at its tip"
