"""Two projects of fingers that ought to be alike -> what the second finger differs in, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin import files
from twin.batches.differences import Difference, Differing, differing
from twin.bench.workbench import Workbench, body_of
from twin.effects.labels import OR, name_of
from twin.effects.library import all_effects
from twin.effects.protocol import Unsolvable
from twin.effects.shape import WallThickness
from twin.experiments.benchchecks import in_words, witnesses
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.project.folder import Project
from twin.targets import Array

OF_ONE_FILM = ("marker_slip",)  # effects that a second film does not share


@dataclass(frozen=True, kw_only=True)
class Casting:
    """What a finger differs in from a former one: sentences; found: the changes by rank, None where it could
    not be asked."""

    sentences: tuple[str, ...]
    found: Differing | None = None

    @property
    def plain(self) -> dict[str, object]:
        """The same for a JSON document."""
        rows = () if self.found is None else self.found.ranking
        near = [] if self.found is None else [d.name for d in self.found.nearest]
        proven = bool(self.found and self.found.proven)
        return {
            "asked": self.found is not None, "proven": proven, "nearest": near,
            "ranking": [{"name": d.name, "words": d.words, "evidence": d.evidence, "adequate": d.adequate,
                         "rms_mm": d.comparison.raw_rms_mm} for d in rows],
        }  # fmt: skip


def casting(former: Project, fit: FitRecord, project: Project, say: Say) -> Casting:
    """What the finger of a project differs in from that of a former one, by the former's fit."""
    names = former.root.name, project.root.name
    try:
        found = _asked(former, fit, project, names, say)
        return Casting(sentences=tuple(sentences(found, *names)), found=found)
    except (Unsolvable, *files.UNREADABLE) as why:
        return Casting(
            sentences=(f"What {names[1]} differs in was not asked: {str(why).removesuffix('.')}.",)
        )


def _asked(
    former: Project, fit: FitRecord, project: Project, names: tuple[str, str], say: Say
) -> Differing:
    if body_of(former) != body_of(project) or former.config.model.object != project.config.model.object:
        raise ValueError(f"{names[0]} and {names[1]} are not modelled alike")
    labels = [label for label in fit.effects if name_of(label) not in OF_ONE_FILM]
    bench = Workbench.of(project).of_film
    if bench.jobs is not None:
        raise ValueError(f"{bench.jobs.engine.name} solves the model; the embedded engine asks it")
    if bench.targets.noise is None:
        raise ValueError(
            f"{names[1]} has no noise model: film the finger at rest (>= 300 frames), and measure"
        )
    model = bench.model(labels)
    values, covariance = _of_model(fit, [p.name for p in model.parameters], names[0])
    say.progress(f"what {names[1]} differs in", 0, 1)
    model = bench.on_mesh(model, model.theta(values), say)
    effects = (*all_effects(bench.law), WallThickness())
    return differing(model, values, covariance, bench.targets.alone, effects)


def _of_model(fit: FitRecord, wanted: Sequence[str], name: str) -> tuple[dict[str, float], Array]:
    """The fitted values of these parameters, and their covariance (d, d); ValueError without one."""
    have = [p.name for p in fit.fit.parameters]
    if lost := set(wanted) - set(have):
        raise ValueError(f"the fit of {name} has no {', '.join(sorted(lost))}: its model is another")
    rows = [have.index(n) for n in wanted]
    covariance = np.asarray(fit.fit.covariance, float)[np.ix_(rows, rows)]
    if not np.isfinite(covariance).all():
        raise ValueError(f"the fit of {name} has no intervals")
    return {n: float(fit.fit.theta[k]) for n, k in zip(wanted, rows, strict=True)}, covariance


def sentences(found: Differing, former: str, name: str) -> list[str]:
    """What was found, in sentences: the change, those that cannot be told from it, and the look that tells
    them apart."""
    before = found.before
    if not found.proven:
        fits = "within the noise" if before.adequate else "but for what no single change explains"
        told = f"the model of {former} foretells its film {fits}"
        return [f"No difference of {name} from {former} is proven: {told}."]
    near = found.nearest
    what = [f"{name} differs from {former} by {OR.join(d.name for d in near)}: {near[0].words}. The model of "
            f"{former} misses its film by {before.raw_rms_mm:.3f} mm, with this by "
            f"{near[0].comparison.raw_rms_mm:.3f} mm."]  # fmt: skip
    if not any(d.adequate for d in near):
        what.append(
            "Nothing that was tried leaves noise alone: the difference is like this, or there are several."
        )
    if near[1:]:
        what.append(f"These data cannot tell that from {'; nor from '.join(map(_named, near[1:]))}.")
    checks = in_words(witnesses([d.name for d in near]))
    return [*what, checks] if checks else what


def _named(d: Difference) -> str:
    return f"{d.name} ({d.words})"
