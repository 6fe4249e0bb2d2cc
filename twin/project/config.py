"""Turn twin.toml into a checked, frozen configuration; one field here is one key there."""

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from twin.bodies.bar import BarTable
from twin.bodies.finger import FingerTable
from twin.bodies.kinds import BODIES, BodyTable
from twin.bodies.pneunet import PneunetTable
from twin.bodies.tube import TubeTable
from twin.coupons.testtable import MaterialTestTable
from twin.effects import labels
from twin.formats.recorded import plain
from twin.gauge.pressuretable import PressureTable
from twin.laws.catalogue import LAWS, named_law
from twin.laws.law import RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES
from twin.marktables import FrameTable, MarkTable, OutlineTable, PointTable, PoseTable
from twin.project.cameratables import CameraTable, DicTable, FilmTable, MeasureTable, RecordingTable
from twin.project.targetschema import shares_by_surface
from twin.tablemodel import (
    Bounds,
    Density,
    Direction,
    Finite,
    Memory,
    Name,
    NotNegative,
    OtherProject,
    Positive,
    Program,
    RelativePath,
    TableModel,
)


def _law_name(name: str) -> str:
    return named_law(name).name


LawName = Annotated[str, AfterValidator(_law_name)]
Effect = Annotated[str, AfterValidator(labels.checked)]
Effects = Annotated[str, AfterValidator(labels.checked_groups)]
EMBEDDED: Literal["embedded"] = "embedded"  # this package's own kernel
LEAST_SQUARES: Literal["least-squares"] = "least-squares"  # of normal errors
STUDENT: Literal["student-t"] = "student-t"
STIFFEST = 100.0  # MPa, of a constant that may be fitted: hard rubber has 10


# Keys of older versions on which nothing depended: a file that has them still counts.
FORMER = {"model": ("geometry", "material", "top_pressure_MPa")}


class ProjectTable(TableModel):
    name: str = Field(default="batch", min_length=1, description="name of the batch")
    like: OtherProject | None = Field(
        default=None,
        description="folder of the former batch on the same rig, such as ../batch-07",
    )


