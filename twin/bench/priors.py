"""Priors of parameters and the loss of the fit, as [calibrate] of twin.toml states them."""

from collections.abc import Callable, Sequence

from calibrate.robust import NU
from twin.effects.labels import OPEN, name_of
from twin.effects.library import effect
from twin.effects.protocol import Effect
from twin.judging.likelihood import SHARE, TOTAL
from twin.laws.law import RubberLaw
from twin.laws.mooneyrivlin import NAMES
from twin.project.config import LEAST_SQUARES, STUDENT
from twin.project.folder import Project
from twin.targets import KnownValue

TAILS = {LEAST_SQUARES: 0.0, STUDENT: NU}  # degrees of freedom of the errors; 0: normal ones


def check_least_squares(project: Project, stage: str) -> None:
    """ValueError for a stage that weighs all values alike, where the fit does not."""
    loss = project.config.calibrate.loss
    if loss != LEAST_SQUARES:
        raise ValueError(
            f"calibrate.loss = {loss!r}: {stage} counts every value in full, gross errors too, and would "
            "take these for physics; take the values that fit.json names (down_weighted) out of the "
            f'targets, set loss = "{LEAST_SQUARES}" under [calibrate] and run twin calibrate again'
        )


def known_values(
    project: Project, law: RubberLaw, own_of: Callable[[Project], Sequence[Effect]]
) -> tuple[KnownValue, ...]:
    """The priors of twin.toml; law: that of the silicone; own: the effects of a project's own files.
    ValueError for a name that nothing has, or that is held at a value."""
    priors = project.config.calibrate.priors
    for name in priors:
        _check(project, name, law, own_of)
    open_mm = {f"{OPEN}.{key}": sd for key, (_, sd) in project.config.model.open.items()}
    known = {**priors, **{name: (0.0, sd) for name, sd in open_mm.items()}}
    return tuple(KnownValue(name=name, mean=mean, sd=sd) for name, (mean, sd) in known.items())


def _check(
    project: Project, name: str, law: RubberLaw, own_of: Callable[[Project], Sequence[Effect]]
) -> None:
    fixed, both = project.config.model.fixed, (TOTAL, SHARE) if set(NAMES) <= set(law.names) else ()
    if name in (*law.names, *both):
        made_of = NAMES if name in both else (name,)
        held = [named for named in made_of if named in fixed]
        if held:
            raise ValueError(
                f"calibrate.priors.{name}: {held[0]} = {fixed[held[0]]:g} MPa is held under [model] fixed; "
                "remove one of them"
            )
        return
    base = name.partition(".")[0]
    if base == OPEN:
        raise ValueError(
            f"calibrate.priors.{name}: what is known of a dimension, value and sd in mm, stands under "
            "[model.open]; state it there"
        )
    labels = [label for label in project.config.model.effects if name_of(label) == base]
    try:
        named = effect(labels[0] if labels else base, users=own_of(project), law=law)
    except ValueError:
        raise ValueError(
            f"calibrate.priors.{name}: wanted {', '.join((*law.names, *both))}, or a parameter of an effect, "
            'such as "creep.g1"; correct the name'
        ) from None
    names = [p.name for p in named.parameters]
    if labels and name not in names:
        raise ValueError(f"calibrate.priors.{name}: {labels[0]} has {', '.join(names)}; correct the name")
