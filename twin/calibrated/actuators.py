"""Actuators to be calibrated: a built-in body with its dimensions, or a deck, and the law of its silicone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from twin.bodies.finger import BuiltIn
from twin.bodies.kinds import BODIES
from twin.calibrated.positions import on_structure, placed
from twin.calibrated.problem import CalibrationProblem
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect
from twin.gravity import density
from twin.laws.catalogue import named_law
from twin.marktables import PointTable
from twin.model.objects import RigidObject
from twin.model.structure import Structure, beside, closed, in_law, of_body, of_deck, weighed
from twin.targets import PointKind, Targets
from twin.validation import checked

if TYPE_CHECKING:
    from fe import Lattice


class ModelOptions(TypedDict, total=False):
    """What an actuator may have beside its shape and law; see `built_in`."""

    density_kg_m3: float | None
    self_contact: bool
    obstacle: str
    effects: Sequence[str]
    own: Sequence[Effect]
    fixed: Mapping[str, float] | None
    bounds: Mapping[str, tuple[float, float]] | None
    mesh_error: bool


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """A soft actuator: its structure, which constants of its silicone are free, and effects beside them.

    effects: labels such as "creep:2". own: effects of the user's own, which labels may name. mesh_error:
    whether finer meshes tell the error of this one; bends_down: whether it bends to -z whatever is wrong.
    """

    structure: Structure
    elasticity: Elasticity
    effects: tuple[str, ...] = ()
    own: tuple[Effect, ...] = ()
    bends_down: bool = False
    mesh_error: bool = True

    def __str__(self) -> str:
        law, case = self.elasticity.law, self.structure.case
        effects = f", with {', '.join(self.effects)}" if self.effects else ""
        return f"{len(case.nodes)} nodes, {law.title} silicone ({', '.join(law.names)}){effects}"

    def problem(self, data: Targets) -> CalibrationProblem:
        """The calibration problem of data (`read_table`): points at the nearest places of the surface.
        ValueError where a point is not on the actuator, or the data cannot be its displacements."""
        if not isinstance(data, Targets):
            raise ValueError(f"data: {type(data).__name__}; wanted the targets of twin.read_table(...)")
        case = self.structure.case
        if case.pressurised and np.ptp(data.log_pressure) == 0:
            raise ValueError(
                f"the table: the pressure is {1e3 * data.log_pressure[0]:.4g} kPa in all rows; wanted rows "
                "at rest and under pressure"
            )
        points = [
            PointTable(name=point.name, position_mm=point.position)
            for point in data.points
            if point.kind is PointKind.PLACE
        ]
        targets, remarks = on_structure(
            data, placed(points, self.structure, mirrored=False), case, name="the table",
            wanted="its place under points=, (x, y, z) in mm or the label of its node",
            bends_down=self.bends_down,
        )  # fmt: skip
        return CalibrationProblem(
            targets, self.structure, self.elasticity, remarks, effects=self.effects, own=self.own,
            mesh_error=self.mesh_error,
        )  # fmt: skip


def finger(*, lattice: "Lattice | None" = None, **stated: Any) -> Actuator:
    """The bellows finger: dimensions as under [model.finger] of twin.toml, such as length_mm=92, pleats=8;
    none: the finger of the reference study. Other keys are those of `built_in`. ValueError for a dimension
    that it does not have, or that cannot be meshed. lattice: how it is divided into elements.

    >>> print(finger(length_mm=60, pleats=4))
    7455 nodes, Mooney-Rivlin silicone (C10, C01)
    """
    return built_in("finger", lattice=lattice, **stated)


def pneunet(**stated: Any) -> Actuator:
    """A PneuNet, a row of chambers over a bottom: dimensions as under [model.pneunet], such as chambers=6."""
    return built_in("pneunet", **stated)


def tube(**stated: Any) -> Actuator:
    """A tube with a chamber off its axis: dimensions as under [model.tube], such as length_mm=80."""
    return built_in("tube", **stated)


def bar(**stated: Any) -> Actuator:
    """A bar without a chamber, which bends by its weight or hung loads: dimensions as under [model.bar].

    >>> print(bar(density_kg_m3=1070))
    225 nodes, Mooney-Rivlin silicone (C10, C01)
    >>> bar(law="neo-hooke", effects=["creep"]).elasticity.law.names
    ('C10',)
    """
    return built_in("bar", **stated)


def built_in(
    kind: str,
    *,
    lattice: "Lattice | None" = None,
    refine: int = 1,
    law: str = "mooney-rivlin",
    **stated: Any,
) -> Actuator:
    """A body of a kind (finger, pneunet, tube, bar) with its dimensions, and `ModelOptions` beside them.

    refine: 2 halves all elements. law: of the silicone (`twin.laws.catalogue`). density_kg_m3: with weight.
    obstacle: a rigid object that it meets, such as "cylinder:d=40,x=70,z=-30". fixed: constants that are not
    fitted, bounds: lowest and highest values, MPa. mesh_error=False: the mesh is taken as exact.
    """
    dimensions = {key: value for key, value in stated.items() if key not in ModelOptions.__annotations__}
    options: Any = {key: value for key, value in stated.items() if key not in dimensions}
    table = checked(BODIES[kind], dimensions, name=kind)
    if refine < 1:
        raise ValueError(f"refine = {refine}: wanted 1, or 2 to halve all elements")
    body = BuiltIn() if kind == "finger" and not dimensions else table.body
    if lattice is not None:
        assert isinstance(body, BuiltIn)
        body = replace(body, lattice=lattice)
    structure = in_law(of_body(body, refine=refine), named_law(law).nominal)
    return _actuator(structure, bends_down=body.bends_down, **options)


def deck(
    path: str | Path,
    *,
    refine: int = 1,
    silicone: Sequence[str] = (),
    law: str | None = None,
    **options: Unpack[ModelOptions],
) -> Actuator:
    """The actuator of an Abaqus deck. silicone: element sets whose constants are fitted, by default all; law:
    by default the deck's own; the others as in `built_in`. ValueError where the deck is not right."""
    if not Path(path).is_file():
        raise ValueError(f"{path}: no such file; wanted an Abaqus deck such as finger.inp")
    structure = of_deck(
        Path(path), mesh=refine, silicone=tuple(silicone), law=None if law is None else named_law(law)
    )
    return _actuator(structure, bends_down=False, **options)