class ModelTable(TableModel):
    body: Literal["finger", "pneunet", "tube", "bar", "deck"] | None = Field(
        default=None,
        description="kind of actuator: finger (bellows), pneunet, tube, bar; else your deck, or a finger",
    )
    deck: RelativePath | None = Field(
        default=None,
        description="your own mesh, an Abaqus deck such as raw/finger.inp; else the body's mesh is built in",
    )
    silicone: tuple[Name, ...] = Field(
        default=(), description="element sets of the deck whose constants are fitted; []: all"
    )
    law: LawName | None = Field(
        default=None,
        description=f"law of the silicone: {', '.join(LAWS)}; left out: that of the deck, else mooney-rivlin",
    )
    mesh: int = Field(default=1, ge=1, le=8, description="mesh refinement: 2 halves all elements")
    effects: tuple[Effect, ...] = Field(
        default=(),
        description='effects in the model, such as ["creep:2"]',
    )
    effect_files: tuple[RelativePath, ...] = Field(
        default=(),
        description='your own effects, ["effects/cable.py"]; they run only after `twin trust`',
    )
    density_kg_m3: Density | None = Field(
        default=None,
        description="density of the silicone, kg/m3; with it the model has weight and needs gravity",
    )
    gravity: Direction | None = Field(
        default=None,
        description="direction of gravity in world axes, such as [0.0, 0.0, -1.0]; leave it "
        "out where targets.toml states it",
    )
    self_contact: bool = Field(
        default=False,
        description="whether walls that meet push on each other; false: they pass through each other, and "
        "compare says so",
    )
    object: str | None = Field(
        default=None,
        description="a rigid object that the filmed finger meets, such as "
        "cylinder:d=40,x=70,z=-30 (mm): see objects.md",
    )
    wall_sd_mm: NotNegative | dict[str, NotNegative] = Field(
        default=0.1,
        description="tolerance of dimensions that no camera sees, walls and caps of the chamber, mm; or one "
        "for each, such as {bottom_wall_mm = 0.05}; 0: exact; a deck has none",
    )
    open: dict[str, tuple[Finite, Positive]] = Field(
        default={},
        description="dimensions of the chamber that are fitted, and what is known of them: value and sd, mm, "
        "such as {bottom_wall_mm = [2.0, 0.3]}; in place of wall_sd_mm: see bodies.md",
    )
    fixed: dict[str, Finite] = Field(
        default={}, description="constants of the law that are not fitted, such as {C10 = 0.214} (MPa)"
    )
    engine: Literal["embedded", "calculix", "abaqus"] = Field(
        default=EMBEDDED,
        description="what solves the model in calibrate, compare, add and drop; the others are programs of "
        "their own: see engines.md",
    )
    engine_cpus: int | None = Field(
        default=None, ge=1, le=1024, description="processors of a job; left out: 4 for abaqus, 1 for calculix"
    )
    engine_jobs: int | None = Field(
        default=None, ge=1, le=1024, description="jobs at a time; left out: 1 for abaqus, for calculix what "
        "the processors, or the workers of --cluster, have room for"
    )  # fmt: skip
    engine_memory: Memory | None = Field(
        default=None, description='memory of a job of Abaqus, such as "4 GB" or "60%", its default'
    )
    engine_command: Program | None = Field(
        default=None, description='name of the program on the search path, such as "abq2023" or "ccx_2.21"'
    )
    engine_timeout_s: float | None = Field(
        default=None, gt=0, le=1e6, description="seconds after which a job is killed, and its candidate is "
        "the worst one; left out: 3600"
    )  # fmt: skip
    finger: FingerTable | None = None
    pneunet: PneunetTable | None = None
    tube: TubeTable | None = None
    bar: BarTable | None = None

    @property
    def kind(self) -> str:
        """The kind of body: the one that is named, else a deck, else that whose dimensions are stated, else
        the finger."""
        return self.body or ("deck" if self.deck is not None else next(iter(self._stated), "finger"))

    @property
    def dimensions(self) -> BodyTable | None:
        """The dimensions of the body, those of a new one where none are stated; None of a deck."""
        if self.kind == "deck":
            return None
        stated = self._stated.get(self.kind) or BODIES[self.kind]()
        if not self.open:
            return stated
        means = {name: mean for name, (mean, _) in self.open.items()}
        return type(stated).model_validate({**stated.model_dump(), **means})

    @property
    def _stated(self) -> dict[str, BodyTable]:
        return {name: table for name in BODIES if (table := getattr(self, name)) is not None}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self._check_engine()
        self._check_open()
        if self.deck is not None and self._stated:
            raise ValueError(
                f"model.deck = {self.deck!r} and [model.{next(iter(self._stated))}] are both given: a "
                "deck has its own dimensions; remove one of them"
            )
        if (self.kind == "deck") != (self.deck is not None):
            raise ValueError(
                f"model.body = {self.body!r} and model.deck = {self.deck!r}: wanted body = \"deck\" with the "
                "file of a deck, and no deck with another body; correct one of them"
            )
        if others := [name for name in self._stated if name != self.kind]:
            raise ValueError(
                f"[model.{others[0]}] has the dimensions of another body than {self.kind}: remove that "
                f'table, or write body = "{others[0]}"'
            )
        return self

    def _check_open(self) -> None:
        if not self.open:
            if labels.OPEN in self.effects:
                raise ValueError(
                    f"model.effects: {labels.OPEN} without [model.open]; wanted there what dimensions are "
                    "open, such as bottom_wall_mm = [2.0, 0.3] (mm: value and sd), or no such effect"
                )
            return
        name = next(iter(self.open))
        if self.kind == "deck":
            raise ValueError(
                f"model.open.{name}: a deck's mesh moves with no dimension; wanted a body of this package: "
                "make decks of two values of the dimension, calibrate both, and compare what they leave, or "
                "remove [model.open]"
            )
        if self.engine != EMBEDDED:
            raise ValueError(
                f"model.open.{name} with engine = {self.engine!r}: only the embedded engine moves its mesh "
                "with a dimension; remove [model.open], or the engine"
            )
        inner = (self._stated.get(self.kind) or BODIES[self.kind]()).body.inner
        if unknown := sorted(set(self.open) - set(inner)):
            raise ValueError(
                f"model.open.{unknown[0]} is no dimension of the chamber of a {self.kind}; wanted some of "
                f"{', '.join(inner) or 'none: it has no chamber'}: markers would move with others"
            )
        assert self.dimensions is not None  # which raises where values do not fit together
        if labels.OPEN not in self.effects:
            self.__dict__["effects"] = (labels.OPEN, *self.effects)  # frozen, but not yet made

    def _check_engine(self) -> None:
        if self.engine != EMBEDDED and self.self_contact:
            raise ValueError(
                f"model.self_contact = true with engine = {self.engine!r}: only the embedded engine finds "
                "which walls meet; set it to false, or remove the engine"
            )
        keys: dict[str, object] = {"engine_cpus": self.engine_cpus, "engine_command": self.engine_command}
        keys |= {"engine_jobs": self.engine_jobs, "engine_memory": self.engine_memory}
        keys["engine_timeout_s"] = self.engine_timeout_s
        present = [key for key, value in keys.items() if value is not None]
        if self.engine == EMBEDDED and present:
            raise ValueError(
                f"model.{present[0]} = {keys[present[0]]!r}: the embedded engine takes none; remove it, or "
                'name another engine = "calculix" or "abaqus"'
            )
        if self.engine == "calculix" and self.engine_memory is not None:
            raise ValueError(
                f"model.engine_memory = {self.engine_memory!r}: CalculiX takes no limit of memory; remove it"
            )


