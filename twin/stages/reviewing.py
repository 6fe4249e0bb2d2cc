"""The review stage: what the runs of a project found -> review.rrd for rerun, report.html, pictures, VTU
files."""

from datetime import date
from typing import Any

import numpy as np

from twin.diagnosis.intervals import estimates_of_record
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.review import plots
from twin.review.deformed import deformed_picture, write_vtu_series
from twin.review.page import write_report
from twin.review.recording import write_review
from twin.review.states import Fields, Generations
from twin.stages.chain import STAGES, When, kinds_writing
from twin.stages.findings import page_facts
from twin.stages.fits import fresh, stale_sentences
from twin.stages.footage import Footage
from twin.stages.showing import Way
from twin.stages.sighting import models_on_film
from twin.stages.sourcing import budget_facts, provenance
from twin.stages.workbench import Workbench
from twin.targets import Array

STUDY = "study.json"
FIGURES = {  # of the reference study, and what each shows
    "5a": "Best RMS error of every generation of the genetic algorithm.",
    "5b": "Constants of the best candidate. Their sum settles before they do.",
    "5c": "Error of all candidates. Along the ridge the error hardly changes.",
    "6a": "Displacement against pressure, first point.",
    "6b": "Displacement against pressure, second point.",
    "6c": "Displacements at the top pressure.",
    "6d": "Absolute errors at the top pressure, before and after.",
}
FILMED = ("camera", "measure")  # stages of a project with a film
UNTESTED = "Whether the model lacks an effect is not tested: the targets have no noise model."
CHANGES = ("add", "drop")  # the stages that change the effects
SERIES = 12  # deformed states in the VTU series


def run_review(project: Project, say: Say, *, clip: bool = False) -> dict[str, Any]:
    """review.rrd and report.html from the newest runs, with `clip` also clip.mp4. ValueError where nothing is
    calibrated yet."""
    if fresh(project, ("calibrate",), "generations.npz") is None:
        why = stale_sentences(project, ("calibrate",), "generations.npz")
        reason = why[0] if why else "no calibrated model in this project"
        raise ValueError(f"nothing to review: {reason}; run twin calibrate")
    with project.new_run("review") as run:
        story = _Story(project, run, say)
        notes = [*_not_shown(project), *story.recording(say)]
        notes += story.deformed()
        write_report(run.path("report.html"), title=project.config.project.name, facts=story.facts(notes))
        notes += story.clip(say) if clip else []
        run.summary["headline"] = story.headline
    for note in notes:
        say(note)
    size = run.path("review.rrd").stat().st_size / 1e6
    say(f"Wrote {project.shown(run.folder)}/report.html, and review.rrd ({size:.1f} MB).")
    say(f"Look: `rerun {run.path('review.rrd')}`")
    return {"stage": "review", "run": run.name, "notes": notes, "rrd_MB": round(size, 2)}


def _not_shown(project: Project) -> list[str]:
    """What is stale and therefore not shown, one sentence for the newest run of each stage."""
    others = [stage.name for stage in STAGES if stage.name != "review"]
    return [sentence for name in others for sentence in stale_sentences(project, (name,))[:1]]


