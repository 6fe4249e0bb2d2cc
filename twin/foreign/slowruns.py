"""What a simulator that takes long tells while it runs: how long a run takes, how many there are, and whether
they are kept."""

import inspect
import sys
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Any

from twin.foreign.programs import Simulator
from twin.messages import Say, Silent

SLOW, AGAIN = 5.0, 60.0  # s of runs before the first line, and between further ones
FEW, MANY = 30, 250  # runs of a diagnosis, about


class Aloud(Silent):
    """A `say` that prints its lines to stderr."""

    def __call__(self, text: str, /) -> None:
        print(text, file=sys.stderr, flush=True)


@dataclass
class Watch:
    """A callable like a simulator's that counts its runs, and says how far it is once they take long."""

    simulator: Simulator
    say: Say
    done: int = 0
    spent: float = 0.0
    due: float = field(default=SLOW)

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self.simulator.predict)

    def __call__(self, *asked: Any) -> Any:
        """The simulator's own answer."""
        began = monotonic()
        try:
            return self.simulator.predict(*asked)
        finally:
            self.done, self.spent = self.done + 1, self.spent + monotonic() - began
            if self.spent > self.due:
                self.say(self._first() if self.due == SLOW else self._further())
                self.due = self.spent + AGAIN

    def _first(self) -> str:
        each, keep = self.spent / self.done, self.simulator.keep
        how = (
            f"Each is kept in {keep}: stop it whenever you like, it goes on there." if keep is not None else
            'Nothing is kept where you stop it; twin.simulator(..., keep="runs") keeps every run.'
        )  # fmt: skip
        span = f"{FEW * each / 60:.3g} to {MANY * each / 60:.3g} min"
        return (
            f"The simulator takes {each:.2g} s a run; a diagnosis asks for {FEW} to {MANY}, so it takes "
            f"{span}. {how}"
        )

    def _further(self) -> str:
        return f"{self.done} runs of the simulator, {self.spent / 60:.2g} min."


def watched(simulator: Simulator, say: Say | None) -> Simulator:
    """The simulator, with the same runs, that tells how far it is; None: on stderr."""
    watch = Watch(simulator, Aloud() if say is None else say)
    return replace(simulator, predict=watch)
