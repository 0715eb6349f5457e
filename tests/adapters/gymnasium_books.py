"""Compares what one agent's `gymnasium.Env` gives, once it has played the ledger, with the log."""

from __future__ import annotations

from typing import Any

from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector.vector_form import MASK
from tests.adapters import ledger
from tests.adapters.ledger import Cell, Code, Decision
from tests.adapters.sb3_books import ENVS, EPISODES, SEED, log


def single(cell: Cell) -> str:
    """Plays each learner by the ledger's rule, the others following it too; takes every cell."""
    from gamekeeper.adapters.gymnasium import single_agent

    found: dict[Code, Decision] = {}
    for agent in cell.learners:
        env = single_agent(cell.spec, agent, others=_rule(cell), env_kwargs=cell.kwargs)
        for episode in range(ENVS * EPISODES):
            _play(env, cell, episode_seed(SEED, episode), found)
        env.close()
    whole = log(cell)
    assert sorted(found) == sorted(whole)
    for code, decision in whole.items():
        decision.before = 0.0  # nobody is told: it was paid before there was anything to decide
        assert repr(found[code]) == repr(decision)
    return ""


def _rule(cell: Cell) -> Any:
    def rule(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        if agent == "cat_0":
            return 0
        return ledger.act(cell.form, _code(observation, cell), masked=cell.mask)

    return rule


def _code(observation: Any, cell: Cell) -> Code:
    seen = observation
    if isinstance(seen, dict) and MASK in seen:
        seen = {key: part for key, part in seen.items() if key != MASK}
    code = ledger.decode(cell.seen, seen)
    ledger.same(seen, ledger.encode(cell.seen, code))
    return code


def _play(env: Any, cell: Cell, seed: int, found: dict[Code, Decision]) -> None:
    seen, info = env.reset(seed=seed)
    is_over = False
    while not is_over:
        code = _code(seen, cell)
        if cell.mask:
            mask = seen[MASK] if isinstance(seen, dict) and MASK in seen else info[MASK]
            ledger.same(mask, ledger.flags_of(cell.form, code))
        action = ledger.act(cell.form, code, masked=cell.mask)
        agent = int(env.agent.rpartition("_")[2])
        decision = found[code] = Decision(agent, code, action)
        seen, decision.reward, *end, info = env.step(action)
        decision.following, decision.end = _code(seen, cell), (end[0], end[1])
        is_over = any(end)
