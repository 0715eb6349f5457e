"""GK711."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._converted import not_said
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES = """\
import copy
env = make()
env.reset(seed=SEED)
for tick in range(200):
    seen = {agent: copy.deepcopy(env.observe(agent)) for agent in env.agents}
    for agent in list(seen):
        if not env.agents or agent != env.agent_selection:
            break
        observation, reward, terminated, truncated, info = env.last()
        if terminated or truncated:
            env.step(None)
            continue
        np.testing.assert_equal(observation, seen[agent])
        mask = info.get("action_mask")
        if isinstance(observation, dict):
            mask = observation.get("action_mask", mask)
        env.step(env.action_space(agent).sample(mask))
    if not env.agents:
        break
"""


@check(
    "GK711",
    needs=("conversion",),
    severity=MEDIUM,
    mend='change what agents observe at the end of a cycle only; or say "is_parallelizable": False',
    api="aec",
    applies=not_said,
)
def cycles_show_nothing_before_their_end(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """In an environment that says is_parallelizable, nobody observes a move of the same cycle.

    PettingZoo's aec_to_parallel shows everybody what is to be seen at the end of a cycle. Where an
    agent's observation changes by moves before its own, the converted game is another one: its
    agents decide on what is out of date.

    Bad:

    ```python
    metadata = {"is_parallelizable": True}
    def step(self, action):
        self.board[self.agent_selection] = action       # the next in turn sees it at once
    ```

    Good: collect the actions, and resolve them when the last agent of the cycle has acted.

    Source: PettingZoo's documentation of `aec_to_parallel`.
    """
    for fact in evidence.facts("conversion", "cycle"):
        changed = fact.value["changed"]
        for _ in range(fact.value["looks"] - (changed is not None)):
            yield Occasion(fact.where, True)
        if changed is not None:
            after = ", ".join(map(repr, changed["after"])) or "nobody"
            yield Occasion(
                fact.where, False, "the observation that it would have had when the cycle began",
                f"another one, as {after} acted", proof=Proof(LINES, plays=False),
            )  # fmt: skip
