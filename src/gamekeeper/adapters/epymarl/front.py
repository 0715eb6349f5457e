"""What users and EPyMARL's registry call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.epymarl.env import MultiAgentEnv
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Choices
from gamekeeper.game.open import open_env

TOTALS: Final = ("sum", "mean")
STATES: Final = ("state", "observations")


def multi_agent_env(
    spec: object,
    *,
    role: str | None = None,
    others: Choices = None,
    common_reward: bool = True,
    reward_scalarisation: str = "sum",
    time_limit: int | None = None,
    state: str | None = None,
    check: str | None = "quick",
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
) -> MultiAgentEnv:
    """A multi-agent environment with EPyMARL's methods, as its runners and learners call them.

    | | |
    |---|---|
    | kept | the order of agents, that of `possible_agents`; every agent's own reward with `common_reward=False`; masks as available actions; `state()`; truncation apart from termination, for all in `truncated` and `info["episode_limit"]`, for each in `terminations` and `truncations`; infos of agents in `infos`; seeds: without one of its own, reset k plays episode k of run `seed`, the same as `gk.rollout`, and `reset(seed=s)` is the environment's own, with the others' draws from s |
    | changed | observations are flat float32 vectors without their mask (parts of a Discrete are one-hot, as Gymnasium flattens them; no name or role of an agent is added), padded with zeros to the longest, actions counted from 0 and padded to the most, with those that an agent hasn't never available; whoever is not there (ended, or not yet come) sees zeros and has one action only, its role's noop by the contract, else 0, which is passed over; with `common_reward` the reward is the sum or the mean over all agents. In an AEC environment a step is one turn: the others have that one action, and see what they would be shown. Without a `state_space`, or with `state="observations"`, the state is everybody's observations |
    | lost | who ended when, to learners: EPyMARL has one end for all, when the last agent has ended. Parts of rewards by term |
    | refused | actions that aren't Discrete (give the environment some), observations without a fixed length, an environment that never says when it is over (`time_limit=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        role: only its agents are the environment's; None: everybody.
        others: policies of the others, one for all or by agent or role.
        common_reward: one reward for all, else one for each.
        reward_scalarisation: `sum` or `mean`, of the common one.
        time_limit: steps after which an episode is cut, and what EPyMARL reserves memory for; None:
            the contract's horizon.
        state: `state`: the environment's own; `observations`; None: its own where it has one.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    for name, value, known in (
        ("reward_scalarisation", reward_scalarisation, TOTALS),
        ("state", state, (*STATES, None)),
    ):
        if value not in known:
            raise SpecError(
                f"there is no such {name}", where=name, seen=repr(value),
                expected=" or ".join(str(one) for one in known),
            )  # fmt: skip
    checked(spec, check, env_kwargs=env_kwargs)
    opened = open_env(spec, **dict(env_kwargs or {}))
    try:
        env = MultiAgentEnv(opened, role, others, time_limit=time_limit, state=state, seed=seed)
    except BaseException:
        opened.env.close()
        raise
    env.common_reward, env.is_mean = common_reward, reward_scalarisation == "mean"
    return env


def gymma(
    key: str,
    time_limit: int | None = None,
    pretrained_wrapper: None = None,
    seed: int = 0,
    common_reward: bool = True,
    reward_scalarisation: str = "sum",
    **env_kwargs: Any,
) -> MultiAgentEnv:
    """`multi_agent_env` with the arguments that EPyMARL hands to an entry of its REGISTRY.

    `envs.REGISTRY["gamekeeper"] = gymma`, then `env_args.key=warehouse`; what else stands in
    `env_args` goes to the environment.

    Raises:
        SpecError: a `pretrained_wrapper` is asked for: `multi_agent_env` has `others`.
        ContractError: see there.
    """
    if pretrained_wrapper is not None:
        raise SpecError(
            "pretrained wrappers are EPyMARL's own", where="pretrained_wrapper",
            seen=repr(pretrained_wrapper), mend="multi_agent_env(spec, role=..., others=...)",
        )  # fmt: skip
    return multi_agent_env(
        key, time_limit=time_limit, seed=seed, common_reward=common_reward,
        reward_scalarisation=reward_scalarisation, env_kwargs=env_kwargs,
    )  # fmt: skip
