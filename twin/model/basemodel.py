"""Targets and a case -> the base model: elasticity alone, with a memory of its solves."""

import numpy as np

from fe import Case, Path
from twin.effects.material import Elasticity
from twin.effects.protocol import Test
from twin.gravity import of_targets, pulls_of, shares_of
from twin.model.memo import KeptModel
from twin.targets import Targets


def base_test(targets: Targets, case: Case) -> Test:
    """The test that the targets describe: their points on the case, their log as the path."""
    moving = ~targets.fixed
    points = targets.places(case.position)
    places, pulls = pulls_of(targets, case.position)
    chambers, shares = shares_of(targets, case)
    path = Path(
        targets.log_time, targets.log_pressure, targets.time, gravity=of_targets(targets), places=places,
        pulls=pulls, chambers=chambers, shares=shares,
    )  # fmt: skip
    return Test(case, path, np.nan_to_num(points), moving, targets.names)


def base_model(targets: Targets, case: Case, *, elasticity: Elasticity | None = None) -> KeptModel:
    """The base model of the targets on a case, by default of Mooney-Rivlin rubber, all free."""
    rests = targets.rests if targets.rests.any() else None
    law = ((elasticity or Elasticity()).fitted(),)
    return KeptModel(base_test(targets, case), law, targets.reference, rests=rests)