class _Story:
    """What the newest runs say, gathered once; no number is computed here."""

    def __init__(self, project: Project, run: Run, say: Say) -> None:
        self.project, self.run, self.targets = project, run, project.targets()
        self.generations = Generations.load(self._file("calibrate", "generations.npz"))
        self.calibrated = files.read_json(self._file("calibrate", "fit.json"))
        self.fit = self._json(kinds_writing("fit.json"), "fit.json")
        self.diagnosis = self._json(("diagnose",), "diagnosis.json")
        self.added = self._json(CHANGES, "comparison.json")
        path = fresh(project, CHANGES, "fields.npz")
        self.fields = Fields.load(path) if path else None
        effects = {label.partition(":")[0] for label in self.fit.get("effects", [])}
        effects |= set(self.diagnosis.get("named", []))
        self.way = Way.of(project, self.targets, effects=effects)
        self.study_file = fresh(project, ("study",), STUDY)
        self.study = files.read_json(self.study_file) if self.study_file else {}
        filmed, self.not_filmed = models_on_film(project, self.targets, self.generations, say)
        self.footage = Footage(project, filmed) if filmed else None

    def _file(self, kind: str, name: str) -> Any:
        path = fresh(self.project, (kind,), name)
        if path is None:
            raise ValueError(f"{name} of {kind} is missing; run twin {kind}")
        return path

    def _json(self, kinds: tuple[str, ...], name: str) -> dict[str, Any]:
        path = fresh(self.project, kinds, name)
        return files.read_json(path) if path else {}

    @property
    def headline(self) -> str:
        """The diagnosis in one sentence, or what is to be done for one."""
        return self._said[0]

    @property
    def _said(self) -> tuple[str, str]:
        """The first sentence of the diagnosis, and the others."""
        if self._untested:
            return self._found
        whole = self.diagnosis.get("sentence") or "Not diagnosed yet: run twin diagnose."
        return _first(whole)

    @property
    def _untested(self) -> bool:
        """Whether nothing can be said of what is missing, so that the constants are what was found."""
        return self.targets.noise is None or (bool(self.study) and not self.diagnosis.get("ranking"))

    @property
    def _found(self) -> tuple[str, str]:
        """What the calibration has found, in one sentence, and the others."""
        if self.study:
            return self.study["headline"], ""
        return _first(self.fit.get("identifiability") or self.calibrated["identifiability"])

    @property
    def _labels(self) -> tuple[str, str]:
        """What the report calls the model before and the one with the effects that were added."""
        effects = " and ".join(self.fit.get("effects", []))
        return "base model", f"with {effects}" if effects else "model now"

    def recording(self, say: Say) -> list[str]:
        """Write review.rrd; returns its notes."""
        cameras = self.project.config.cameras
        film = self.project.path(cameras[0].film) if cameras else None
        film = film if film is not None and film.is_file() else None  # pictures are no video
        say.progress("review", 0, 2)
        notes = write_review(
            self.run.path("review.rrd"),
            film=film,
            frame_times_s=self.targets.time - self.targets.time[0],
            generations=self.generations,
            fields=self.fields,
            diagnosis_markdown=self._markdown(),
            comparison=self._rows(),
            pictures=self.way.images,
            filmed=self.footage.filmed if self.footage else None,
        )
        say.progress("review", 1, 2)
        return [*notes, *filter(None, [self.not_filmed])]

    def _markdown(self) -> str:
        d = self.diagnosis
        lines = [f"# {d.get('verdict', 'not diagnosed')}", "", " ".join(self._said)]
        lines += ["", f"Calibration: {self.calibrated.get('identifiability', '')}"]
        return "\n".join([*lines, *self.way.markdown])

    def _rows(self) -> list[dict[str, object]]:
        ranking = self.diagnosis.get("ranking", [])
        return [
            {
                "effect": r["law"],
                "score": _round(r["z"]),
                "evidence": "not refitted" if r.get("evidence") is None else _round(r["evidence"]),
            }
            for r in ranking
        ]

    def deformed(self) -> list[str]:
        """A picture and a VTU series of the deformed finger; returns what could not be done."""
        g, notes = self.generations, []
        note = deformed_picture(
            self.run.path("deformed.png"),
            nodes=g.nodes,
            triangles=g.triangles,
            u=np.asarray(g.u[-1], float),
            points=g.points + g.u_measured,
        )
        notes += [note] if note else []
        cells = Workbench.of(self.project).case.connectivity
        if self.fields is None:
            times, u = [g.film_time_s], g.u[-1:]
        else:
            chosen = np.unique(np.linspace(0, len(self.fields.time_s) - 1, SERIES).round().astype(int))
            times, u = list(self.fields.time_s[chosen]), self.fields.u[chosen]
        write_vtu_series(
            self.run.folder, "deformed", nodes=g.nodes, cells=cells, times=times, fields={"U": u}
        )
        return notes

    def facts(self, notes: list[str]) -> dict[str, Any]:
        """Everything that the report shows."""
        d = self.diagnosis
        every = [r | {"effect": r["law"], "named": r["effect"] in d["named"]} for r in d.get("ranking", [])]
        return {
            "headline": self.headline,
            "summary": " ".join(self._opening()),
            "where": self._where(),
            "mechanism": self._mechanism(),
            "date": date.today().isoformat(),
            "errors": self._errors(),
            "named": self._named(),
            "evidence": self.way.facts,
            "ranking": [r for r in every if not _blind(r)],
            "study": self._study(),
            "ties": d.get("ties", []),
            "next_test": d.get("next_test"),
            "cannot_tell": [*self._untold(), *_by_note([r for r in every if _blind(r)])],
            "calibration": {
                "parameters": _parameters(self.calibrated),
                "sentence": self.calibrated.get("identifiability"),
            },
            "budget": budget_facts(self.project, self.generations.point_names),
            "chain": self._chain(),
            "pictures": self._pictures(),
            "notes": notes,
            "provenance": provenance(self.project, seed=self.calibrated.get("seed")),
            "commands": self._commands(),
        }

    def _untold(self) -> list[str]:
        """That no missing effect was looked for, where the targets do not allow it."""
        if self.targets.noise is not None:
            return []
        return [self.diagnosis.get("sentence") or UNTESTED]

    def _study(self) -> dict[str, Any] | None:
        """The tables and the seven figures of the study, where there is one."""
        if self.study_file is None:
            return None
        drawn = [
            _picture(f"Figure {name}.", FIGURES[name], half=True,
                     svg=self.study_file.with_name(f"figure-{name}.svg").read_text(encoding="utf-8"))
            for name in FIGURES
        ]  # fmt: skip
        return page_facts(self.study) | {"pictures": drawn}
    def _opening(self) -> list[str]:
        """The two sentences below the headline: the errors, and what to do now."""
        errors, last = self._errors(), self.diagnosis.get("next_test")
        if errors is None:
            return []
        before, after, noise = (errors[f"{key}_mm"] for key in ("before", "after", "noise"))
        fall = f"The model misses the film by {before:.3f} mm rms"
        if after is not None:
            fall += f", {self._labels[1]} by {after:.3f} mm"
        said = [f"{fall}; the measurement itself is uncertain by {noise:.3f} mm."]
        if last:
            return [*said, f"To be sure, make the next test: {_small(last)}"]
        if self.added.get("adequate", self.diagnosis.get("adequate")):
            return [
                *said,
                "The model now agrees with the measurement: its constants and intervals can be used.",
            ]
        return [*said, "The model does not agree with the measurement yet: do not use its constants."]

    def _where(self) -> str:
        """Where the model without effects fails, in words."""
        found: str = self._json(("compare", "calibrate"), "comparison.json").get("where", "")
        return found

    def _mechanism(self) -> str:
        """What the diagnosis says beside its first sentence; the errors stand in the opening."""
        parts = self._said[1].removesuffix(".").split(". ")
        return "".join(f"{part}. " for part in parts if part and not part.startswith("The error falls"))

    def clip(self, say: Say) -> list[str]:
        """Write clip.mp4, for a talk; returns why it could not be made."""
        if self.footage is None:
            return [f"No clip: {self.not_filmed or 'there is no film'}."]
        say.progress("clip", 0, 1)
        faster = self.footage.clip(self.run.path("clip.mp4"))
        say.progress("clip", 1, 1)
        say(f"Wrote {self.project.shown(self.run.folder)}/clip.mp4{faster}.")
        return []

    def _overlaid(self) -> list[dict[str, Any]]:
        """The film at the worst moment with the models over it."""
        if self.footage is None:
            return []
        return [_picture("The worst moment", self.footage.caption, png=self.footage.worst, place="top")]

    def _commands(self) -> list[str]:
        """The commands that lead to this report, with the effects that were added."""
        if self.study and self._untested:
            return ["twin study"]
        filmed = bool(self.project.config.cameras)
        added = [f"twin add {label}" for label in self.fit.get("effects", [])]
        every = [s for s in STAGES if s.when is When.ALWAYS and (filmed or s.name not in FILMED)]
        before = [f"twin {stage.name}" for stage in every]
        return [*before[:-1], *added, *(["twin study"] if self.study else []), before[-1]]

    def _errors(self) -> dict[str, Any] | None:
        d = self.diagnosis
        if d.get("rms_before_mm") is None:
            return None
        after = self.added.get("rms_mm") if self.added else None
        errors = {"before_mm": d["rms_before_mm"], "after_mm": after, "noise_mm": d["noise_sd_mm"]}
        before_note, after_note = self._labels
        return errors | {"before_note": before_note, "after_note": after_note}

    def _named(self) -> list[dict[str, Any]]:
        """The effects in the model and the constants beside them, each with its parameters."""
        rows, every = [], _parameters(self.fit)
        for label in self.fit.get("effects", []):
            name = label.partition(":")[0]
            own = [p for p in every if p["name"].startswith(f"{name}.")]
            rows.append({"effect": label, "text": "", "parameters": own})
        constants = [p for p in every if "." not in p["name"]]
        return [*rows, {"effect": "constants beside it", "parameters": constants}] if rows else []

    def _chain(self) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = []
        camera = self._json(("camera",), "camera.json")
        if camera:
            rows.append({"name": "camera, reprojection RMS", "value": camera["rms_px"], "unit": "px"})
        noise = self.targets.noise
        if noise is not None:
            rows.append(
                {
                    "name": "marker noise at rest, median sd",
                    "value": 1e3 * float(np.nanmedian(noise.sd)),
                    "unit": "um",
                }
            )
            rows.append({"name": "static frames", "value": noise.frames})
            rows.append({"name": "gauge noise, sd", "value": 1e3 * noise.gauge_sd_MPa, "unit": "kPa"})
        rows.append(
            {"name": "steps x markers", "value": f"{len(self.targets.time)} x {len(self.targets.names)}"}
        )
        return rows

    def _pictures(self) -> list[dict[str, Any]]:
        return [
            *self._drawn("error", place="top"), *self._deformed(), *self._overlaid(),
            *self._drawn("residuals", place="where"), *self._drawn("evidence", place="evidence"),
            *self._over_time(), *self._search(),
        ]  # fmt: skip

    def _drawn(self, name: str, *, place: str) -> list[dict[str, Any]]:
        """A picture of the way to the model of now, where there is one."""
        law = self.way.evidence.get("effect", "")
        said = {
            "error": ("How the error fell", "RMS of all markers. Pale: what the next step takes off.", True),
            "evidence": (
                f"What speaks for {law}",
                f"The residual without {law}, what {law} explains of it, and what it leaves.",
                False,
            ),
            "residuals": (
                "Measured minus model by marker and time",
                "Without the errors (scale, placement, mesh) that many values share.",
                False,
            ),
        }
        title, caption, half = said[name]
        svg = self.way.pictures.get(name)
        return [_picture(title, caption, half=half, svg=svg, place=place)] if svg else []

    def _deformed(self) -> list[dict[str, Any]]:
        """The finger at top pressure, where it could be drawn."""
        file = self.run.path("deformed.png")
        caption = "Best model of the genetic algorithm, and the measured markers."
        if not file.exists():
            return []
        return [_picture("Model at top pressure", caption, half=True, png=file, place="top")]

    def _search(self) -> list[dict[str, Any]]:
        """The genetic algorithm by generation and, of two constants, its landscape; the study has its own."""
        g = self.generations
        if self.study:
            return []
        course = plots.generations(g.generation, rms_mm=g.rms_mm, best=g.best, names=g.names)
        caption = "Best RMS and constants of every generation."
        out = [_picture("Genetic algorithm", caption, half=True, svg=course)]
        if len(g.names) == 2:
            found = files.read_npz(self._file("calibrate", "candidates.npz"))
            valley = plots.landscape(found["x"], rms_mm=found["rms_mm"], names=g.names, best=g.best[-1])
            caption = "All candidates. Along the valley the sum of the two is the same."
            out.append(_picture("Error landscape", caption, half=True, svg=valley))
        return out

    def _over_time(self) -> list[dict[str, Any]]:
        """Displacements, what is left of them, and displacements against pressure: of a film."""
        before = self._prediction(("diagnose", "compare", "calibrate"))
        after = self._prediction(CHANGES) if self.fields is not None else {}
        if not before or len(self.targets.time) < 3:
            return []
        displacement, pressure = self._courses(before, after)
        return [displacement, pressure]

    def _courses(self, before: dict[str, Array], after: dict[str, Array]) -> list[dict[str, Any]]:
        """The markers of the objective over time, and over pressure."""
        t, end = self.targets, after.get("u")
        rows = np.flatnonzero(~t.fixed)
        wanted = [r for r in rows if t.names[r] in self.project.config.calibrate.objective_points]
        own = wanted or rows[-2:]
        drawn: dict[str, Any] = {"names": [t.names[r] for r in own], "labels": self._labels}
        over_time = plots.displacements(
            t.time - t.time[0],
            measured=t.value[:, own],
            before=before["u"][:, own],
            after=None if end is None else end[:, own],
            **drawn,
        )
        over_pressure = plots.pressure_curves(
            t.pressure,
            measured=t.value[:, own, 2],
            before=before["u"][:, own, 2],
            after=None if end is None else end[:, own, 2],
            **drawn,
        )
        shown = f"Measured; {' and '.join(self._labels[: 1 + bool(after)])}."
        return [
            _picture("Displacement", shown, svg=over_time),
            _picture("U3 against pressure", f"{shown} Every dot is a step of the film.", svg=over_pressure),
        ]

    def _prediction(self, kinds: tuple[str, ...]) -> dict[str, Array]:
        """What the newest run of these kinds predicted and left, or nothing."""
        path = fresh(self.project, kinds, "prediction.npz")
        return dict(files.read_npz(path)) if path else {}


