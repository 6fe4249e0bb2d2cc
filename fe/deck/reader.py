"""Case and pressure of an Abaqus input deck. Unsupported keywords are refused with line and remedy."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from fe.case import Case
from fe.deck import generation, instances, jointkeywords, loadkeywords, materialkeywords, meshkeywords
from fe.deck.draft import Draft
from fe.deck.keywords import Keyword, read_keywords
from fe.deck.soundness import check_collapsed, check_turned
from fe.deck.units import declared
from fe.element import Array, Integers

# Read over: they change no displacement of a static solution.
SILENT = {
    "HEADING", "PREPRINT", "RESTART", "OUTPUT", "NODE OUTPUT", "ELEMENT OUTPUT", "CONTACT OUTPUT",
    "ENERGY OUTPUT", "NODE FILE", "EL FILE", "NODE PRINT", "EL PRINT", "ENERGY PRINT", "MONITOR", "PRINT",
    "STATIC", "VISCO", "END STEP", "ASSEMBLY", "END ASSEMBLY", "FILE FORMAT", "CONTROLS", "PARAMETER",
    "SECTION CONTROLS", "HOURGLASS STIFFNESS", "DAMPING",
}  # fmt: skip


@dataclass(frozen=True)
class Deck:
    """A structure, the follower pressure in MPa on its pressurised surface at the end of each step, and the
    gravity (3,) mm/s2 that its weight feels, the files that were read, and the numbers (e,) of its elements;
    remarks: sentences on what was read as something else.
    """

    case: Case
    pressures: tuple[float, ...]
    gravity: Array
    files: tuple[Path, ...]
    elements: Integers
    remarks: tuple[str, ...] = ()


def read_deck(path: str | Path) -> Deck:
    """The case of a deck in mm, N, MPa (its own units, or those that a comment `** units: m, N, s` declares),
    names of sets in small letters.

    Raises ValueError, with the line, for what is not supported or not complete; FileNotFoundError where there
    is no such file.
    """
    path = Path(path)
    text = read_keywords(path)
    keywords = text.keywords
    if not keywords:
        raise ValueError(f"{path}: no keyword in it; wanted an Abaqus deck with *NODE and *ELEMENT")
    unknown = [k for k in keywords if k.name not in READERS and k.name not in SILENT]
    if unknown:
        raise refused(unknown, path, READERS)
    units, doubt = declared(text.units)
    draft = Draft(str(path), units=units, remarks=dict.fromkeys([doubt] if doubt else []))
    for keyword in keywords:
        if keyword.name in READERS:
            try:
                READERS[keyword.name](draft, keyword)
            except IndexError:
                raise keyword.error(f"*{keyword.name}: its data lines hold too little; complete it") from None
    instances.end_instance(draft, keywords[-1])
    loadkeywords.settle(draft)
    case, numbers = draft.case()
    for check in (check_collapsed, check_turned):
        check(case, numbers, str(path))
    return Deck(
        draft.units.applied(case),
        tuple(draft.units.stress * p for p in draft.pressures) or (0.0,),
        draft.units.length * draft.gravity,
        text.files,
        numbers,
        tuple(draft.remarks),
    )


READERS: dict[str, Callable[[Draft, Keyword], None]] = {
    "PART": instances.part,
    "END PART": instances.end_part,
    "INSTANCE": instances.instance,
    "END INSTANCE": instances.end_instance,
    "NODE": meshkeywords.nodes,
    "NGEN": generation.ngen,
    "NFILL": generation.nfill,
    "NCOPY": generation.ncopy,
    "ELEMENT": meshkeywords.elements,
    "ELGEN": generation.elgen,
    "NSET": meshkeywords.reader_of_sets("node_sets", "NSET"),
    "ELSET": meshkeywords.reader_of_sets("element_sets", "ELSET"),
    "SURFACE": meshkeywords.surface,
    "MATERIAL": materialkeywords.material,
    "HYPERELASTIC": materialkeywords.hyperelastic,
    "ELASTIC": materialkeywords.elastic,
    "VISCOELASTIC": materialkeywords.viscoelastic,
    "MULLINS EFFECT": materialkeywords.mullins,
    "DENSITY": materialkeywords.density,
    "SOLID SECTION": materialkeywords.solid_section,
    "SHELL SECTION": materialkeywords.sheet_section,
    "MEMBRANE SECTION": materialkeywords.sheet_section,
    "TIE": jointkeywords.tie,
    "EQUATION": jointkeywords.equation,
    "MPC": jointkeywords.mpc,
    "RIGID BODY": jointkeywords.rigid_body,
    "COUPLING": jointkeywords.coupling,
    "KINEMATIC": jointkeywords.kinematic,
    "KINEMATIC COUPLING": jointkeywords.kinematic_coupling,
    "BOUNDARY": loadkeywords.boundary,
    "AMPLITUDE": loadkeywords.amplitude,
    "STEP": loadkeywords.step,
    "DSLOAD": loadkeywords.dsload,
    "DLOAD": loadkeywords.dload,
    "CLOAD": loadkeywords.cload,
}


BODY = "the pressure must act on *SURFACE of the chamber's faces, by *DSLOAD"
REMEDIES = {
    "CONTACT PAIR": "remove it: walls that touch are not in a deck's model",
    "CONTACT": "remove it: walls that touch are not in a deck's model",
    **dict.fromkeys(
        ("SURFACE INTERACTION", "SURFACE BEHAVIOR", "FRICTION", "CONTACT INCLUSIONS",
         "CONTACT PROPERTY ASSIGNMENT"),
        "remove it with its contact",
    ),
    "SHELL GENERAL SECTION": "use *SHELL SECTION with a thickness and *ELASTIC",
    "USER MATERIAL": "state *HYPERELASTIC",
    "ELCOPY": "write the elements out",
    "ORIENTATION": "remove it, with ORIENTATION= of its section: materials are isotropic",
    "EMBEDDED ELEMENT": "replace the embedded sheet by shells tied to a face (*TIE), or remove it",
    "REBAR LAYER": "replace it by a sheet: *SHELL SECTION with thickness, modulus and *TIE",
    "FLUID CAVITY": f"remove it; {BODY}",
    "FLUID BEHAVIOR": f"remove it; {BODY}",
    "PHYSICAL CONSTANTS": "remove it: nothing here depends on them",
    "DYNAMIC": "replace it by *STATIC: inertia is not solved for",
    "TRANSFORM": "state *BOUNDARY along x, y, z",
    "SYSTEM": "state nodes in one global frame",
    "HYPERFOAM": "state *HYPERELASTIC with D1",
    "PLASTIC": "remove it: the material stays elastic",
    "SPRING": "remove it, or hold its nodes by *BOUNDARY",
    "CONNECTOR SECTION": "remove it, or tie the surfaces by *TIE",
    "DISTRIBUTING": "replace it by *KINEMATIC, or load the nodes themselves by *CLOAD",
    "INITIAL CONDITIONS": "remove it: the structure is free of stress at rest",
}


def refused(unknown: Iterable[Keyword], deck: Path, readers: Iterable[str]) -> ValueError:
    """The error that names unsupported keywords with their lines, and a remedy for each kind."""
    named = list(unknown)
    kinds = dict.fromkeys(k.name for k in named)
    advice = [f"*{name}: {REMEDIES[name]}" for name in kinds if name in REMEDIES]
    if len(advice) < len(kinds):
        others = "the others" if advice else "them"
        advice.append(f"remove {others} or express {others} by {', '.join('*' + n for n in readers)}")
    return ValueError(
        f"{deck}: not supported: {', '.join(f'*{k.name} ({_where(k, deck)})' for k in named)}; wanted a "
        f"deck without; {'; '.join(advice)}"
    )


def _where(k: Keyword, deck: Path) -> str:
    return f"line {k.place.line}" + ("" if k.place.file == deck else f" of {k.place.file}")
