"""A project -> its targets, model and whitener: what every stage after `measure` starts from."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrate import Fit
from fe import Case, Finger, Lattice
from twin import files
from twin.discretisation import Discretisation, discretisation
from twin.effects import Effect, Elasticity, effect
from twin.fitting import measured_remainder
from twin.model import Model, base_case, base_model
from twin.project import Project, Say
from twin.targets import NODE_UNKNOWN, Array, Targets

ALIKE = 0.1  # of C10 + C01, and of the share: constants for which discretisation modes are alike


@dataclass(frozen=True)
class Workbench:
    """What a stage works with; `finger` and `lattice` are those of the embedded model."""

    project: Project
    targets: Targets
    case: Case
    finger: Finger
    lattice: Lattice
    elasticity: Elasticity

    @staticmethod
    def of(project: Project) -> "Workbench":
        """The workbench of a project. ValueError for unknown nodes or fixed parameters of no use."""
        config = project.config
        unknown = sorted(set(config.model.fixed) - {"C10", "C01"})
        if unknown:
            raise ValueError(
                f"model.fixed.{unknown[0]}: only C10 and C01 can be held; remove it from twin.toml"
            )
        finger, lattice = Finger(), Lattice(refine=config.model.mesh)
        targets, case = project.targets(), base_case(finger=finger, lattice=lattice)
        for name, node in zip(targets.names, targets.nodes, strict=True):
            if node == NODE_UNKNOWN:
                raise ValueError(f"point {name!r} has no node; give its node label in twin.toml [[points]]")
            if node:
                case.position(int(node))  # names what is wrong with an unknown node
        elasticity = Elasticity(bounds=config.calibrate.bounds, fixed=config.model.fixed)
        return Workbench(project, targets, case, finger, lattice, elasticity)

    def model(self, effects: tuple[Effect, ...] | None = None) -> Model:
        """The base model with the given effects, by default those of twin.toml."""
        own = (
            tuple(effect(label) for label in self.project.config.model.effects)
            if effects is None
            else effects
        )
        return base_model(self.targets, self.case, elasticity=self.elasticity, effects=own)

    def keep(self, key: str, make: Callable[[], Array]) -> Array:
        """The array that `make` gives, from the project's cache where it was made before."""
        path = self.project.root / "cache" / f"{key}.npz"
        if not path.exists():
            files.write_npz(path, {"array": make()})
        return np.asarray(files.read_npz(path)["array"], float)

    def mesh(self, theta: Array, model: Model, say: Say) -> Discretisation | None:
        """The base model's discretisation modes near C10, C01; None without a noise model, which no test
        could use.

        Modes have free amplitudes and their shape hardly changes with the constants, so those made for
        constants
        nearby (ALIKE) serve again.
        """
        if self.targets.noise is None:
            return None
        # one model, one store of solves, where it is the base model itself
        base = model if len(model.effects) == 1 else self.model(())
        values = {**model.named(theta), **self.elasticity.fixed}
        made = self._made_for(values["C10"], values["C01"])
        own = np.array([made[("C10", "C01").index(p.name)] for p in base.parameters])
        raw = discretisation(
            base, own, finger=self.finger, lattice=self.lattice, keep=self.keep, progress=say.progress
        )
        return measured_remainder(base, own, self.targets, raw)

    def _made_for(self, C10: float, C01: float) -> tuple[float, float]:
        """The constants near these for which the cache has modes, or these."""
        path = self.project.root / "cache" / "discretisation.json"
        known = files.read_json(path) if path.exists() else []
        total, share = C10 + C01, C01 / (C10 + C01)
        for a, b in known:
            if abs((a + b) / total - 1) < ALIKE and abs(b / (a + b) - share) < ALIKE:
                return float(a), float(b)
        files.write_json(path, [*known, [C10, C01]])
        return C10, C01


def newest_fit(project: Project) -> Fit:
    """The newest fit of the model that twin.toml has now; ValueError says to calibrate first."""
    names = None
    for folder in reversed(project.runs()):
        path = folder / "fit.json"
        if path.is_file() and project.info(folder)["status"] == "done":
            data = files.read_json(path)
            if data.get("effects") == list(project.config.model.effects):
                return Fit.from_dict(
                    {k: v for k, v in data.items() if k not in ("effects", "identifiability")}
                )
            names = names or data.get("effects")
    what = f"for effects {list(project.config.model.effects)}" if names is not None else "in this project"
    raise ValueError(f"no fit {what}; run twin calibrate" + (" or twin add" if names is not None else ""))
