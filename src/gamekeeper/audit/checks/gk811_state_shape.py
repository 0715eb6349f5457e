"""GK811."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import at, forms, space_of, stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

SPACE = (
    "state, space = env.state(), env.state_space\n"
    "assert np.shape(state) == space.shape, (np.shape(state), space)"
)
KEPT = (
    "state, other = env.state(), make()\nother.reset(seed=SEED)\n"
    "assert np.shape(state) == np.shape(other.state()), (np.shape(state), 'and at the reset',\n"
    "    np.shape(other.state()))"
)


@check(
    "GK811",
    needs=("state", "rollout"),
    severity=MEDIUM,
    mend="make state() of one shape, whoever is still alive, and declare it in state_space",
    applies=stateless,
)
def states_have_their_shape(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() has the shape of state_space, and without one a shape that it keeps.

    A critic's network has one input. Rows of agents that have ended are zero, not gone.

    Bad:
        return np.concatenate([self.row(agent) for agent in self.agents])

    Good:
        return np.concatenate([self.row(agent) for agent in self.possible_agents])
    """
    firsts: dict[tuple[str, int], list[int]] = {}
    for fact, answer in forms(evidence):
        play = fact.where.probe, fact.where.play
        if answer["failed"] is not None:
            continue
        shape, declared = answer["shape"], space_of(evidence, fact.where.play)
        if declared["shape"] is not None:
            expected, proof = list(declared["shape"]), SPACE
        elif declared["space"] is None and shape is not None:
            expected, proof = firsts.setdefault(play, shape), KEPT
        else:
            continue
        seen = f"a {answer['kind']}" if shape is None else shape
        yield Occasion(at(fact, answer), shape == expected, expected, seen, proof=proof)
