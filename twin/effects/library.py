"""The library of physical effects, and the one that a label of twin.toml names."""

from collections.abc import Sequence

from twin.effects.clocks import TimeShift
from twin.effects.loads import Gravity, PressureGain, PressureLag, PressureOffset
from twin.effects.material import Compressibility, Creep, Mullins, Stiffening, Thermal
from twin.effects.optics import CameraRotation, CameraScale, CameraTilt
from twin.effects.protocol import Effect
from twin.effects.pulls import Tube
from twin.effects.shape import Ballooning, EccentricCore, Precurvature, SidewaysCore, WallTaper
from twin.effects.supports import ElasticClamp, StrainLimitingLayer, TableContact
from twin.effects.tags import MarkerSlip


def all_effects() -> tuple[Effect, ...]:
    """All effects that `twin diagnose` tries, each in its narrowest law."""
    return (
        Creep(), PressureLag(), Stiffening(), ElasticClamp(), PressureGain(), PressureOffset(), Gravity(),
        CameraScale(), WallTaper(), EccentricCore(), SidewaysCore(), Ballooning(), Precurvature(),
        StrainLimitingLayer(), Mullins(), Compressibility(), Thermal(), TableContact(), Tube(), TimeShift(),
        CameraRotation(), CameraTilt(), MarkerSlip(),
    )  # fmt: skip


def effect(label: str, *, own: Sequence[Effect] = ()) -> Effect:
    """The effect named by a label in twin.toml, for example `creep` or `creep:2`; ValueError if unknown.

    own: the effects of the user's own files.
    """
    name = label.partition(":")[0]
    known = {e.name: e.laws() for e in (*all_effects(), *own)}
    if name not in known:
        raise ValueError(
            f"effect {label!r} is not in the library, wanted one of {', '.join(known)}; one of your own "
            "stands in a file that twin.toml names under [model] effect_files"
        )
    laws = {law.label: law for law in known[name]}
    made = known[name][0].named(label)
    if label not in laws and made is not None:
        return made
    if label not in laws:
        raise ValueError(f"effect {label!r}: no such law of {name}, wanted one of {', '.join(laws)}")
    return laws[label]
