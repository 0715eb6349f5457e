"""GK215."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._observations import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import NAN


@check(
    "GK215",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="say what is seen where there is nothing to see: a mean over nobody, a distance to nobody",
)
def observations_hold_no_nan(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """No observation holds NaN.

    One NaN makes every weight of a network NaN at its next update. It mostly comes from a mean over
    nobody or a division by zero, once the other agents have left.

    Bad:

        others = np.mean([self.position[b] for b in live if b != a], axis=0)   # NaN when alone

    Good:

        others = np.mean(...) if len(live) > 1 else np.zeros(2)
    """
    yield from judged(evidence, NAN)
