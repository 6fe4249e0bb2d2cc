"""The validation card of an exported finger: what the simulator says beside the model and the film."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from twin.assets.sections import RodBeside
from twin.assets.simulators import RodSimulator
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect
from twin.judging.fitrecord import Estimate, FitRecord
from twin.numerals import short
from twin.records import Maybe, Record
from twin.tablemodel import Finite
from twin.targets import Array, Targets

VERSION = 1
CHECKED = 5  # pressures
NEAR = 0.03  # of the tip's displacement: an asset that is off by more says so
DRAWS = 20  # of the constants
NORMAL = 1.96
Place = tuple[Maybe, Maybe, Maybe]


class CardRow(Record):
    """The tip under one held pressure, relative to the finger at rest."""

    pressure_MPa: Finite
    asset_mm: Place = Field(description="what the simulator says; null where it was not run")
    model_mm: Place = Field(description="what softtwin predicts of the pressure when it is held")
    sd_mm: Place = Field(description="1 sd of that; null where the fit has none")
    film_mm: Place = Field(description="what was measured as the pressure rose; null where it was not")
    film_sd_mm: Place
    model_error: Maybe = Field(description="distance of asset and model, over the model's displacement")
    film_error: Maybe = Field(description="distance of asset and film in what was measured, over the film's")


class LoadRow(Record):
    """What a force up at the tip adds under one pressure."""

    pressure_MPa: Finite
    force_N: Finite
    asset_mm: Place
    model_mm: Place
    error: Maybe = Field(description="distance of both, over the model's")


class AssetCard(Record):
    """What an exported finger is worth."""

    file: ClassVar[str] = "card.json"
    version: int = Field(description="of this form")
    simulator: str
    tested: str = Field(description="version of its package that the files were checked with; empty: none")
    run_with: str = Field(description="version that made this card; empty where none was needed, or none ran")
    files: tuple[str, ...]
    rows: tuple[CardRow, ...] = Field(description="a row a pressure")
    tip_error: Maybe = Field(description="largest model_error; null where the simulator was not run")
    film_error: Maybe = Field(description="largest film_error")
    cover: Maybe = Field(description="share of the measured values within 95 % of the asset's, with errors "
                                     "of model and film; null without an interval")  # fmt: skip
    load: LoadRow
    constants: dict[str, Estimate] = Field(description="by name")
    samples: dict[str, tuple[Finite, ...]] = Field(description="values of the constants that go together")
    sampled: str = Field(description="where the samples are from, or why there are none")
    cannot: tuple[str, ...] = Field(description="what the simulator cannot express")
    missing: dict[str, str] = Field(description="effects of the model that are not in the asset, and why")
    sentence: str


@dataclass(frozen=True)
class FilmTips:
    """Pressures (k,) MPa at which a film was taken as the pressure rose, and its tip (k, 3) mm with sd."""

    pressure: Array
    tip: Array
    sd: Array


def of_film(targets: Targets, name: str) -> FilmTips:
    """The film's tip at CHECKED steps of the first rise, evenly up to its highest pressure."""
    first = np.flatnonzero(targets.block == 0)
    pressure = targets.pressure[first]
    rise = first[: int(pressure.argmax()) + 1]
    levels = pressure.max() * np.arange(1, CHECKED + 1) / CHECKED
    rows = np.array([rise[np.abs(targets.pressure[rise] - p).argmin()] for p in levels])
    column = targets.names.index(name)
    seen = targets.valid[rows, column]
    variance = np.diagonal(targets.covariance[rows, column], axis1=-2, axis2=-1)
    shared = (targets.modes[:, rows, column] ** 2).sum(axis=0)
    value, sd = targets.value[rows, column], np.sqrt(np.where(seen, variance + shared, np.nan))
    return FilmTips(targets.pressure[rows], np.where(seen, value, np.nan), sd)


MISSING = {
    Mechanism.HISTORY: "the asset has no memory: it is the finger after the ramp and the hold",
    Mechanism.COURSE: "of the rig: the asset's pressure is that of the gauge, at once",
    Mechanism.PICTURE: "of the camera: the asset moves as the film shows it, with this in it",
}


def missing(effects: Sequence[Effect]) -> dict[str, str]:
    """The effects of a model that a rod does not have, by label, and why: those whose mechanism is no part of
    a finger under a held pressure."""
    return {e.label: MISSING[e.mechanism] for e in effects if e.mechanism in MISSING}


def drawn(record: FitRecord) -> tuple[dict[str, tuple[float, ...]], str]:
    """Constants drawn DRAWS times with the covariance of a fit, within bounds, and where they are from."""
    if not record.adequate:
        return {}, "none: the model does not fit its film"
    fit = record.fit
    known = np.flatnonzero(np.isfinite(np.diag(fit.covariance)))
    rows = np.random.default_rng(record.seed).multivariate_normal(
        fit.theta[known], fit.covariance[np.ix_(known, known)], DRAWS
    )
    free = [fit.parameters[k] for k in known]
    clipped = np.clip(rows, [p.low for p in free], [p.high for p in free])
    return (
        {p.name: tuple(clipped[:, k].tolist()) for k, p in enumerate(free)},
        "normal, with the covariance of the fit",
    )