class CalibrateTable(TableModel):
    seed: int = Field(default=1, ge=0, description="seed of the genetic algorithm")
    population: int = Field(default=30, ge=4, le=10_000, description="number of candidates in a generation")
    generations: int = Field(default=20, ge=1, le=10_000, description="number of generations")
    objective_points: tuple[Name, ...] = Field(
        default=("tip", "middle"),
        min_length=1,
        description="points whose RMS error the genetic algorithm minimises",
    )
    objective_component: Literal[1, 2, 3] = Field(
        default=3, description="component of that error: 1 x, 2 y, 3 z"
    )
    bounds: dict[str, Bounds] = Field(
        default={},
        description="lowest and highest value of each constant of the law in the genetic algorithm, such as "
        "{C10 = [0.01, 0.5]} (MPa); left out: usual ones. Least squares may take a C01 below 0, and a C10 "
        "above its bound for it, where 0 is allowed and while the rubber remains stable",
    )
    priors: dict[str, tuple[Finite, Positive]] = Field(
        default={},
        description="what is known of a parameter without these data, mean and sd in its unit, such as "
        "{C10 = [0.2, 0.05]}; also \"C10+C01\", share, and of an effect \"creep.g1\"",
    )
    loss: Literal["least-squares", "student-t"] = Field(
        default=LEAST_SQUARES,
        description="student-t: gross errors, such as a marker taken for another, hardly count",
    )
    ringing_Hz: Positive | None = Field(
        default=None,
        description="frequency at which the finger rings, as `twin check` or `twin ringing` tells: steps "
        "that its inertia moves by more than their sd are left out of all fits",
    )


class DiagnoseTable(TableModel):
    candidates: tuple[Effects, ...] = Field(
        default=(),
        description="effects that `twin diagnose` tries; none named: all",
    )
    seed: int = Field(default=1, ge=0, description="seed of the diagnosis")


class StudyTable(TableModel):
    other_pressure_MPa: Positive | None = Field(
        default=None, description="a second pressure that the source states, MPa"
    )
    initial: dict[str, NotNegative] = Field(
        default={},
        description="constants of the initial model, MPa, such as {C10 = 0.2, C01 = 0.1}; "
        "else those of `twin calibrate`",
    )
    published: dict[str, NotNegative] = Field(
        default={}, description="constants that the source found, MPa"
    )
    published_reduction_percent: Positive | None = Field(
        default=None, description="fall of its RMS error, %"
    )

    @model_validator(mode="after")
    def _both(self) -> Self:
        for key, values in (("initial", self.initial), ("published", self.published)):
            if values and set(values) != set(NAMES):
                raise ValueError(
                    f"{key} = {{{', '.join(values)}}}: wanted both {' and '.join(NAMES)} in MPa, or neither"
                )
            if values and not sum(values.values()) > 0.0:
                raise ValueError(f"{key}: {' and '.join(NAMES)} are both 0; wanted a sum above 0 MPa")
        return self