def _actuator(
    structure: Structure, *, bends_down: bool, density_kg_m3: float | None = None, self_contact: bool = False,
    obstacle: str = "", effects: Sequence[str] = (), own: Sequence[Effect] = (),
    fixed: Mapping[str, float] | None = None, bounds: Mapping[str, tuple[float, float]] | None = None,
    mesh_error: bool = True,
) -> Actuator:  # fmt: skip
    structure = closed(structure) if self_contact else structure
    if density_kg_m3 is not None and not 100 <= density_kg_m3 <= 20000:
        raise ValueError(f"density_kg_m3 = {density_kg_m3:g}: wanted kg/m3, such as 1070")
    structure = structure if density_kg_m3 is None else weighed(structure, density(density_kg_m3))
    structure = beside(structure, RigidObject.of(obstacle)) if obstacle else structure
    nominal, held = structure.nominal, dict(fixed or {})
    for key, named in (("fixed", held), ("bounds", bounds or {})):
        if unknown := sorted(set(named) - set(nominal.law.names)):
            raise ValueError(f"{key}: {unknown[0]}; wanted {' or '.join(nominal.law.names)}, in MPa")
    if wrong := [f"{name} = {ends!r}" for name, ends in (bounds or {}).items() if np.size(ends) != 2]:
        raise ValueError(f"bounds: {wrong[0]}; wanted the lowest and the highest value, MPa")
    limits = {**nominal.law.around(nominal), **(bounds or {})}
    effects = [effects] if isinstance(effects, str) else effects
    return Actuator(
        structure=structure, elasticity=Elasticity(nominal.law, bounds=limits, fixed=held, nominal=nominal),
        effects=tuple(effects), own=tuple(own), bends_down=bends_down, mesh_error=mesh_error,
    )  # fmt: skip
