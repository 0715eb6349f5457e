"""GK812."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import at, forms, space_of, stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

SPACE = (
    "state, space = env.state(), env.state_space\n"
    "assert np.asarray(state).dtype == space.dtype, (np.asarray(state).dtype, space)"
)
KEPT = (
    "state, other = env.state(), make()\nother.reset(seed=SEED)\n"
    "assert state.dtype == other.state().dtype, (state.dtype, other.state().dtype)"
)


@check(
    "GK812",
    needs=("state", "rollout"),
    severity=MEDIUM,
    mend="state().astype(self.state_space.dtype)",
    applies=stateless,
)
def states_have_their_dtype(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() has the dtype of state_space, and without one a dtype that it keeps.

    Buffers are allocated after the space: a float64 loses digits in them, or is refused.

    Bad:
        return np.concatenate(rows)                       # float64

    Good:
        return np.concatenate(rows, dtype=np.float32)     # as state_space says
    """
    firsts: dict[tuple[str, int], object] = {}
    for fact, answer in forms(evidence):
        play = fact.where.probe, fact.where.play
        dtype, declared = answer["dtype"], space_of(evidence, fact.where.play)
        if answer["failed"] is not None or dtype is None:
            continue
        is_declared = declared["dtype"] is not None
        if declared["space"] is not None and not is_declared:
            continue
        expected = declared["dtype"] if is_declared else firsts.setdefault(play, dtype)
        proof = SPACE if is_declared else KEPT
        yield Occasion(at(fact, answer, "state.dtype"), dtype == expected, expected, dtype, proof)
