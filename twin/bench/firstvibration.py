"""The slowest vibration up and down of a project's finger at rest, from its fit or from usual constants."""

from dataclasses import replace

from fe import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.vibration import modes
from twin.bench.fits import held_fit
from twin.bench.workbench import Workbench
from twin.gravity import density
from twin.project.folder import Project

SILICONE_KG_M3 = 1070.0
COUNT = 2  # vibrations, of which one may be sideways


def first_vibration(project: Project, case: Case) -> tuple[float, str]:
    """Its frequency in Hz about the state without pressure and weight, and where that comes from, in words.

    case: with nominal constants. Silicone without a stated density has SILICONE_KG_M3.
    """
    source, fit = "usual constants", held_fit(project, project.config.model.effects)
    if fit is not None:
        model = Workbench.of(project).model()
        case, source = model.put(model.named(fit.fit.theta)).case, "as fitted"
    given = {k: replace(m, density=m.density or density(SILICONE_KG_M3)) for k, m in case.materials.items()}
    found = modes(at_rest(replace(case, materials=given), HeldLoad()), count=COUNT)
    slow = found.frequency[~found.sideways]
    return float(slow[0] if len(slow) else found.frequency[0]), source
