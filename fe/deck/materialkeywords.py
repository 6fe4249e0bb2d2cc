"""Keywords that state materials and where they are."""

from dataclasses import replace

from fe.deck.draft import Draft
from fe.deck.hyperelastic import read_law
from fe.deck.keywords import Keyword, filled
from fe.deck.meshdraft import SheetSection
from fe.deck.setnames import plain, small
from fe.material import Material

HEAVIEST = 3e-8  # tonne/mm3: more than osmium


def material(draft: Draft, k: Keyword) -> None:
    """*MATERIAL: what follows belongs to it."""
    draft.material = plain(k.text("NAME"))


def hyperelastic(draft: Draft, k: Keyword) -> None:
    """*HYPERELASTIC; with MODULI=INSTANTANEOUS, or not, for the Prony series that may follow."""
    _add(draft, read_law(k))
    draft.instantaneous[draft.material] = k.parameters.get("MODULI", "").upper() == "INSTANTANEOUS"


def elastic(draft: Draft, k: Keyword) -> None:
    """*ELASTIC: kept for sheets; in a solid neo-Hooke of the same moduli, which is the same at small
    strains."""
    if k.parameters.get("TYPE", "ISOTROPIC").upper() not in ("ISOTROPIC", "ISO"):
        raise k.error(f"*ELASTIC, TYPE={k.parameters['TYPE']}: wanted an isotropic one; state a mean modulus")
    line, words = k.data[0]
    modulus, poisson = k.numbers(line, filled(words, "", ""))
    if not modulus > 0 or not -1 < poisson <= 0.5:
        raise k.error(
            f"*ELASTIC {modulus:g}, {poisson:g}: wanted a modulus above 0, a Poisson's ratio of at most 0.5",
            line,
        )
    shear, volume = modulus / (2 * (1 + poisson)), max(1 - 2 * poisson, 1e-4)
    draft.elastic[draft.material] = modulus, poisson
    _add(draft, Material(C10=shear / 2, bulk_ratio=2 * (1 + poisson) / (3 * volume)))


def viscoelastic(draft: Draft, k: Keyword) -> None:
    """*VISCOELASTIC, TIME=PRONY: g, k, tau, one term a line. Constants that are not instantaneous are those
    after all relaxation."""
    if k.parameters.get("TIME", "").upper() != "PRONY":
        raise k.error("*VISCOELASTIC: wanted TIME=PRONY with g, k, tau; let Abaqus print its fit")
    law = draft.materials.get(draft.material)
    if law is None or draft.material in draft.elastic:
        raise k.error("*VISCOELASTIC before or without *HYPERELASTIC: wanted it below; move it")
    terms = []
    for line, words in k.data:
        g, bulk, tau = k.numbers(line, filled(words, "", "", ""))
        if not (0 <= g < 1 and tau > 0):
            raise k.error(f"*VISCOELASTIC g {g:g}, tau {tau:g}: wanted g from 0 to 1 and tau above 0 s", line)
        if bulk:
            draft.remark(f"{draft.material} relaxes in shear alone: k of *VISCOELASTIC is left out.")
        terms.append((g, tau))
    long_term = 1 - sum(g for g, _ in terms)
    if long_term <= 0:
        raise k.error(f"*VISCOELASTIC: the g add up to {1 - long_term:g}; wanted less than 1")
    if not draft.instantaneous.get(draft.material):
        law = replace(law.stiffened(1 / long_term), bulk_ratio=law.bulk_ratio * long_term)
    draft.materials[draft.material] = replace(law, prony=tuple(terms))


def mullins(draft: Draft, k: Keyword) -> None:
    """*MULLINS EFFECT with constants r, m, beta."""
    if k.parameters:
        raise k.error(
            f"*MULLINS EFFECT, {', '.join(k.parameters)}: wanted constants; let Abaqus print its fit"
        )
    if draft.material not in draft.materials:
        raise k.error("*MULLINS EFFECT before *HYPERELASTIC: wanted it below; move it")
    line, words = k.data[0]
    r, m, beta = k.numbers(line, filled(words, "", "", ""))
    if r <= 1 or m < 0 or beta < 0 or m + beta <= 0:
        raise k.error(f"*MULLINS EFFECT r {r:g}, m {m:g}, beta {beta:g}: wanted r > 1 and m, beta >= 0", line)
    draft.materials[draft.material] = replace(draft.materials[draft.material], mullins=(1 / r, m, beta))


def _add(draft: Draft, law: Material) -> None:
    """The law of the material that is being read; its density may stand before it."""
    draft.materials[draft.material] = replace(law, density=draft.densities.get(draft.material, 0.0))


def density(draft: Draft, k: Keyword) -> None:
    """*DENSITY."""
    line, words = k.data[0]
    (value,) = k.numbers(line, filled(words, ""))
    if not 0 <= value * draft.units.density <= HEAVIEST:
        raise k.error(f"*DENSITY {value:g}: wanted tonne/mm3, such as 1.07e-09 for 1070 kg/m3", line)
    draft.densities[draft.material] = value
    if draft.material in draft.materials:
        _add(draft, draft.materials[draft.material])


def solid_section(draft: Draft, k: Keyword) -> None:
    """*SOLID SECTION."""
    draft.here.sections[small(k.text("ELSET"))] = plain(k.text("MATERIAL"))


def sheet_section(draft: Draft, k: Keyword) -> None:
    """*SHELL SECTION and *MEMBRANE SECTION of one material."""
    for what in ("COMPOSITE", "ORIENTATION", "STACK DIRECTION"):
        if what in k.parameters:
            raise k.error(f"*{k.name}, {what}: wanted a sheet of one isotropic material; state its thickness")
    line, words = k.data[0]
    (thickness,) = k.numbers(line, filled(words, ""))
    if not thickness > 0:
        raise k.error(f"*{k.name}: a thickness of {thickness:g}; wanted one above 0 mm", line)
    section = SheetSection(plain(k.text("MATERIAL")), thickness, k.place)
    draft.here.sheet_sections[small(k.text("ELSET"))] = section
