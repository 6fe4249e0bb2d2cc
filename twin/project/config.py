"""Turn twin.toml into a checked, frozen configuration; one field here is one key there."""

from collections import Counter
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from twin.bodies.bar import BarTable
from twin.bodies.finger import FingerTable
from twin.bodies.kinds import BODIES, BodyTable
from twin.bodies.pneunet import PneunetTable
from twin.bodies.tube import TubeTable
from twin.effects import labels
from twin.laws.catalogue import LAWS, named_law
from twin.laws.law import RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NAMES
from twin.project.chambers import Shares, shares_by_surface
from twin.tablemodel import (
    Bounds,
    Density,
    Dictionary,
    Direction,
    Finite,
    Label,
    Length,
    Memory,
    Name,
    NotNegative,
    OtherProject,
    Position,
    Positive,
    Program,
    RelativePath,
    SdMm,
    Share,
    StaticStart,
    StillSteps,
    TableModel,
)


def _law_name(name: str) -> str:
    return named_law(name).name


LawName = Annotated[str, AfterValidator(_law_name)]
Effect = Annotated[str, AfterValidator(labels.checked)]
Effects = Annotated[str, AfterValidator(labels.checked_groups)]
EMBEDDED: Literal["embedded"] = "embedded"  # this package's own kernel
LIKELY = 0.6  # the value below which DeepLabCut itself draws no point (pcutoff in its config.yaml)
LEAST_SQUARES: Literal["least-squares"] = "least-squares"  # of normal errors
STUDENT: Literal["student-t"] = "student-t"
STIFFEST = 100.0  # MPa, of a constant that may be fitted: hard rubber has 10


# Keys of [[material_tests]] of which one is enough.
MATERIAL_EITHER = (
    ("strain", "stretch"), ("strain", "displacement"), ("stretch", "displacement"), ("stress", "force"),
    ("strain", "length_mm"), ("stretch", "length_mm"), ("stress", "area_mm2"),
)  # fmt: skip

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
        return None if self.kind == "deck" else self._stated.get(self.kind) or BODIES[self.kind]()

    @property
    def _stated(self) -> dict[str, BodyTable]:
        return {name: table for name in BODIES if (table := getattr(self, name)) is not None}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self._check_engine()
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

    def _check_engine(self) -> None:
        if self.engine != EMBEDDED and self.self_contact:
            raise ValueError(
                f"model.self_contact = true with engine = {self.engine!r}: only the embedded engine finds "
                "which walls meet; set it to false, or remove the engine"
            )
        own = {"engine_cpus": self.engine_cpus, "engine_command": self.engine_command}
        own |= {"engine_jobs": self.engine_jobs, "engine_memory": self.engine_memory}
        stated = [key for key, value in own.items() if value is not None]
        if self.engine == EMBEDDED and stated:
            raise ValueError(
                f"model.{stated[0]} = {own[stated[0]]!r}: the embedded engine takes none; remove it, or name "
                'another engine = "calculix" or "abaqus"'
            )
        if self.engine == "calculix" and self.engine_memory is not None:
            raise ValueError(
                f"model.engine_memory = {self.engine_memory!r}: CalculiX takes no limit of memory; remove it"
            )


class BoardTable(TableModel):
    kind: Literal["charuco", "chessboard", "circles", "acircles", "codedcircles"] = Field(
        default="charuco",
        description="acircles: every other row shifted; codedcircles: three are rings or larger",
    )
    columns: int = Field(
        ge=2, le=1000, description="number across: squares (charuco), inner corners (chessboard) or circles"
    )
    rows: int = Field(ge=2, le=1000, description="number down, counted alike")
    square_mm: Positive = Field(
        description="measured side of a square, or distance of circles (acircles: of rows), mm"
    )
    marker_mm: Positive | None = Field(
        default=None, description="measured side of a marker of a charuco board, mm"
    )
    dictionary: Dictionary = Field(
        default="DICT_4X4_50", description="ArUco dictionary of the board: a name, or a file of your own"
    )
    coding: tuple[tuple[int, int], ...] = Field(
        default=(),
        description="for codedcircles: column and row of the three coding dots, from 0 at the"
        " top left, such as [[2, 2], [10, 2], [2, 7]]",
    )
    inverted: bool = Field(default=False, description="whether the board is white on black")
    mirrored: bool = Field(
        default=False,
        description="whether the board is printed mirrored, or filmed from behind",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.kind == "codedcircles") != (len(self.coding) == 3):
            raise ValueError(
                f"coding = {[list(dot) for dot in self.coding]}: wanted column and row of the three coding "
                "dots with codedcircles, and no coding with another kind"
            )
        if self.kind != "charuco":
            return self
        if self.marker_mm is None:
            raise ValueError("marker_mm is missing: wanted the measured side of the charuco markers in mm")
        if self.marker_mm >= self.square_mm:
            raise ValueError(
                f"marker_mm = {self.marker_mm:g}: wanted less than square_mm = {self.square_mm:g} mm; "
                "measure both on the printed board"
            )
        return self


