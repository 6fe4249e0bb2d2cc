"""A diagnosis of a simulator -> the run that is wanted of it: the same, with what it cannot have yet."""

from twin.diagnosis.deciding import NONE, Diagnosis
from twin.effects.mechanism import Mechanism
from twin.foreign.courseeffects import UnevenBody

HOW = (
    "give your program a parameter for it that is 0 where it is absent, and name it under variants= of "
    "twin.simulator, or as a column of the table of runs"
)
OTHERWISE = {  # what a program that knows the silicone and its surroundings may have
    Mechanism.BODY: "with the walls thinner near the tip than near the clamp",
    Mechanism.LAW: "with a law of the silicone that stiffens where it is stretched most",
    Mechanism.HISTORY: "with moduli that fall by a share when they were stretched more before",
    Mechanism.LOAD: "with a clamp that gives way, or a force of the tube on the body",
}


def wanted_run(diagnosis: Diagnosis) -> str:
    """The variant of the program that would explain what is left, in words; "" where an effect is named, or
    nothing inside the structure is missing. The part of the body and how much softer it is are those of the
    stand-in that the data fit best."""
    if diagnosis.verdict != NONE or not diagnosis.mechanisms:
        return ""
    leading = diagnosis.mechanisms[0]
    if leading not in OTHERWISE:
        return ""
    spot = next((h for h in diagnosis.resembles if isinstance(h.effect, UnevenBody)), None)
    if leading is Mechanism.BODY and spot is not None and spot.refit is not None:
        assert isinstance(spot.effect, UnevenBody)
        change = spot.effect.variant(spot.refit.values)
    else:
        change = OTHERWISE[leading]
    return f"the same run {change}: {HOW}"
