"""Compares what BenchMARL's buffer holds, once it has learnt from the ledger, with the log."""

from __future__ import annotations

import tempfile
from typing import Any, Final
from unittest import mock

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from tests.adapters import ledger
from tests.adapters.ledger import Cell
from tests.adapters.sb3_books import ENVS, SEED, log, steps_of

GROUP: Final = "dog"


def buffer(cell: Cell) -> str:
    """Runs one iteration of IPPO that acts by the ledger's rule; says why if refused.

    The buffer is read after the losses have: what stands there is what was learnt from.
    """
    from gamekeeper.adapters.benchmarl import task

    role: dict[str, Any] = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    try:
        made = task(cell.spec, check=None, max_steps=steps_of(cell), env_kwargs=cell.kwargs, **role)
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0]}"
    with tempfile.TemporaryDirectory() as folder:
        run = _experiment(made, cell, folder)
        run.run()
        rows = run.replay_buffers[GROUP][:].reshape(ENVS, steps_of(cell))
        compare(rows, cell)
        run.close()
    return ""


def _experiment(made: Any, cell: Cell, folder: str) -> Any:
    """IPPO whose actions are the rule's, with the probabilities of its own network."""
    from benchmarl.algorithms import Ippo, IppoConfig
    from benchmarl.experiment import Experiment
    from tensordict.nn import TensorDictModule, TensorDictSequential

    from examples.benchmarl_spread import model, settings

    def by_rule(_: Any, policy: Any, group: str, continuous: bool) -> Any:
        keys = [(group, key) for key in ("observation", "mask", "action")]
        rule = TensorDictModule(_rule(cell), in_keys=keys, out_keys=keys[-1:])
        return TensorDictSequential(policy, rule)

    frames = ENVS * steps_of(cell)
    config = settings(ENVS, frames, folder)
    config.on_policy_collected_frames_per_batch = config.on_policy_minibatch_size = frames
    config.on_policy_n_minibatch_iters, config.checkpoint_at_end = 1, False
    algorithm = IppoConfig.get_from_yaml()
    with mock.patch.object(Ippo, "_get_policy_for_collection", by_rule):
        return Experiment(
            task=made, algorithm_config=algorithm, model_config=model(), seed=SEED, config=config
        )


def _rule(cell: Cell) -> Any:
    import torch

    def act(seen: Any, acting: Any, drawn: Any) -> Any:
        chosen = torch.zeros_like(drawn)
        for at in map(tuple, np.argwhere(acting.numpy()).tolist()):
            code = ledger.decode(cell.seen, row(seen, at, cell))
            chosen[at] = torch.as_tensor(ledger.act(cell.form, code, masked=cell.mask))
        return chosen

    return act


def row(seen: Any, at: tuple[int, ...], cell: Cell) -> Any:
    """One agent's observation, in the form of its space."""
    return spaces.unflatten(ledger.SEEN[cell.seen], seen[at].numpy())


def compare(rows: Any, cell: Cell) -> None:
    """Asserts that the rows [env, step] in which agents acted, and ended, are those of the log."""
    whole = log(cell)
    for env in range(rows.batch_size[0]):
        for agent in range(rows[GROUP].batch_size[-1]):
            _compare_agent(
                rows[env][GROUP][:, agent], rows[env]["next", GROUP][:, agent], cell, whole
            )
    assert not whole


def _compare_agent(own: Any, after: Any, cell: Cell, whole: dict[Any, Any]) -> None:
    """Takes an agent's decisions out of the log, one after the other."""
    decision, paid = None, 0.0
    for step in range(len(own)):
        at = (step,)
        if own["mask"][at]:
            seen = row(own["observation"], at, cell)
            code = ledger.decode(cell.seen, seen)
            if decision is not None:
                assert (code, paid) == (decision.following, decision.reward)
                assert decision.end == (False, False)
            before, paid = (paid, 0.0) if decision is None else (None, 0.0)
            decision = whole.pop(code)
            assert before in (None, decision.before)
            ledger.same(seen, ledger.encode(cell.seen, code))
            ledger.same(np.ravel(own["action"][at].numpy()), np.ravel(decision.action))
            if cell.mask:
                ledger.same(own["action_mask"][at].numpy(), ledger.flat_flags(cell.form, code))
        elif "action_mask" in own.keys():  # noqa: SIM118  # a TensorDict iterates over rows
            assert own["action_mask"][at].sum() == 1
        paid += float(after["reward"][at])
        if after["done"][at] and decision is not None:
            flags = bool(after["terminated"][at]), bool(after["truncated"][at])
            final = ledger.decode(cell.seen, row(after["observation"], at, cell))
            assert (flags, final, paid) == (decision.end, decision.following, decision.reward)
            decision, paid = None, 0.0
