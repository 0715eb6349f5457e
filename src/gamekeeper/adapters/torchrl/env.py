"""`env`: what users call, and what it keeps, changes, loses and refuses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.torchrl.copies import Copies
from gamekeeper.adapters.torchrl.game_env import GameEnv
from gamekeeper.adapters.torchrl.others import Others
from gamekeeper.adapters.torchrl.seats import seats_of
from gamekeeper.game.casting.cast import Choices


def env(
    spec: object,
    num_envs: int | None = None,
    *,
    role: str | None = None,
    others: Choices = None,
    group_map: Any = None,
    state: bool | None = None,
    masks: bool | None = None,
    flatten: bool = False,
    check: str | None = "quick",
    seed: int = 0,
    engine: str = "serial",
    workers: int = 2,
    threads: int = 1,
    device: Any = "cpu",
    env_kwargs: Mapping[str, Any] | None = None,
) -> GameEnv:
    """Copies of a multi-agent environment as one `EnvBase`, agents nested in groups by role.

    For a group of A agents, batch size [num_envs, A]: `observation`, `action`, `reward`, `done`,
    `terminated`, `truncated`, `mask`, `action_mask`. For each copy, batch size [num_envs]: `done`,
    `terminated`, `truncated`, `state`.

    | | |
    |---|---|
    | kept | every agent's own end, with the last observation under `next`; truncation apart from termination, for each agent and for the copy, which is done when all its agents are; late joiners; roles with different spaces, each in its group; masks; `state()`, that of the end too; seeds: copy i plays the episodes i, i + num_envs, ... of run `seed`, the same ones as `gk.rollout` |
    | changed | who isn't there (has ended, hasn't joined) or, in an AEC environment, isn't in turn, has `mask` False and one legal action, the first, so that a masked policy learns nothing there; who has ended stays done until its copy is reset. An AEC step is one turn in each copy: who waits keeps what it was shown last, and is paid in the step in which it earned it (`advantages` credits that to its own last decision). A Dict observation loses its `action_mask`; of one other part only that part is left. Whole-number actions count from 0; rewards are float32 |
    | lost | infos but for the mask. With `engine="process"`: `state()`, and a reset of all copies in mid-episode begins another run (`core.seeds.episode_seed(seed, n)`) in place of the next episodes |
    | refused | a group whose agents differ in their spaces, others without a policy (`others=`), stepping some copies without the others, a reset of some copies in mid-episode with `engine="process"`, an environment that breaks its contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies; None: one, and no batch dimension.
        role: the role, or the one agent, that is seen; the rest follow `others`. None: everybody.
        others: policies of who isn't seen, one for all or by agent or role.
        group_map: agents by group, or TorchRL's `MarlGroupMapType`; None: by role.
        state: whether `state` is there; None: where the environment declares a `state_space`.
        masks: whether every group with discrete actions has an `action_mask`; None: where the
            environment has masks, or where agents act in turn.
        flatten: observations and state are one vector of float32 each, whole numbers one-hot.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; `set_seed` takes another one for the next reset.
        engine: `serial`, `process` or `kernel`, as in `gk.vector.make`.
        workers, threads: of the `process` and of the `kernel` engine.
        device: where tensors go.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    copies = Copies(
        spec, 1 if num_envs is None else num_envs, seed=seed, engine=engine, env_kwargs=env_kwargs,
        workers=workers, threads=threads, infos=others is not None,
    )  # fmt: skip
    try:
        seats = seats_of(copies, group_map, role)
        learners = {column for each in seats for column in each.columns.tolist()}
        rest = Others(copies, learners, others, spec, env_kwargs)
        return GameEnv(
            copies, seats, rest, is_batched=num_envs is not None, state=state, masks=masks,
            flatten=flatten, device=device,
        )  # fmt: skip
    except BaseException:
        copies.close()
        raise