def carded(
    simulator: RodSimulator, followed: RodBeside, film: FilmTips, tips: Array | None, lifted: Array | None, *,
    record: FitRecord, effects: Sequence[Effect], names: Sequence[str],
) -> AssetCard:  # fmt: skip
    """The card of a simulator's tips (k, 3) mm at the film's pressures, and of what a force adds (3,) mm;
    None where it was not run."""
    asset = np.full_like(followed.tip, np.nan) if tips is None else tips
    off_model, off_film = asset - followed.tip, np.where(np.isfinite(film.tip), asset - film.tip, np.nan)
    model_error = np.linalg.norm(off_model, axis=1) / np.linalg.norm(followed.tip, axis=1)
    size = np.sqrt(np.nansum(film.tip**2, axis=1))
    film_error = np.sqrt(np.nansum(off_film**2, axis=1)) / size if tips is not None else size * np.nan
    within = np.abs(off_film) <= NORMAL * np.hypot(followed.sd, film.sd)
    known = np.isfinite(off_film) & np.isfinite(followed.sd + film.sd)
    more = np.full(3, np.nan) if lifted is None else lifted
    error = float(np.linalg.norm(more - followed.lifted) / np.linalg.norm(followed.lifted))
    rows = [
        CardRow(
            pressure_MPa=p, asset_mm=tuple(asset[k]), model_mm=tuple(followed.tip[k]),
            sd_mm=tuple(followed.sd[k]), film_mm=tuple(film.tip[k]), film_sd_mm=tuple(film.sd[k]),
            model_error=model_error[k], film_error=film_error[k],
        )
        for k, p in enumerate(followed.pressure.tolist())
    ]  # fmt: skip
    samples, sampled = drawn(record)
    worst = float(model_error.max())
    return AssetCard(
        version=VERSION, simulator=simulator.name, tested=simulator.tested,
        run_with=simulator.installed if tips is not None else "", files=tuple(names), rows=tuple(rows),
        tip_error=worst, film_error=float(film_error.max()),
        cover=float(within[known].mean()) if known.any() else None,
        load=LoadRow(
            pressure_MPa=followed.loaded, force_N=followed.force, asset_mm=tuple(more),
            model_mm=tuple(followed.lifted), error=error,
        ),
        constants=record.estimates, samples=samples, sampled=sampled,
        cannot=(*simulator.cannot, *_of_every(followed)), missing=missing(effects),
        sentence=_sentence(simulator, worst, float(film_error.max()), error),
    )  # fmt: skip


def _of_every(followed: RodBeside) -> list[str]:
    """What no rod expresses."""
    return [
        "the law of the silicone: a rod has it as the bend, the stretch and the stiffness that it gives; "
        + _as_solid(followed.neo_hooke),
        f"motion across the plane, at the tip up to {short(float(np.abs(followed.tip[:, 1]).max()))} mm",
        "bending that stretches the line of the points, and contact of the walls",
        *([] if followed.dense else ["the density: none is stated, 1070 kg/m3 is taken"]),
    ]


def _as_solid(share: float) -> str:
    if not np.isfinite(share):
        return "a solid of neo-Hooke silicone with its moduli at rest does not carry these pressures"
    off = f"the tip is off by {_share(share)} at most"
    return f"as a solid of neo-Hooke silicone with its moduli at rest, {off}"


def _sentence(simulator: RodSimulator, worst: float, film: float, load: float) -> str:
    if not np.isfinite(worst):
        return (
            f"Not checked: {simulator.package} is not installed. The files were checked with its version "
            f"{simulator.tested}; install it and export again."
        )
    held = "within" if worst <= NEAR else "not within"
    return (
        f"The tip follows softtwin {held} {100 * NEAR:.0f} %: {100 * worst:.2g} % at most, and the film to "
        f"{100 * film:.2g} %. Under a force at the tip it is off by {100 * load:.2g} % of what that adds."
    )


def page(card: AssetCard) -> str:
    """The card as one page of text with tables."""
    mm = ["pressure, kPa | asset, mm | softtwin, mm | film, mm | off softtwin | off film",
          "---|---|---|---|---|---"]  # fmt: skip
    mm += [
        " | ".join([
            short(1e3 * r.pressure_MPa), *(_pair(u) for u in (r.asset_mm, r.model_mm, r.film_mm)),
            _share(r.model_error), _share(r.film_error),
        ])
        for r in card.rows
    ]  # fmt: skip
    load = card.load
    constants = [f"{name} | {short(e.value)} {e.unit} | {_span(e)}" for name, e in card.constants.items()]
    return "\n".join([
        f"# Finger for {card.simulator}", "", card.sentence, "", "## Tip (U1, U3)", *_table(mm), "",
        f"{_share(card.cover)} of the film's values lie within the 95 % interval.", "",
        f"A force of {short(load.force_N)} N up at the tip adds {_pair(load.asset_mm)} mm at "
        f"{short(1e3 * load.pressure_MPa)} kPa; in softtwin {_pair(load.model_mm)} mm.", "",
        "## Constants", *_table(["constant | value | 95 % interval", "---|---|---", *constants]), "",
        f"card.json has {DRAWS} values of each that go together ({card.sampled}).", "",
        f"## What {card.simulator} does not express", *(f"- {line}" for line in card.cannot), "",
        "## Effects that the asset does not have",
        *([f"- {label}: {why}" for label, why in card.missing.items()] or ["None."]), "",
        "## Files", *(f"- {name}" for name in card.files),
        f"- checked with {card.simulator} {card.tested}" if card.tested else "", "",
    ])  # fmt: skip


def _table(lines: Sequence[str]) -> list[str]:
    return ["", *(f"| {line} |" for line in lines)]


def _pair(u: Place) -> str:
    return ", ".join("-" if x is None else f"{x:.2f}" for x in (u[0], u[2]))


def _share(x: float | None) -> str:
    return "-" if x is None else f"{100 * x:.2g} %"


def _span(e: Estimate) -> str:
    return e.note if e.low is None or e.high is None else f"{short(e.low)} to {short(e.high)}"
