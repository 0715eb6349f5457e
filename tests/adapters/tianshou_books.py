"""Compares what Tianshou's replay buffer holds, once it has played the ledger, with the log."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from gamekeeper.errors import SpecError
from tests.adapters import ledger
from tests.adapters.ledger import Cell
from tests.adapters.sb3_books import ENVS, EPISODES, SEED, log

TUPLES: Final = "refused: Tianshou has no tuples of observations"
PARTS: Final = "refused: Tianshou masks Discrete actions alone"


def expected(cell: Cell) -> str:
    """Reason why a cell is refused; empty where it is taken."""
    if cell.mask and cell.form == "MultiDiscrete":
        return PARTS
    return TUPLES if cell.seen == "Tuple" else ""


def buffer(cell: Cell) -> str:
    """Collects episodes by the ledger's rule and compares the buffer; says why if refused."""
    from tianshou.data import VectorReplayBuffer

    from gamekeeper.adapters import tianshou

    role: dict[str, Any] = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    try:
        env = tianshou.vector_env(
            cell.spec, ENVS, check=None, seed=SEED, env_kwargs=cell.kwargs, **role
        )
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0]}"
    collector = tianshou.Collector(by_rule(env, cell), env, VectorReplayBuffer(400, len(env)))
    collector.reset()
    collector.collect(n_episode=ENVS * EPISODES)
    compare(collector.buffer.sample_indices(0), collector.buffer, cell)
    env.close()
    return ""


def by_rule(env: Any, cell: Cell) -> Any:
    """A policy that acts by the ledger's rule."""
    import torch
    from tianshou.algorithm.algorithm_base import Policy
    from tianshou.data import Batch

    class Rule(Policy):
        def forward(self, batch: Any, state: Any = None, **kwargs: Any) -> Any:
            codes = [ledger.decode(cell.seen, row) for row in rows(seen_in(batch.obs, cell))]
            acts = [ledger.act(cell.form, code, masked=cell.mask) for code in codes]
            return Batch(act=torch.as_tensor(np.array(acts)))

    return Rule(action_space=env.action_space)


def compare(indices: Any, held: Any, cell: Cell) -> None:
    """Asserts that a buffer holds the log, transition by transition."""
    batch, whole = held[indices], log(cell)
    seen, after = (rows(seen_in(part, cell)) for part in (batch.obs, batch.obs_next))
    codes = [ledger.decode(cell.seen, row) for row in seen]
    assert sorted(codes) == sorted(whole)
    for at, code in enumerate(codes):
        decision = whole[code]
        assert decision.following is not None
        ledger.same(seen[at], ledger.encode(cell.seen, code))
        ledger.same(after[at], ledger.encode(cell.seen, decision.following))
        ledger.same(np.ravel(batch.act[at]), np.ravel(decision.action))
        assert batch.rew[at] == decision.reward
        assert (bool(batch.terminated[at]), bool(batch.truncated[at])) == decision.end
        if cell.mask:
            ledger.same(batch.obs.mask[at], ledger.flat_flags(cell.form, code))


def seen_in(obs: Any, cell: Cell) -> Any:
    """Observations without the mask that stands beside them."""
    return obs.obs if cell.mask else obs


def rows(seen: Any) -> list[Any]:
    """Observations one by one, of a Batch or an array."""
    if isinstance(seen, np.ndarray):
        return list(seen)
    parts = {key: rows(seen[key]) for key in seen.get_keys()}
    return [dict(zip(parts, row, strict=True)) for row in zip(*parts.values(), strict=True)]