class Config(TableModel):
    """The whole of twin.toml."""

    project: ProjectTable = ProjectTable()
    model: ModelTable = ModelTable()
    cameras: tuple[CameraTable, ...] = ()
    films: tuple[FilmTable, ...] = ()
    pressure: PressureTable | None = None
    material_tests: tuple[MaterialTestTable, ...] = ()
    imports: tuple[RecordingTable, ...] = Field(default=(), alias="import")
    measure: MeasureTable = MeasureTable()
    frame: FrameTable = FrameTable()
    pose: PoseTable | None = None
    outline: OutlineTable | None = None
    points: tuple[PointTable, ...] = Field(min_length=1)
    dic: DicTable | None = None
    calibrate: CalibrateTable = CalibrateTable()
    diagnose: DiagnoseTable = DiagnoseTable()
    study: StudyTable | None = None

    @property
    def marks(self) -> tuple[MarkTable, ...]:
        """Everything that is followed: the markers on the rig, and the points on the finger."""
        return (*self.frame.markers, *self.points)

    @property
    def nodes(self) -> dict[str, int]:
        """The node labels of the points that have one, by name."""
        return {point.name: point.node for point in self.points if point.node is not None}

    @property
    def objective_points(self) -> tuple[str, ...]:
        """The points whose RMS error the genetic algorithm minimises."""
        stated = self.calibrate.objective_points
        free = "objective_points" not in self.calibrate.model_fields_set
        return usual_objective(self.points) if free else stated

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self.check()
        return self

    def check(self) -> None:
        """Raise ValueError where the tables do not go together."""
        for check in (_check_names, _check_parameters, _check_film, check_films):
            check(self)


def usual_objective(points: Sequence[PointTable]) -> tuple[str, ...]:
    """Names of tip and middle; without these of the outermost point, and of that nearest to half of its way.
    Points at nodes alone are taken as listed, the outermost last.

    >>> row = [PointTable(name=f"p{k}", position_mm=(10.0 * k, 0.0, 0.0)) for k in (5, 1, 2, 3)]
    >>> usual_objective(row)
    ('p5', 'p2')
    """
    names = [point.name for point in points]
    if {"tip", "middle"} <= {*names}:
        return ("tip", "middle")
    x = [k + 1.0 if p.position_mm is None else p.position_mm[0] for k, p in enumerate(points)]
    if len({point.position_mm is None for point in points}) > 1:
        x = [k + 1.0 for k in range(len(points))]
    outermost = max(x)
    middle = min(range(len(x)), key=lambda k: abs(x[k] - 0.5 * outermost))
    return tuple(dict.fromkeys((names[x.index(outermost)], names[middle])))


def _check_names(c: Config) -> None:
    tests = [test.name for test in c.material_tests]
    if len(set(tests)) < len(tests):
        raise ValueError(f"material_tests.name = {sorted(tests)}: a name stands twice; give each its own")
    nodes = [p.node for p in c.points if p.node is not None]
    places = [list(p.position_mm) for p in c.points if p.node is None and p.position_mm is not None]
    columns: dict[str, list[Any]] = {
        "name": [m.name for m in c.marks],
        "marker": [m.marker for m in c.marks if m.marker is not None],
        "node": nodes,
        "position_mm": [str(place) for place in places],
    }
    for key, used in columns.items():
        twice = [value for value, count in Counter(used).items() if count > 1]
        if twice:
            raise ValueError(
                f"{key} = {twice[0]!r} stands twice in [[points]] and [[frame.markers]]; give each its own"
            )
    for name in c.objective_points:
        if name not in [p.name for p in c.points]:
            raise ValueError(
                f"calibrate.objective_points = {name!r}: wanted a name in [[points]], which has "
                f"{', '.join(p.name for p in c.points)}"
            )


def _check_parameters(c: Config) -> None:
    bases = [labels.name_of(label) for label in c.model.effects]
    if len(set(bases)) != len(bases):
        raise ValueError(f"model.effects = {list(c.model.effects)}: an effect stands twice; keep it once")
    _check_priors(c.calibrate.priors)
    law = LAWS.get(c.model.law or (MOONEY_RIVLIN.name if c.model.deck is None else ""))
    for name, (low, high) in c.calibrate.bounds.items():
        if not low < high:
            raise ValueError(
                f"calibrate.bounds.{name} = [{low:g}, {high:g}]: wanted low < high; swap or widen them"
            )
    usual = law.bounds if law else {}
    for name, (low, high) in {**usual, **c.calibrate.bounds}.items():
        value = c.model.fixed.get(name, low)
        if not low <= value <= high:
            raise ValueError(
                f"model.fixed.{name} = {value:g}: wanted a value within calibrate.bounds.{name} = "
                f"[{low:g}, {high:g}]; widen the bounds or correct the value"
            )
    _check_bounds(c.calibrate.bounds, law)