class FilmTable(TableModel):
    """One of several films of a batch."""

    name: Name = Field(description="name of the film")
    file: RelativePath = Field(description="the film, or pictures: a folder or a pattern")
    static: RelativePath | None = Field(
        default=None,
        description="its own static film; left out: that of [[cameras]]",
    )
    pressure: RelativePath | None = Field(
        default=None,
        description="its own pressure log; left out: that of [pressure]",
    )
    film_start_s: Finite = Field(
        default=0.0, description="time of its first frame on the clock of its log, s"
    )
    static_start_s: StaticStart = None
    gravity: Direction | None = Field(
        default=None,
        description="direction of gravity where the rig was turned; in every film, or in none",
    )
    pressure_shares: Shares = Field(
        default_factory=dict,
        description="of a deck with several chambers: what of the pressure each surface carries in this "
        "film, such as {LEFT = 1.0, RIGHT = 0.0}; in every film, or in none",
    )
    held_out: bool = Field(
        default=False, description="true: predicted, never fitted"
    )


class CameraTable(TableModel):
    name: Name = Field(description="name of the camera")
    film: RelativePath = Field(
        description="film of the test, or pictures: a folder, or a pattern such as raw/film-*.png"
    )
    fps: Positive | None = Field(
        default=None, description="frame rate of pictures without times.csv, 1/s"
    )
    static: RelativePath = Field(
        description="film of the finger at rest, 300 frames or more, which gives the noise"
    )
    boards: RelativePath | None = Field(
        default=None,
        description="the calibration board: pictures such as raw/boards/*.png, or a film, raw/boards.mp4",
    )
    board_times: RelativePath | None = Field(
        default=None,
        description="CSV with columns camera,time_s for the board's films; else they start together",
    )
    camera_file: RelativePath | None = Field(
        default=None,
        description="in place of boards: another program's calibration, such as OpenCV YAML",
    )
    dictionary: Dictionary = Field(
        default="DICT_4X4_50", description="ArUco dictionary of the markers: a name, or a file of your own"
    )
    mirrored: bool = Field(
        default=False,
        description="whether all its films and pictures are mirrored",
    )
    film_start_s: Finite = Field(
        default=0.0, description="time of the film's first frame on the clock of the pressure log, s"
    )
    static_start_s: StaticStart = None
    readout_ms: Positive | None = Field(
        default=None, description="rolling shutter: time from the first row of a frame to the last, ms"
    )
    max_rms_px: Positive = Field(
        default=0.3, description="largest reprojection RMS that is accepted, px"
    )
    board: BoardTable | None = None

    @model_validator(mode="after")
    def _calibrated(self) -> Self:
        if self.camera_file is None and (self.boards is None or self.board is None):
            raise ValueError(
                f"cameras {self.name!r} has no calibration: give boards and [cameras.board], or camera_file"
            )
        if self.board_times is not None and self.boards is None:
            raise ValueError(f"cameras {self.name!r} has board_times but no boards: name the board's film")
        if self.camera_file is not None and self.boards is not None:
            raise ValueError(f"cameras {self.name!r} has boards and camera_file: keep one of them")
        return self


class PressureTable(TableModel):
    file: RelativePath = Field(
        default="raw/pressure.csv",
        description="pressure log, a CSV file with columns such as time_s,pressure_MPa or t [ms],p [bar]",
    )
    column: str | None = Field(
        default=None, description="heading of the pressure, where it cannot be told"
    )
    unit: str | None = Field(
        default=None,
        description="unit where the heading has none: MPa, kPa, Pa, hPa, bar, mbar, psi or V",
    )
    volt_zero: Finite | None = Field(
        default=None, description="gauge that gives volts: reading at no pressure, V"
    )
    MPa_per_V: Finite | None = Field(
        default=None, description="gauge that gives volts: sensitivity, MPa/V"
    )
    top_kPa: Positive | None = Field(
        default=None, description="what the regulator was set to at most, kPa; tells a wrong unit of the log"
    )
    time_shift_s: Finite = Field(default=0.0, description="added to the times of the log, s")
    sync_sd_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = Field(
        default=0.002, description="sd of film_start_s where join is stamps, s"
    )
    join: Literal["stamps", "flash", "onset"] = Field(
        default="stamps",
        description="synchronise film and log by film_start_s, a lamp, or the first motion",
    )
    flash_region: tuple[int, int, int, int] | None = Field(
        default=None, description="where the lamp is in the film, [x, y, width, height] in px"
    )
    flash_time_s: Finite | None = Field(
        default=None,
        description="time of the lamp on the clock of the log, s; else the log's column flash",
    )

    @model_validator(mode="after")
    def _joined(self) -> Self:
        if (self.volt_zero is None) != (self.MPa_per_V is None) or self.MPa_per_V == 0:
            raise ValueError(
                "volt_zero and MPa_per_V are the calibration line of a gauge: wanted both, MPa_per_V "
                "not 0, or none"
            )
        if self.join == "flash" and self.flash_region is None:
            raise ValueError('join = "flash" needs flash_region = [x, y, width, height] in px of the film')
        return self


