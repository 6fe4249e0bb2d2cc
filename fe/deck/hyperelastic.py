"""Table of the laws of *HYPERELASTIC, read and written (`FORMS`).

A new law is one more entry of FORMS. Compressibility is stated by the first term alone, D1 = 2 / K. N is
written after the law's name: CalculiX (2.20) forgets an N that stands before it, and takes the first term.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from fe.deck.keywords import Keyword
from fe.material import Material

INCOMPRESSIBLE = 1e4  # K / shear modulus where D1 = 0, which stands for incompressible
OPTIONS = {"N", "MODULI", "DEPENDENCIES"}  # of *HYPERELASTIC, none of which names a law
TERMS = ("C10", "C01", "C20", "C30", "ogden", "chains")  # of a material, that a form may hold


@dataclass(frozen=True)
class Form:
    """A form of *HYPERELASTIC: the keyword's parameter `kind`, and N (`order`) where it is fixed.

    holds: constants of a material that the form can state. read: from the data and N to a material without
    bulk modulus, and the data after its constants, D1 first; no material if a term is not supported;
    IndexError if data are missing. write: the keyword's parameters and its data.
    """

    kind: str
    holds: tuple[str, ...]
    read: Callable[[Sequence[float], int], tuple[Material | None, Sequence[float]]]
    write: Callable[[Material], tuple[str, list[float]]]
    order: int | None = None

    def fits(self, parameters: Mapping[str, str]) -> bool:
        """True if the parameters of a keyword select this form."""
        polynomial_by_default = self.kind == "POLYNOMIAL" and set(parameters) <= OPTIONS
        return (self.kind in parameters or polynomial_by_default) and self.order in (None, _order(parameters))


def _order(parameters: Mapping[str, str]) -> int:
    """Number of terms N; 0 if it is not a valid one."""
    text = parameters.get("N", "1")
    return int(text) if text in {"1", "2", "3", "4", "5", "6"} else 0


def polynomial(kind: str, *constants: str, order: int | None = None, compressible: int = 1) -> Form:
    """A form with one number for each of `constants`, "" for an unsupported term; compressible: number of D1
    .., by default `order`."""

    def read(c: Sequence[float], _: int) -> tuple[Material | None, Sequence[float]]:
        named = [(name, c[k]) for k, name in enumerate(constants)]
        if any(value for name, value in named if not name):
            return None, ()
        values = {name: value for name, value in named if name}
        return Material(**values), c[len(named) :]  # type: ignore[arg-type]

    def write(m: Material) -> tuple[str, list[float]]:
        values = [getattr(m, name) if name else 0.0 for name in constants]
        return f"{kind}, N={order}" if order else kind, values + _compressibility(m, order or compressible)

    return Form(kind, constants, read, write, order)


def _compressibility(m: Material, terms: int) -> list[float]:
    return [2 / m.bulk, *[0.0] * (terms - 1)]


def _read_ogden(c: Sequence[float], order: int) -> tuple[Material | None, Sequence[float]]:
    return Material(ogden=tuple((c[2 * k], c[2 * k + 1]) for k in range(order))), c[2 * order :]


def _write_ogden(m: Material) -> tuple[str, list[float]]:
    order = len(m.ogden)
    return f"OGDEN, N={order}", [*(x for pair in m.ogden for x in pair), *_compressibility(m, order)]


def _read_chains(c: Sequence[float], _: int) -> tuple[Material | None, Sequence[float]]:
    return Material(chains=(c[0], c[1])), c[2:]


def _write_chains(m: Material) -> tuple[str, list[float]]:
    assert m.chains
    return "ARRUDA-BOYCE", [*m.chains, *_compressibility(m, 1)]


# A material is written in the first form that holds all its terms.
FORMS = (
    polynomial("MOONEY-RIVLIN", "C10", "C01"),
    polynomial("POLYNOMIAL", "C10", "C01", order=1),
    polynomial("NEO HOOKE", "C10"),
    polynomial("REDUCED POLYNOMIAL", "C10", order=1),
    polynomial("YEOH", "C10", "C20", "C30", compressible=3),
    polynomial("POLYNOMIAL", "C10", "C01", "C20", "", "", order=2),
    polynomial("REDUCED POLYNOMIAL", "C10", "C20", order=2),
    polynomial("REDUCED POLYNOMIAL", "C10", "C20", "C30", order=3),
    Form("OGDEN", ("ogden",), _read_ogden, _write_ogden),
    Form("ARRUDA-BOYCE", ("chains",), _read_chains, _write_chains),
)


def read_law(k: Keyword) -> Material:
    """The material of a *HYPERELASTIC. ValueError for a law that is not among FORMS."""
    if "TEST DATA INPUT" in k.parameters:
        raise k.error("*HYPERELASTIC from test data: wanted constants; let Abaqus print its fit")
    c = [x for line, row in k.rows(8, "constants") for x in k.numbers(line, row)]
    for form in FORMS:
        if form.fits(k.parameters):
            law, D = form.read(c, _order(k.parameters))
            if law is not None:
                if not law.shear > 0 or (D and D[0] < 0):
                    raise k.error(
                        f"*HYPERELASTIC with a shear modulus of {law.shear:g} MPa and D1 = "
                        f"{D[0] if D else 0:g}: wanted a shear modulus above 0, and D1 0 or more"
                    )
                ratio = 2 / D[0] / law.shear if D and D[0] > 0 else INCOMPRESSIBLE
                return replace(law, bulk_ratio=ratio)
    raise k.error(
        f"*HYPERELASTIC {', '.join(k.parameters) or 'POLYNOMIAL'}: wanted Mooney-Rivlin, neo-Hooke, "
        "Yeoh, Ogden, Arruda-Boyce, or a polynomial without the terms C11 and C02"
    )


def written_law(name: str, m: Material) -> list[str]:
    """Lines of *HYPERELASTIC for a material, at most 8 values each. ValueError where no form holds all its
    terms.

    >>> written_law("rubber", Material(C10=0.25, bulk_ratio=1000.0))
    ['*HYPERELASTIC, MOONEY-RIVLIN', '0.25, 0, 0.004']
    """
    there = [term for term in TERMS if getattr(m, term)]
    form = next((f for f in FORMS if set(there) <= set(f.holds)), None)
    if form is None:
        raise ValueError(
            f"material {name!r} with {', '.join(there)}: no law of a deck has all these terms; leave one out"
        )
    law, values = form.write(m)
    text = [f"{x:.10g}" for x in values]
    return [f"*HYPERELASTIC, {law}", *(", ".join(text[k : k + 8]) for k in range(0, len(text), 8))]