def _check_bounds(bounds: dict[str, Bounds], law: RubberLaw | None) -> None:
    """Raise ValueError for a constant that the law does not have, or for bounds that no rubber has."""
    unknown = sorted(set(bounds) - set(law.names)) if law else []
    if law and unknown:
        raise ValueError(
            f"calibrate.bounds.{unknown[0]}: wanted {' and '.join(law.names)} alone; correct the name"
        )
    for name, (low, high) in bounds.items():
        if high > STIFFEST:
            raise ValueError(
                f"calibrate.bounds.{name} = [{low:g}, {high:g}]: wanted MPa, up to {STIFFEST:g}; soft "
                "silicone has 0.005 to 2 MPa; are they in kPa?"
            )
    least = law.scales({**law.bounds, **bounds})[0] if law else np.inf
    if law and not least > 0.0:
        raise ValueError(
            f"calibrate.bounds: {law.stiffness} may be as low as {least:g} MPa; wanted lowest values with a "
            "sum above 0, as in C10 = [0.01, 0.5]: rubber without stiffness has no equilibrium"
        )


def _check_priors(priors: dict[str, tuple[float, float]]) -> None:
    """Raise ValueError for a prior that no rubber has."""
    for name, (mean, sd) in priors.items():
        text = f"calibrate.priors.{name} = [{mean:g}, {sd:g}]"
        if name in ("C10", "C01", "C10+C01") and not abs(mean) <= STIFFEST:
            raise ValueError(f"{text}: wanted mean and sd in MPa, up to {STIFFEST:g}; are they in kPa?")
        if name == "share" and not abs(mean) <= 1.0:
            raise ValueError(f"{text}: wanted C01 / (C10 + C01), from 0 to 1")


def _check_film(c: Config) -> None:
    if measured := [point.name for point in c.points if point.is_measured and len(c.cameras) != 1]:
        raise ValueError(
            f"points.{measured[0]}: where it is on the finger is not stated; wanted position_mm = [x, y, z] "
            "in mm, or the label of a node, node = 4401; the film of one camera tells it, here are "
            f"{len(c.cameras)}"
        )
    if not c.cameras:
        return
    if c.imports:
        raise ValueError(
            "[import] and [[cameras]] both say where the displacements come from; keep one of them"
        )
    _check_rig(c)
    if c.pressure is None:
        raise ValueError(
            'pressure is missing: a film needs its pressure log; add [pressure] with file = "..."'
        )
    roles = [str(m.role) for m in c.frame.markers]
    if "clamp" in roles and (c.pose is not None or roles.count("clamp") < 2):
        raise ValueError(
            f'frame.markers: {roles.count("clamp")} with role "clamp"{" and [pose]" if c.pose else ""}; '
            "wanted two or more, which tell where the finger stands, or [pose], which states it"
        )
    if c.pose is not None and c.pose.source == "outline" and len(c.cameras) > 1:
        raise ValueError(
            f'pose.from = "outline" with {len(c.cameras)} [[cameras]]: wanted one; state x_mm, z_mm and '
            "turn_deg, or leave out the other cameras"
        )
    roles = ["fixed" if role == "clamp" else role for role in roles]
    read = bool(roles) or c.frame.sheet is None  # else the sheet's own are still to be read
    for role, least in (("frame", 6), ("fixed", 4)):
        if read and roles.count(role) < least:
            raise ValueError(
                f"frame.markers: {roles.count(role)} with role {role!r}, wanted {least} or more; "
                "mount more markers on the rig, or change their roles"
            )
    for mark in c.marks:
        if mark.size_mm is None:
            where = f"{'points' if mark in c.points else 'frame.markers'}.{mark.name}"
            raise ValueError(f"{where}.size_mm is missing: wanted the side of its marker in mm")


