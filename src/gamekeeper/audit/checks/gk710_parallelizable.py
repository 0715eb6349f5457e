"""GK710."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._converted import not_said
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES = """\
from pettingzoo.utils.conversions import aec_to_parallel
env = aec_to_parallel(make())
env.reset(seed=SEED)
for space in map(env.action_space, env.possible_agents):
    space.seed(0)
for tick in range(200):
    if not env.agents:
        break
    env.step({agent: first_legal(env, agent) for agent in env.agents})
"""
LEGAL = """\
def first_legal(env, agent):
    seen, info = env.aec_env.observe(agent), env.aec_env.infos.get(agent) or {}
    mask = info.get("action_mask", seen.get("action_mask") if isinstance(seen, dict) else None)
    return env.action_space(agent).sample(mask) if mask is not None else (
        env.action_space(agent).sample())
"""


@check(
    "GK710",
    needs=("conversion",),
    severity=MEDIUM,
    mend="let all live agents act in the order of `agents` in every cycle, deaths at its end; or "
    'say "is_parallelizable": False',
    api="aec",
    applies=not_said,
)
def parallelizable_means_in_cycles(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An environment whose metadata say is_parallelizable can be stepped by aec_to_parallel.

    Libraries ask this flag and convert. A turn order that rotates, skips or repeats, or a death in
    mid-cycle, ends in an AssertionError in the middle of a training run.

    Bad:

    ```python
    metadata = {"name": "auction_v1", "is_parallelizable": True}    # yet the opener rotates
    ```

    Good:

    ```python
    metadata = {"name": "auction_v1", "is_parallelizable": False}
    ```
    """
    for fact in evidence.facts("conversion", "converted"):
        failed = fact.value["failed"]
        if fact.value["ticks"] or failed is not None:
            yield Occasion(
                fact.where, failed is None, "aec_to_parallel steps it",
                "it does" if failed is None else failed,
                proof=Proof(LEGAL + LINES, plays=False),
            )  # fmt: skip
