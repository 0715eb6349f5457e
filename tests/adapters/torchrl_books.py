"""Compares what TorchRL's collector gives, once it has played the ledger, with the log."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from gamekeeper.errors import SpecError
from tests.adapters import ledger
from tests.adapters.ledger import Cell, Decision
from tests.adapters.sb3_books import ENVS, GAMMA, SEED, log, steps_of, value

GROUP: Final = "dog"


def batches(cell: Cell) -> str:
    """Collects one batch by the ledger's rule and compares it; says why if refused.

    Values are `value` of what is seen, so that an advantage (lambda 0) is exactly the reward that
    was credited, half the value of what followed, less that of what was seen.
    """
    from torchrl.collectors import Collector

    from gamekeeper.adapters import torchrl

    role = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    try:
        env = torchrl.env(cell.spec, ENVS, check=None, seed=SEED, env_kwargs=cell.kwargs, **role)
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0]}"
    frames = ENVS * steps_of(cell)
    collector = Collector(env, by_rule(env, cell), frames_per_batch=frames, total_frames=frames)
    batch = next(iter(collector))
    for when in (batch, batch["next"]):
        when[GROUP, "state_value"] = _values(when[GROUP], cell)
    torchrl.advantages(batch, env.group_map, gamma=GAMMA, gae_lambda=0.0)
    whole = log(cell)
    compare(torchrl.decisions(batch, GROUP), cell, whole)
    compare_ends(batch, cell, whole)
    collector.shutdown()
    return ""


def by_rule(env: Any, cell: Cell) -> Any:
    """An actor that acts by the ledger's rule."""
    import torch

    def act(tensordict: Any) -> Any:
        chosen = env.full_action_spec[GROUP, "action"].zero()
        own = tensordict[GROUP]
        for at in map(tuple, np.argwhere(own["mask"].numpy()).tolist()):
            code = ledger.decode(cell.seen, row(own["observation"], at, cell))
            chosen[at] = torch.as_tensor(ledger.act(cell.form, code, masked=cell.mask))
        tensordict[GROUP, "action"] = chosen
        return tensordict

    return act


def row(seen: Any, at: tuple[int, ...], cell: Cell) -> Any:
    """One agent's observation, in the form of its space."""
    if hasattr(seen, "keys"):
        parts = {key: row(seen[key], at, cell) for key in seen.keys()}  # noqa: SIM118  # a TensorDict iterates over rows
        return tuple(parts.values()) if cell.seen == "Tuple" else parts
    array = seen[at].numpy()
    return array if array.ndim else array[()]


def _values(own: Any, cell: Cell) -> Any:
    import torch

    shape = own.batch_size
    found = [
        value(ledger.decode(cell.seen, row(own["observation"], at, cell)))
        for at in np.ndindex(*shape)
    ]
    return torch.tensor(found).reshape(*shape, 1)


def compare(rows: Any, cell: Cell, whole: dict[Any, Decision]) -> None:
    """Asserts that the decisions of a batch are those of the log."""
    count = len(rows)
    seen = [row(rows["observation"], (at,), cell) for at in range(count)]
    codes = [ledger.decode(cell.seen, one) for one in seen]
    assert sorted(codes) == sorted(whole)
    for at, code in enumerate(codes):
        decision, follows = whole[code], whole[code].following
        assert follows is not None
        ledger.same(seen[at], ledger.encode(cell.seen, code))
        ledger.same(np.ravel(rows["action"][at].numpy()), np.ravel(decision.action))
        assert int(rows["place"][at]) == decision.agent
        if cell.mask:
            ledger.same(rows["action_mask"][at].numpy(), ledger.flat_flags(cell.form, code))
        goes_on = 0.0 if decision.end[0] else GAMMA
        credited = decision.reward + goes_on * value(follows) - value(code)
        assert float(rows["advantage"][at]) == credited
        assert float(rows["value_target"][at]) == credited + value(code)


def compare_ends(batch: Any, cell: Cell, whole: dict[Any, Decision]) -> None:
    """Asserts that each agent's end, and what it saw then, stands beside its last decision."""
    own, after = batch[GROUP], batch["next", GROUP]
    ends = {code for code, decision in whole.items() if any(decision.end)}
    for env in range(batch.batch_size[0]):
        for agent in range(own.batch_size[-1]):
            last = None
            for step in range(batch.batch_size[1]):
                at = env, step, agent
                if own["mask"][at]:
                    last = ledger.decode(cell.seen, row(own["observation"], at, cell))
                if after["done"][at] and not own["done"][at] and last is not None:
                    flags = bool(after["terminated"][at]), bool(after["truncated"][at])
                    final = ledger.decode(cell.seen, row(after["observation"], at, cell))
                    assert (flags, final) == (whole[last].end, whole[last].following)
                    ends.remove(last)
                    last = None
    assert not ends
