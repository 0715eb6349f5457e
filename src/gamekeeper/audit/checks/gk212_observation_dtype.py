"""GK212."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._observations import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import DTYPE


@check(
    "GK212",
    needs=("rollout", "spaces"),
    severity=MEDIUM,
    mend="convert observations to the dtype of the space: np.asarray(value, space.dtype)",
)
def observations_have_the_dtype_of_their_space(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Every observation has the dtype of its observation space.

    Buffers and networks are made for the dtype of the space; float64 that comes where float32 is
    declared is outside the space, and rounded, or refused, far from here.

    Bad:

        return np.array([x, y])                              # float64, the space says float32

    Good:

        return np.array([x, y], dtype=np.float32)
    """
    yield from judged(evidence, DTYPE)
