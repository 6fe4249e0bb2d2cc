"""The table [[material_tests]] of twin.toml: what a tester's file is, and the errors of its values."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.tablemodel import Name, Positive, RelativePath, TableModel

# Keys of [[material_tests]] of which one is enough.
MATERIAL_EITHER = (
    ("strain", "stretch"), ("strain", "displacement"), ("stretch", "displacement"), ("stress", "force"),
    ("strain", "length_mm"), ("stretch", "length_mm"), ("stress", "area_mm2"),
)  # fmt: skip


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
    area_mm2: Positive | None = Field(default=None, description="area at rest that the force is over, mm2")
    sd_MPa: Positive = Field(description="sd of one stress alone, MPa: noise of the load cell over the area")
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

    holds: Literal["instant", "relaxed"] = Field(
        default="instant",
        description="which stress of a step that is held is used: at its beginning, or at its end",
    )
    export_number: int = Field(
        default=1, ge=1, le=1000, description="which specimen is used, where the export has several"
    )

    @property
    def specimen(self) -> Literal["uniaxial", "planar", "equibiaxial", "shear"]:
        """Deformation of the specimen, as `fe.homogeneous` names it."""
        return "uniaxial" if self.kind == "compression" else self.kind

    @model_validator(mode="after")
    def _fits(self) -> Self:
        present, where = self.model_fields_set, f"material_tests.{self.name}"
        for a, b in MATERIAL_EITHER:
            if {a, b} <= present:
                raise ValueError(f"{where}: {a} and {b} are both given; keep one of them")
        for key, size in (("displacement", "length_mm"), ("force", "area_mm2")):
            if key in present and size not in present:
                raise ValueError(f"{where}: {key} without {size}; add {size}, of the specimen at rest")
        if self.kind == "shear" and (self.true_strain or self.true_stress):
            raise ValueError(f"{where}: true_strain and true_stress are for tension; remove them")
        return self
