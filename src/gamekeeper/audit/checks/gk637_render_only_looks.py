"""GK637."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK637",
    needs=("extra_calls",),
    severity=HIGH,
    mend="let render() only read; what it draws at random comes from a generator of its own",
    applies=not_offered("render"),
)
def rendering_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Calling render() between the steps doesn't change the game, nor draw from its generator.

    A video of an episode then shows another episode than the one that was evaluated.

    Bad:

    ```python
    def render(self):
        self.clouds += self.rng.normal(size=2)      # the generator of the game
        return self.paint()
    ```

    Good: keep `self.decor = np.random.default_rng(0)` for whatever is only painted.
    """
    yield from extra(evidence, "render")