class MaterialTestTable(TableModel):
    """A test of the silicone itself, which is fitted beside the film."""

    name: Name = Field(description="name of the test, such as tension")
    file: RelativePath = Field(
        description="what the tester wrote, a CSV file such as raw/tension.csv, with lines above its header"
    )
    kind: Literal["uniaxial", "planar", "equibiaxial", "shear", "compression"] = Field(
        description="uniaxial: a strip or dumbbell; planar: a wide sheet (pure shear); equibiaxial: both "
        "ways alike, or a bubble; shear: a block, whose strain is the amount of shear; compression: a "
        "lubricated cylinder, whatever signs its file has"
    )
    strain: str | None = Field(default=None, description="heading of the strain, where it cannot be told")
    stretch: str | None = Field(default=None, description="heading of the stretch, in place of strain")
    displacement: str | None = Field(
        default=None, description="heading of the displacement, in place of strain; with length_mm"
    )
    stress: str | None = Field(default=None, description="heading of the stress, where it cannot be told")
    force: str | None = Field(
        default=None, description="heading of the force, in place of stress; with area_mm2"
    )
    time: str | None = Field(
        default=None, description="heading of the time, where it cannot be told; a model that creeps needs it"
    )
    strain_unit: str | None = Field(
        default=None, description='unit where the heading has none: "%", "mm/mm", or "mm" of a displacement'
    )
    stress_unit: str | None = Field(
        default=None, description='unit where the heading has none: "MPa", "kPa", "psi", or "N" of a force'
    )
    true_strain: bool = Field(
        default=False, description="true: the strain is logarithmic; false: change over length at rest"
    )
    true_stress: bool = Field(
        default=False, description="true: force over area of now; false: over area at rest"
    )
    length_mm: Positive | None = Field(
        default=None,
        description="length at rest that the displacement is over, mm; of shear the thickness",
    )
    area_mm2: Positive | None = Field(
        default=None, description="area at rest that the force is over, mm2"
    )
    sd_MPa: Positive = Field(
        description="sd of one stress alone, MPa: noise of the load cell over the area"
    )
    sd_percent: Annotated[float, Field(ge=0, le=50)] = Field(
        default=0.0, description="further sd of one stress alone, % of it"
    )
    scale_percent: Annotated[float, Field(gt=0, le=50)] = Field(
        description="sd of an error that all its stresses share, %: area of the specimen and load cell"
    )
    zero_percent: Annotated[float, Field(ge=0, le=20)] = Field(
        default=0.0, description="sd of the zero of the strain, in % of strain: slack"
    )
    stretch_up_to: Annotated[float, Field(gt=1.0, le=20.0)] | None = Field(
        default=None,
        description="largest stretch that is used; left out: 1.2 times the largest in the finger",
    )
    cycle: int = Field(
        default=1, ge=1, le=1000, description="which loading branch is used, where there are several"
    )

    @property
    def specimen(self) -> Literal["uniaxial", "planar", "equibiaxial", "shear"]:
        """How the specimen is strained."""
        return "uniaxial" if self.kind == "compression" else self.kind

    @model_validator(mode="after")
    def _fits(self) -> Self:
        given, where = self.model_fields_set, f"material_tests.{self.name}"
        for one, other in MATERIAL_EITHER:
            if {one, other} <= given:
                raise ValueError(f"{where}: {one} and {other} are both given; keep one of them")
        for key, size in (("displacement", "length_mm"), ("force", "area_mm2")):
            if key in given and size not in given:
                raise ValueError(f"{where}: {key} without {size}; add {size}, of the specimen at rest")
        if self.kind == "shear" and (self.true_strain or self.true_stress):
            raise ValueError(f"{where}: true_strain and true_stress are for tension; remove them")
        return self


