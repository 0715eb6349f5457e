"""An open environment as the adapter plays it: names, roles, who learns, how each is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

from gamekeeper.adapters.others import require_policies
from gamekeeper.adapters.rllib.spaces import Sight, sight
from gamekeeper.core.contract import Contract
from gamekeeper.core.episode_seeds import EpisodeSeeds
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Cast, Choices
from gamekeeper.game.converting.slim import slim
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.form import form_of


@dataclass(frozen=True, slots=True)
class Game:
    """An open environment, and what of it RLlib plays.

    Attributes:
        env, api: the environment; `aec` or `parallel`.
        sights: by the name of each learner, in the order of `possible_agents`.
        role_of: by the name of each agent, learner or not, likewise.
        agent_of, name_of: names are texts, which an environment's own agents needn't be.
        cast: who plays the others; None where there are none.
    """

    env: Any
    api: str
    sights: Mapping[str, Sight]
    role_of: Mapping[str, str]
    agent_of: Mapping[str, Any]
    name_of: Mapping[Any, str]
    cast: Cast | None


class Options(TypedDict, total=False):
    """How RLlib plays an environment: `multi_agent_env` says what each of them is."""

    role: str | None
    others: Choices
    masks: bool
    flatten: bool
    env_kwargs: Mapping[str, Any] | None


def opened_game(
    spec: object,
    *,
    role: str | None = None,
    others: Choices = None,
    masks: bool = True,
    flatten: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
) -> Game:
    """Opens an environment, and settles who learns and who plays the rest.

    Raises:
        SpecError: nobody has the role, somebody has no policy, or the agents have no names yet.
    """
    opened = open_env(spec, **dict(env_kwargs or {}))
    try:
        contract = declared_contract(None, opened) or Contract()
        env = slim(opened.env)
        sights = _sights(env, opened.api, contract, masks=masks, flatten=flatten)
        role_of = {str(agent): _role(contract, agent) for agent in sights}
        learners = _learners(role_of, role)
        rest = [agent for agent in sights if str(agent) not in learners]
        cast = None
        if rest:
            require_policies(rest, others, lambda agent: role_of[str(agent)])
            cast = cast_of(others, opened.env, contract)
        elif others:
            raise SpecError(
                "there are policies for others, and everybody learns", where="others",
                seen=repr(others)[:200], mend="name the role that learns",
            )  # fmt: skip
    except BaseException:
        opened.env.close()
        raise
    return Game(
        env, opened.api, {str(a): one for a, one in sights.items() if str(a) in learners}, role_of,
        {str(agent): agent for agent in sights}, {agent: str(agent) for agent in sights}, cast,
    )  # fmt: skip


def _sights(
    env: Any, api: str, contract: Contract, *, masks: bool, flatten: bool
) -> dict[Any, Sight]:
    """How each agent is seen, in the order of `possible_agents`."""
    given = env.reset(seed=EpisodeSeeds(0)[0])  # where masks stand is known once it was reset
    form = form_of(env, api, contract, env.infos if api == "aec" else given[1])
    found = {
        agent: sight(group, contract.mask_of(agent), masks=masks, flatten=flatten)
        for group in form.groups
        for agent in group.agents
    }
    return {agent: found[agent] for agent in env.possible_agents}


def _role(contract: Contract, agent: Any) -> str:
    return contract.role_of(agent) or role_in_name(str(agent))


def _learners(role_of: Mapping[str, str], role: str | None) -> list[str]:
    learners = [name for name, own in role_of.items() if role in (None, own, name)]
    if not learners:
        raise SpecError(
            f"nobody has the role {role!r}", where="role", seen=repr(role),
            expected=", ".join(dict.fromkeys(role_of.values())),
        )  # fmt: skip
    return learners
