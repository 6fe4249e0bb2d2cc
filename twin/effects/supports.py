"""Effects of the structure: its supports and its shape."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibrate import Parameter
from fe import Case
from fe.case import Contact, Layer
from fe.element import Integers
from fe.mesh.refine import free_faces
from fe.mesh.skin import outer_skin
from fe.obstacles import Flat
from twin.effects.families import COUNT, Parts, Wide
from twin.effects.mechanism import Mechanism
from twin.effects.phrases import number
from twin.effects.protocol import Effect, Family, Order, Test, Theta, Unsolvable


class TableContact(Family):
    """A table under the finger, `distance` mm below its flat bottom, pushes it back by its depth; with two
    terms Coulomb's friction on it too, along the whole path.

    The second is no wider law that `twin diagnose` tries by itself: on the default finger a solve with it
    takes several times as long.
    """

    name, order, smooth, widens = "contact", Order.SUPPORT, False, False
    sentence = "the finger touches a table below it"
    added: ClassVar[Theta] = {"contact.friction": 0.3}

    def law(self, terms: int) -> tuple[Parameter, ...]:
        return (
            Parameter("contact.stiffness", 0.0, 2.0, "MPa/mm", null=0.0, typical=0.1, plausible=(0.0, 1.0)),
            Parameter("contact.distance", -5.0, 100.0, "mm", typical=1.0),
            Parameter("contact.friction", 0.0, 2.0, "", null=0.0, typical=0.1, plausible=(0.0, 1.0)),
        )[: terms + 1]

    def tried(self, terms: int) -> tuple[Theta, ...]:
        friction = self.added if terms == 2 else {}
        return tuple({"contact.distance": d, **friction} for d in (3.0, 8.0, 15.0, 25.0, 40.0))

    def before(self, test: Test, theta: Theta) -> Test:
        stiffness, case = theta["contact.stiffness"], test.case
        if stiffness == 0:
            return test
        if case.contact is not None:
            raise Unsolvable(
                "contact: a table beside the object of [model] object in twin.toml; the model meets one "
                "obstacle alone: leave one of the two out"
            )
        if "outside" not in case.surfaces:
            raise ValueError(
                "contact: no surface 'outside' in the model, wanted the faces that may touch the table; name "
                f"them so (there are {', '.join(case.surfaces) or 'none'})"
            )
        height = float(case.nodes[:, 2].min()) - theta["contact.distance"]
        top, friction = Flat((0.0, 0.0, 1.0), height), theta.get("contact.friction", 0.0)
        table = Contact("outside", top, stiffness, friction)
        return replace(test, case=replace(case, contact=table))

    def told(self, values: Theta) -> str:
        away, friction = values["contact.distance"], values.get("contact.friction", 0.0)
        rubs = f" and rubs on it (friction {number(friction)})" if friction else ""
        side = "below it" if away > 0 else "above its lowest point"
        return f"the finger touches a table {number(away)} mm {side}{rubs}"


class ElasticClamp(Effect):
    """The clamped face turns about the y axis in proportion to the moment of the whole finger on it."""

    name, order = "clamp", Order.SUPPORT
    sentence = "the clamp gives way and turns with the moment on it"
    # 5 mm of silicone between finger and screws turn by 1e-3 rad under 1 N mm (judgement)
    parameters = (
        Parameter("clamp.compliance", 0.0, 1e-2, "rad/(N mm)", null=0.0, typical=1e-5, plausible=(0.0, 1e-3)),
    )

    def lacks(self, case: Case) -> str:
        return "" if case.clamp else "no single node set that is fully held"

    def before(self, test: Test, theta: Theta) -> Test:
        if test.case.clamp is None:
            return test
        clamp = replace(test.case.clamp, compliance=theta["clamp.compliance"] / test.share)
        return replace(test, case=replace(test.case, clamp=clamp))

    def told(self, values: Theta) -> str:
        return f"the clamp turns by {number(1e3 * values['clamp.compliance'])} mrad per N mm of moment on it"


class StrainLimitingLayer(Effect):
    """A sheet of fabric or paper in the flat bottom, or on the surface `strain_limiting_layer` of a deck:
    stiff along it, without stiffness to bending."""

    name, order = "strain_limiting_layer", Order.MATERIAL
    mechanism = Mechanism.BODY
    sentence = "a sheet in the bottom (fabric, paper, a skin of glue) keeps it from stretching"
    # a skin of glue, 0.1 mm of 1 MPa, has 0.1 N/mm, a loose fabric 1 to 10 (judgement)
    parameters = (
        Parameter(
            "strain_limiting_layer.stiffness", 0.0, 50.0, "N/mm", null=0.0, typical=0.05, plausible=(0.0, 5.0)
        ),
    )

    def lacks(self, case: Case) -> str:
        return "" if len(_bonded_to(case)) else "no flat bottom, and no surface strain_limiting_layer"

    def before(self, test: Test, theta: Theta) -> Test:
        case, name = test.case, "strain_limiting_layer"
        faces = _bonded_to(case)
        if not len(faces):
            return test
        layer = Layer(name, theta["strain_limiting_layer.stiffness"])
        return replace(test, case=replace(case, surfaces={**case.surfaces, name: faces}, layer=layer))

    def told(self, values: Theta) -> str:
        much = number(values["strain_limiting_layer.stiffness"])
        return f"a sheet in the bottom (fabric, paper, glue) of {much} N/mm keeps it from stretching"

    def wide(self) -> Effect:
        return Parts(self)


class HoopReinforcement(Family):
    """Fibres or a sleeve wound around the body: stiff around it, not along it, without stiffness to bending.
    They lie on the surface `hoop_reinforcement` of a deck or `around` of a tube, else on the outer skin. With
    two terms two families of them, at one angle to either side of the circumference."""

    name, order = "hoop_reinforcement", Order.MATERIAL
    mechanism = Mechanism.BODY
    sentence = "fibres or a sleeve around the body keep it from widening"
    added: ClassVar[Theta] = {"hoop_reinforcement.angle": 10.0}

    def law(self, terms: int) -> tuple[Parameter, ...]:
        # a skin of 0.1 mm of 1 MPa has 0.1 N/mm, a thread of polyester every 2 mm some 100 (judgement)
        return (
            Parameter(STIFFNESS, 0.0, 200.0, "N/mm", null=0.0, typical=0.05, plausible=(0.0, 5.0)),
            Parameter("hoop_reinforcement.angle", 0.0, 60.0, "degrees", typical=5.0),
        )[:terms]

    def tried(self, terms: int) -> tuple[Theta, ...]:
        return ({**self.added},) if terms == 2 else ()

    def lacks(self, case: Case) -> str:
        return "" if len(_wound_on(case)) else "no outer skin around x"

    def before(self, test: Test, theta: Theta) -> Test:
        angle = theta.get("hoop_reinforcement.angle", 0.0)
        return _with_fibres(test, self.name, theta[STIFFNESS], angle)

    def told(self, values: Theta) -> str:
        angle = values.get("hoop_reinforcement.angle", 0.0)
        turned = f" at {number(angle)} degrees" if angle else ""
        much = number(values[STIFFNESS])
        return f"fibres or a sleeve of {much} N/mm around the body{turned} keep it from widening"

    def wide(self) -> Effect:
        return HoopParts()


STIFFNESS = "hoop_reinforcement.stiffness"


class HoopParts(Wide, of=HoopReinforcement):
    """Fibres of another stiffness in each third of the length, from the clamp."""

    parameters = tuple(
        Parameter(f"{STIFFNESS}{k}", 0.0, 200.0, "N/mm", null=0.0, typical=0.05, plausible=(0.0, 5.0))
        for k in range(1, COUNT + 1)
    )

    def before(self, test: Test, theta: Theta) -> Test:
        return _with_fibres(test, self.name, tuple(theta[p.name] for p in self.parameters), 0.0)

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {p.name: theta.get(STIFFNESS, 0.0) for p in self.parameters}


def _with_fibres(test: Test, name: str, stiffness: float | tuple[float, ...], angle: float) -> Test:
    """The test with one more layer of fibres; the same where there is nothing to wind them on."""
    case = test.case
    faces = _wound_on(case)
    if not len(faces):
        return test
    fibres = Layer(name, stiffness, wound=True, angle=angle)
    changed = replace(case, surfaces={**case.surfaces, name: faces}, layers=(*case.layers, fibres))
    return replace(test, case=changed)


def _wound_on(case: Case) -> Integers:
    """The faces (f, 2) that fibres lie on."""
    named = [case.surfaces[name] for name in ("hoop_reinforcement", "around") if name in case.surfaces]
    return named[0] if named else outer_skin(case)


def _bonded_to(case: Case) -> Integers:
    """The faces (f, 2) that a sheet lies on."""
    named = case.surfaces.get("strain_limiting_layer")
    return flat_bottom(case) if named is None else named


def flat_bottom(case: Case) -> Integers:
    """The faces (f, 2) of the skin whose nodes all lie at the lowest height; none on a curved bottom."""
    faces, z = free_faces(case), case.nodes[:, 2]
    nodes = np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)
    low = z.min() + 1e-6 * float(np.ptp(case.nodes, axis=0).max())
    return faces[(z[nodes] < low).all(axis=1)]