def _picture(title: str, caption: str, *, half: bool = False, **drawn: Any) -> dict[str, Any]:
    """A picture of the report, svg=text or png=file; two halves stand side by side."""
    return {"title": title, "caption": caption, "half": half, **drawn}


def _parameters(fit: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"name": e.name} | e.to_dict() for e in estimates_of_record(fit)]


def _first(whole: str) -> tuple[str, str]:
    """The first sentence of a text, and the others."""
    first, _, others = whole.partition(". ")
    return (first + "." if others else first), others


def _blind(row: dict[str, Any]) -> bool:
    """Whether an effect of the ranking was never tested, and its note says why."""
    return bool(row["note"]) and row["delta_bic"] is None


def _by_note(rows: list[dict[str, Any]]) -> list[str]:
    """One sentence for all effects of which the same is noted."""
    notes = dict.fromkeys(r["note"] for r in rows)
    return [f"{', '.join(r['law'] for r in rows if r['note'] == note)}: {note}." for note in notes]


def _small(sentence: str) -> str:
    """A sentence as it stands behind a colon: its first letter small, unless it is part of a name."""
    return sentence[:1].lower() + sentence[1:] if sentence[1:2].islower() else sentence


def _round(x: Any) -> Any:
    return None if x is None else round(float(x), 1)
