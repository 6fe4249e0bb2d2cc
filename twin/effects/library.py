"""The library of physical effects, and the one that a label of twin.toml names."""

from collections.abc import Sequence

from twin.effects import labels
from twin.effects.forces import Tube
from twin.effects.inertia import Inertia
from twin.effects.loads import Gravity, PressureGain, PressureLag, PressureOffset
from twin.effects.markerslip import MarkerSlip, MarkerStandoff
from twin.effects.material import Compressibility, Creep, Mullins, Stiffening, Thermal
from twin.effects.measurement import CameraBreathing, CameraRotation, CameraScale, CameraTilt, TimeShift
from twin.effects.protocol import Effect
from twin.effects.shape import Ballooning, EccentricCore, Precurvature, SidewaysCore, WallTaper
from twin.effects.supports import ElasticClamp, HoopReinforcement, StrainLimitingLayer, TableContact
from twin.laws.law import RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN


def all_effects(law: RubberLaw = MOONEY_RIVLIN) -> tuple[Effect, ...]:
    """All effects that `twin diagnose` tries, each in its narrowest law, beside the base model's law.

    >>> [e.name for e in all_effects()][:4]
    ['creep', 'pressure_lag', 'inertia', 'stiffening']
    """
    every: tuple[Effect, ...] = (
        Creep(), PressureLag(), Inertia(), Stiffening(), ElasticClamp(), PressureGain(), PressureOffset(),
        Gravity(), CameraScale(), WallTaper(), EccentricCore(), SidewaysCore(), Ballooning(), Precurvature(),
        StrainLimitingLayer(), HoopReinforcement(), Mullins(), Compressibility(), Thermal(), TableContact(),
        Tube(), TimeShift(), CameraRotation(), CameraTilt(), CameraBreathing(), MarkerSlip(),
        MarkerStandoff(),
    )  # fmt: skip
    return tuple(e.beside(law) for e in every)


def effects_of(
    text: str, *, users: Sequence[Effect] = (), law: RubberLaw = MOONEY_RIVLIN
) -> tuple[tuple[Effect, ...], ...]:
    """The effects that a text names as a verdict does, `creep + gravity or tube`: groups of which any one may
    be missing, without those that hold a stand-in. ValueError where nothing else is named, or one is unknown.

    users: the effects of the user's own files.
    """
    names = {e.name for e in (*all_effects(), *users)}
    groups = labels.groups(text)
    real = [g for g in groups if all(x in names or labels.kind_of(x) is None for x in g)] or groups
    return tuple(tuple(effect(label, users=users, law=law) for label in group) for group in real)


def effect(label: str, *, users: Sequence[Effect] = (), law: RubberLaw = MOONEY_RIVLIN) -> Effect:
    """The effect named by a label in twin.toml, for example `creep` or `creep:2`; ValueError if unknown.

    users: the effects of the user's own files; law: the base model's.

    >>> creep = effect("creep:2")
    >>> creep.label, [p.name for p in creep.parameters]
    ('creep:2', ['creep.g1', 'creep.tau1', 'creep.g2', 'creep.tau2'])
    >>> creep.told({"creep.g1": 0.08, "creep.tau1": 2.0, "creep.g2": 0.05, "creep.tau2": 30.0})
    'the silicone creeps: 8 % of its stiffness relaxes with 2 s, 5 % with 30 s'
    """
    name = labels.name_of(label)
    laws_by_name = {e.name: e.laws() for e in (*all_effects(law), *users)}
    if name not in laws_by_name:
        kind = labels.kind_of(label)
        if kind is not None:
            same = [e.name for e in (*all_effects(), *users) if e.generic == kind]
            raise ValueError(
                f"{label!r} tells how the rest looks; it is no effect that a model can have; wanted "
                f"{f'{labels.OR.join(same)}, which it may be, or ' if same else ''}"
                "an effect of your own with its cause (docs/own-effect.md)"
            )
        raise ValueError(
            f"effect {label!r} is not in the library, wanted one of {', '.join(laws_by_name)}; one of "
            "your own stands in a file that twin.toml names under [model] effect_files"
        )
    laws = {law.label: law for law in laws_by_name[name]}
    named = laws.get(label) or laws_by_name[name][0].named(label)
    if named is None:
        narrow = laws_by_name[name][0]
        wide = narrow.wide()
        every = dict.fromkeys(filter(None, [*laws, wide.label if wide else "", narrow.held]))
        raise ValueError(f"effect {label!r}: no such law of {name}, wanted one of {', '.join(every)}")
    return named