class ImportTable(TableModel):
    """Displacements that another program measured, and what its file does not say of them."""

    file: RelativePath = Field(
        description="file or folder of the other program, such as raw/film.csv"
    )
    format: Literal["deeplabcut", "anipose", "dice", "matchid", "c3d", "csv"] = Field(
        description="program or format"
    )
    sd_mm: SdMm | None = Field(
        default=None,
        description="sd of one position, mm, while the finger is still; wanted without still_steps",
    )
    rho: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0, description="correlation of that error with the one in the row before"
    )
    still_steps: StillSteps | None = Field(
        default=None,
        description="first and last rows of rests and holds, whose scatter is the noise; or \"holds\"",
    )
    mm_per_px: Positive | None = Field(
        default=None,
        description="size of a pixel, mm; wanted where the file is in pixels",
    )
    scale_sd: Share = Field(
        default=0.001, description="relative sd of mm_per_px"
    )
    axes: str | None = Field(
        default=None,
        description="the file's axes along, across and up, 0: not seen; x,0,-y: finger to the right",
    )
    fps: Positive | None = Field(
        default=None,
        description="frames in a second, where the file counts frames; 1 for single load steps",
    )
    log: RelativePath | None = Field(
        default=None,
        description="pressure log, with times or one row a step; wanted where the file has no pressure",
    )
    log_unit: str | None = Field(
        default=None, description="unit of that pressure, where its heading has none"
    )
    start_s: Finite = Field(
        default=0.0, description="time of the first frame on the clock of the log, s"
    )
    rest_steps: int = Field(
        default=1,
        ge=1,
        description="number of first steps, at rest, that displacements are relative to",
    )
    fixed: tuple[str, ...] = Field(
        default=(), description="names of markers on the rig"
    )
    origin_mm: Position | None = Field(
        default=None,
        description="the file's origin in world axes, mm; then points not in [[points]] count too",
    )
    min_likelihood: Annotated[float, Field(ge=0, le=1)] = Field(
        default=LIKELY,
        description="likelihood or score below which a point is not seen (deeplabcut, anipose)",
    )


class MeasureTable(TableModel):
    placement_sd_mm: SdMm = Field(default=0.3, description="distance of a marker from its node, mm")
    scale_sd: Share = Field(default=0.001, description="relative error of the mm scale")
    frame_sd_mm: SdMm = Field(
        default=0.1, description="distance of a frame marker from its stated position, mm"
    )
    node_sd_mm: SdMm = Field(
        default=0.1, description="distance of the finger's point from the model's node, mm"
    )
    height_sd_mm: SdMm = Field(
        default=0.3,
        description="error of a marker's distance from the frame markers' plane, mm",
    )
    out_of_plane_sd_mm: SdMm = Field(
        default=0.3,
        description="motion of a marker towards the camera at its largest displacement, mm",
    )
    reference_s: Positive = Field(
        default=1.8,
        description="rest at the start of the film that displacements are relative to, s",
    )
    steps: int = Field(
        default=2000,
        ge=2,
        description="largest number of evenly spaced frames kept as targets; tracking uses every frame",
    )
    corrections: RelativePath | None = Field(
        default=None,
        description="what you mend of the tracks by hand, such as raw/corrections.csv; see files.md",
    )


class MarkTable(TableModel):
    """What is glued, or seen in the silicone: on the rig or on the finger."""

    name: Name = Field(description="name in targets and reports")
    marker: int | None = Field(default=None, ge=0, le=10**6, description="ArUco id; none for a plain dot")
    size_mm: Positive | None = Field(
        default=None, description="side of the marker, or diameter of a dot, mm; needed with a film"
    )


class MarkerTable(MarkTable):
    """A marker on the rig."""

    role: Literal["frame", "fixed"] = Field(
        description="frame: defines the world axes (6 or more); fixed: must show no motion (4 or more)"
    )
    position_mm: Position = Field(description="position of its centre in world axes, mm")


class FrameTable(TableModel):
    markers: tuple[MarkerTable, ...] = Field(default=(), description="markers on the rig")


