"""The edge of the finger as a model moves it along the film, which the review draws over the pictures; in the
store of a project, where the stage that fits the model puts it before the review asks."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fe import Solution
from fe.element import triangles
from twin import files
from twin.bench.workbench import Workbench
from twin.judging.judged import Judged
from twin.messages import Say, Silent
from twin.model.arraycache import code_digest
from twin.model.keptmodel import KeptModel
from twin.targets import Array

CHUNK = 64  # steps whose displacements of all nodes are held at a time
Rows = NDArray[np.intp]


class FilmEdge:
    """Nodes along the edge of a project's side face, and how models move them at all steps of its targets."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench

    @cached_property
    def nodes(self) -> Rows:
        """Nodes (k,) along the edge."""
        from twin.drawing.painting import edge_rows  # it draws films, too

        return edge_rows(self.bench.case.nodes, triangles(self.bench.structure.outside))

    def moved(
        self, effects: Sequence[str], values: Mapping[str, float], solution: Callable[[], Solution],
        *, done: str = "", say: Say | None = None,
    ) -> Array:  # fmt: skip
        """Displacements (s, k, 3) mm of the edge in the model with these effects at these values: those that
        are kept, else of its solution."""

        def edge() -> Array:
            (say or Silent()).progress(stage, 0, 1)
            solved, every = solution(), np.arange(len(self.bench.targets.time))
            parts = np.array_split(every, max(1, -(-len(every) // CHUNK)))
            return np.concatenate([solved.fields(list(part))[:, self.nodes] for part in parts])

        stage, key = f"{done}, along the film", f"edge-{self._key(effects, values)[:16]}"
        return self.bench.store.cache(say or Silent())(stage, {key: edge})[key]

    def keep(self, judged: Judged) -> None:
        """Keep the edge of a judged model that is solved at its fit, of all that a camera has filmed."""
        model, theta, bench = judged.model, judged.theta, self.bench
        if not bench.project.config.cameras or bench.carried is not None or not isinstance(model, KeptModel):
            return
        solved = next((s.solution for s in model.kept if np.array_equal(s.theta, theta)), None)
        if solved is not None:
            self.moved([e.label for e in model.effects[1:]], judged.values, lambda: solved)

    def _key(self, effects: Sequence[str], values: Mapping[str, float]) -> str:
        """Digest of all that an edge depends on."""
        project = self.bench.project
        return files.digest_text(
            {
                "code": code_digest(), "structure": self.bench.structure.key, "effects": list(effects),
                "values": dict(values), "edge": self.nodes,
                "targets": files.digest_of([project.targets_folder], root=project.root),
                "own": files.digest_of(project.effect_files(), root=project.root),
            }
        )  # fmt: skip
