"""All laws by the names that twin.toml has for them, and the one that a material is of."""

from typing import TYPE_CHECKING

from twin.laws.arrudaboyce import ARRUDA_BOYCE
from twin.laws.gent import GENT
from twin.laws.law import NOTHING, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.laws.ogden import OGDEN
from twin.laws.reducedpolynomial import NEO_HOOKE, YEOH

if TYPE_CHECKING:
    from fe import Material

LAWS = {law.name: law for law in (NEO_HOOKE, MOONEY_RIVLIN, YEOH, GENT, ARRUDA_BOYCE, *OGDEN)}


def named_law(name: str) -> RubberLaw:
    """The law of a name. ValueError for one that there is not.

    >>> named_law("yeoh").source
    '10.5254/1.3538343'
    >>> list(LAWS)
    ['neo-hooke', 'mooney-rivlin', 'yeoh', 'gent', 'arruda-boyce', 'ogden1', 'ogden2', 'ogden3']
    """
    if name not in LAWS:
        raise ValueError(f"law {name!r}: wanted one of {', '.join(LAWS)}")
    return LAWS[name]


def law_of(material: "Material") -> RubberLaw | None:
    """The law of fewest constants that a material is of, whatever its bulk modulus, memory and density; None
    where it is of none.

    >>> from fe import Material
    >>> law_of(Material(C10=0.3)), law_of(Material(C10=0.3, C20=0.01))
    (RubberLaw(neo-hooke), RubberLaw(yeoh))
    """
    terms = {name: getattr(material, name) for name in NOTHING}
    for law in sorted(LAWS.values(), key=lambda law: len(law.parameters)):
        try:
            candidate = law.of(law.read(material)).material
        except (ValueError, ZeroDivisionError):
            continue
        if {name: getattr(candidate, name) for name in NOTHING} == terms:
            return law
    return None
