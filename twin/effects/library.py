"""The library of physical effects, and the one that a label of twin.toml names."""

from twin.effects.loads import Gravity, PressureGain, PressureLag, PressureOffset
from twin.effects.material import Compressibility, Creep, Mullins, Stiffening, Thermal
from twin.effects.optics import CameraScale
from twin.effects.protocol import Effect
from twin.effects.shape import Ballooning, EccentricCore, Precurvature, SidewaysCore, WallTaper
from twin.effects.supports import ElasticClamp, StrainLimitingLayer, TableContact


def all_effects() -> tuple[Effect, ...]:
    """All effects that `twin diagnose` tries, each in its narrowest law."""
    return (
        Creep(), PressureLag(), Stiffening(), ElasticClamp(), PressureGain(), PressureOffset(), Gravity(),
        CameraScale(), WallTaper(), EccentricCore(), SidewaysCore(), Ballooning(), Precurvature(),
        StrainLimitingLayer(), Mullins(), Compressibility(), Thermal(), TableContact(),
    )  # fmt: skip


def on_request() -> tuple[Effect, ...]:
    """Effects that are never tried, only added by name: dear ones."""
    return (TableContact(2),)


def effect(label: str) -> Effect:
    """The effect that a label of twin.toml names, `creep` or `creep:2`; ValueError lists the known ones."""
    name, _, terms = label.partition(":")
    for known in (*all_effects(), *on_request()):
        if known.name == name:
            while known is not None and known.label != label:
                known = known.wider()  # type: ignore[assignment]
            if known is not None:
                return known
    raise ValueError(
        f"effect {label!r} is not in the library; wanted one of {', '.join(e.name for e in all_effects())} "
        f"(creep:2 for "
        "two terms, contact:2 with friction)" + (f"; {name} has no law with {terms} terms" if terms else "")
    )