class PointTable(MarkTable):
    """A point on the finger."""

    node: Label | None = Field(
        default=None,
        description="label of the node in the model; or give position_mm",
    )
    position_mm: Position | None = Field(
        default=None,
        description="its centre without load, mm; the model takes its nearest place, or node",
    )
    seen_mm: tuple[Length, Length] | None = Field(
        default=None,
        description="x and z of a natural feature in the first picture, mm; `twin pick` writes it",
    )

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.node is None and self.position_mm is None:
            raise ValueError(
                f"points.{self.name}: where it is on the finger is not stated; wanted position_mm = [x, y, "
                "z] in mm, or the label of a node, node = 4401"
            )
        if self.seen_mm is not None and self.marker is not None:
            raise ValueError(
                f"points.{self.name} has marker = {self.marker} and seen_mm: wanted one of them; seen_mm is "
                "for a natural feature without a marker"
            )
        return self


class DicTable(TableModel):
    low_mm: tuple[Length, Length] = Field(description="smallest x and z of the speckled part at rest, mm")
    high_mm: tuple[Length, Length] = Field(description="largest x and z of the speckled part at rest, mm")
    y_mm: Length = Field(description="y of the face, mm; it must be flat")
    step_mm: Positive = Field(default=4.0, description="distance from one measured point to the next, mm")
    subset_mm: Positive = Field(
        default=6.0,
        description="side of the square followed around each point, mm; wanted 15 px and 5 speckles or more",
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
    imported: ImportTable | None = Field(default=None, alias="import")
    measure: MeasureTable = MeasureTable()
    frame: FrameTable = FrameTable()
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

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for check in (_check_names, _check_parameters, _check_film, check_films):
            check(self)
        return self


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
    for name in c.calibrate.objective_points:
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
    if not c.cameras:
        return
    if c.imported is not None:
        raise ValueError(
            "[import] and [[cameras]] both say where the displacements come from; keep one of them"
        )
    _check_rig(c)
    if c.pressure is None:
        raise ValueError(
            'pressure is missing: a film needs its pressure log; add [pressure] with file = "..."'
        )
    roles = [str(m.role) for m in c.frame.markers]
    for role, least in (("frame", 6), ("fixed", 4)):
        if roles.count(role) < least:
            raise ValueError(
                f"frame.markers: {roles.count(role)} with role {role!r}, wanted {least} or more; "
                "mount more markers on the rig, or change their roles"
            )
    for mark in c.marks:
        if mark.size_mm is None:
            where = f"{'points' if mark in c.points else 'frame.markers'}.{mark.name}"
            raise ValueError(f"{where}.size_mm is missing: wanted the side of its marker in mm")


def _check_rig(c: Config) -> None:
    """Several cameras look at one board and at the same markers."""
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
    cameras, first = data.get("cameras"), data["films"][0]
    if not isinstance(cameras, list | tuple) or len(cameras) != 1:
        raise ValueError(
            f"films: wanted one [[cameras]] with several films, found {len(cameras or ())}; measure with one "
            "camera, or give each camera its one film"
        )
    if not isinstance(first, dict) or not isinstance(cameras[0], dict):
        return data
    own = {"film": first.get("file"), **{key: first.get(key) for key in CLOCK}}
    for key, value in own.items():
        if cameras[0].get(key) not in (None, value):
            raise ValueError(
                f"cameras.{key} = {cameras[0][key]!r} beside [[films]]: each film states its own; remove it "
                "from [[cameras]]"
            )
    own["static"] = cameras[0].get("static") or first.get("static")
    stated = {key: value for key, value in own.items() if value is not None}
    return {**data, "cameras": [{**cameras[0], **stated}]}


def check_films(c: Config) -> None:
    """Raise ValueError where [[films]] do not go together."""
    for key in ("name", "file"):
        twice = [v for v, count in Counter(getattr(film, key) for film in c.films).items() if count > 1]
        if twice:
            raise ValueError(f"films.{key} = {twice[0]!r} stands twice in [[films]]; give each film its own")
    if c.films and all(film.held_out for film in c.films):
        raise ValueError(
            f"films: all {len(c.films)} have held_out = true, so nothing is left to fit; take it away "
            "from one of them"
        )
    if c.films and c.dic is not None:
        raise ValueError("films: [dic] takes one film; remove [[films]] or [dic]")
    _check_gravity(c)
    shares_by_surface({f"films: {film.name}": film.pressure_shares for film in c.films})


def _check_gravity(c: Config) -> None:
    """Raise ValueError where some films state gravity and others do not, or it is stated twice."""
    stated = [film.name for film in c.films if film.gravity is not None]
    if stated and len(stated) < len(c.films):
        raise ValueError(
            f"films: gravity stands in {', '.join(stated)} and not in the others; wanted it in every film, "
            "or in none and under [model]"
        )
    if stated and c.model.gravity is not None:
        raise ValueError(
            f"model.gravity = {list(c.model.gravity)} beside gravity in [[films]]: wanted it in one place; "
            "remove it from [model]"
        )