def _check_rig(c: Config) -> None:
    """Check that several cameras share a board and the markers."""
    if c.dic is not None and len(c.cameras) > 1:
        raise ValueError(
            "dic: wanted one [[cameras]]; the speckled face is measured with one camera in its plane"
        )
    features = ", ".join(point.name for point in c.points if point.seen_mm is not None)
    if features and len(c.cameras) > 1:
        raise ValueError(
            f"points {features}: seen_mm with {len(c.cameras)} [[cameras]]; wanted one: where a natural "
            "feature lies in the picture of another camera is not known; leave out the other cameras, or "
            "glue markers"
        )
    names = [camera.name for camera in c.cameras]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"cameras.name = {twice[0]!r} stands twice; give each camera its own")
    for camera in c.cameras[1:]:
        if camera.board != c.cameras[0].board or None in (camera.board, c.cameras[0].board):
            raise ValueError(
                f"cameras {names[0]!r} and {camera.name!r}: wanted boards and one [cameras.board] in both; "
                "where they stand to each other is known from pictures of one board that both take"
            )
        if camera.dictionary != c.cameras[0].dictionary:
            raise ValueError(
                f"cameras {names[0]!r} and {camera.name!r} have different dictionaries: they see the same "
                "markers; write the same in both"
            )


# -- several films -------------------------------------------------------------------------------------------

CLOCK = ("film_start_s", "static_start_s")


def with_first_film(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of twin.toml with the first of [[films]], where there are any, as the film of the one
    camera. ValueError where the camera names another."""
    if not isinstance(data.get("films"), list) or not data["films"]:
        return data
    cameras, film = data.get("cameras"), data["films"][0]
    if not isinstance(cameras, list | tuple) or len(cameras) != 1:
        raise ValueError(
            f"films: wanted one [[cameras]] with several films, found {len(cameras or ())}; measure with one "
            "camera, or give each camera its one film"
        )
    if not isinstance(film, dict) or not isinstance(cameras[0], dict):
        return data
    keys = {"film": film.get("file"), **{key: film.get(key) for key in CLOCK}}
    for key, value in keys.items():
        if cameras[0].get(key) not in (None, value):
            raise ValueError(
                f"cameras.{key} = {cameras[0][key]!r} beside [[films]]: each film states its own; remove it "
                "from [[cameras]]"
            )
    keys["static"] = cameras[0].get("static") or film.get("static")
    present = {key: value for key, value in keys.items() if value is not None}
    return {**data, "cameras": [{**cameras[0], **present}]}


def with_recordings(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of twin.toml with [[import]] as an array, each with a name, where it has a file."""
    several = data.get("import")
    if not isinstance(several, dict | list):
        return data
    tables = [several] if isinstance(several, dict) else several
    return {**data, "import": [
        {"name": plain(PurePosixPath(t["file"]).stem), **t}
        if isinstance(t, dict) and isinstance(t.get("file"), str)
        else t for t in tables
    ]}  # fmt: skip


def with_join(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of twin.toml with a log that is joined by the motion, where no film says when it starts."""
    pressure = data.get("pressure")
    tables = [t for key in ("cameras", "films") for t in data.get(key) or () if isinstance(t, dict)]
    stated = not tables or any(CLOCK[0] in table for table in tables)
    if stated or not isinstance(pressure, dict) or "join" in pressure:
        return data
    return {**data, "pressure": {**pressure, "join": "onset"}}


def check_films(c: Config) -> None:
    """Raise ValueError where [[films]], or [[import]], do not go together."""
    if c.films and c.dic is not None:
        raise ValueError("films: [dic] takes one film; remove [[films]] or [dic]")
    _check_recordings(c, "films", "film", c.films)
    _check_recordings(c, "import", "recording", c.imports)


def _check_recordings(
    c: Config, table: str, one: str, recordings: Sequence[FilmTable | RecordingTable]
) -> None:
    """Raise ValueError where recordings do not go together; one: what each is, of the array `table`."""
    for key in ("name", "file"):
        twice = [v for v, count in Counter(getattr(r, key) for r in recordings).items() if count > 1]
        if twice:
            raise ValueError(
                f"{table}.{key} = {twice[0]!r} stands twice in [[{table}]]; give each {one} its own"
            )
    if recordings and all(r.held_out for r in recordings):
        raise ValueError(
            f"{table}: all {len(recordings)} have held_out = true, so nothing is left to fit; take it away "
            "from one of them"
        )
    stating = [r.name for r in recordings if r.gravity is not None]
    if stating and len(stating) < len(recordings):
        raise ValueError(
            f"{table}: gravity stands in {', '.join(stating)} and not in the others; wanted it in every "
            f"{one}, or in none and under [model]"
        )
    if stating and c.model.gravity is not None:
        raise ValueError(
            f"model.gravity = {list(c.model.gravity)} beside gravity in [[{table}]]: wanted it in one place; "
            "remove it from [model]"
        )
    shares_by_surface({f"{table}: {r.name}": r.pressure_shares for r in recordings})
