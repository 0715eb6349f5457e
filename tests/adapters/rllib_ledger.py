"""Compares what RLlib's own episodes hold, once they have played the ledger, with the log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from gamekeeper.errors import SpecError
from tests.adapters import ledger
from tests.adapters.ledger import Cell
from tests.adapters.rllib_books import made, played
from tests.adapters.sb3_books import ENVS, EPISODES, SEED, log

BINARY: Final = "refused: RLlib has no distribution for such actions"


def expected(cell: Cell) -> str:
    """Reason why a cell is refused; empty where it is taken."""
    return BINARY if cell.form == "MultiBinary" else ""


def episodes(cell: Cell) -> str:
    """Fills RLlib's episodes by the ledger's rule and compares them; says why if refused."""
    role = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    try:
        env = made(cell.spec, seed=SEED, env_kwargs=cell.kwargs, **role)
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0]}"

    def chosen(env: Any, agent: str, observation: Any) -> Any:
        code = ledger.decode(cell.seen, _bare(observation, cell))
        if cell.mask:
            ledger.same(np.ravel(observation["action_mask"]), ledger.flat_flags(cell.form, code))
        return ledger.act(cell.form, code, masked=cell.mask)

    whole = log(cell)
    for _ in range(ENVS * EPISODES):
        book = played(env, chosen)
        for agent in cell.learners:
            if agent in book.agent_episodes:
                _compare(book.agent_episodes[agent], cell, whole)
    assert not whole, "decisions that RLlib doesn't hold"
    env.close()
    return ""


def _bare(observation: Any, cell: Cell) -> Any:
    return observation["observations"] if cell.mask else observation


def _compare(own: Any, cell: Cell, whole: dict[Any, Any]) -> None:
    """Asserts that one agent's episode is that of the log, and takes its decisions out of it."""
    seen = [_bare(one, cell) for one in own.get_observations()]
    actions, rewards = own.get_actions(), own.get_rewards()
    codes = [ledger.decode(cell.seen, one) for one in seen]
    assert len(codes) == len(actions) + 1 == len(rewards) + 1
    for at, code in enumerate(codes[:-1]):
        decision = whole.pop(code)
        ledger.same(_plain(seen[at]), ledger.encode(cell.seen, code))
        ledger.same(np.ravel(actions[at]), np.ravel(decision.action))
        assert float(rewards[at]) == decision.reward
        assert codes[at + 1] == decision.following
    terminated, truncated = decision.end
    # RLlib counts an agent that is both as terminated
    assert own.is_terminated == terminated
    assert own.is_truncated == truncated or terminated


def _plain(seen: Any) -> Any:
    return {key: _plain(part) for key, part in seen.items()} if isinstance(seen, Mapping) else seen
