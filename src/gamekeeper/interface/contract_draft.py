"""Drafts of contracts: what can be seen of an environment without stepping it, and no more."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias

from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.contract import Contract, Question, Role
from gamekeeper.contract.pattern import exact, matches
from gamekeeper.contract.sections import RESERVED
from gamekeeper.contract.validation import can_be_told, together
from gamekeeper.episodes.agent_spec import AgentSpec, Space, agent_spec
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.spaces.nesting import check_extent
from gamekeeper.errors import ContractError, GamekeeperError
from gamekeeper.interface.authoring import Authored
from gamekeeper.interface.env_source import possible_agents_of

__all__ = ["agent_specs", "draft_contract", "draft_questions", "open_questions", "spaces_of"]

Env: TypeAlias = AECEnv[Any, Any, Any] | ParallelEnv[Any, Any, Any]
Kind: TypeAlias = tuple[Space | None, Space | None]
"""Observation and action space of an agent; None where the environment doesn't tell."""

NUMBERED: Final = re.compile(
    r"(?:(?P<stem>.*?[^\d_-])(?P<line>[_-]?)|(?P<stem2>.+)(?P<line2>[_-]))?\d+", re.DOTALL
)
"""`picker_0`, `picker-0` and `picker0` are a `picker`, `red_1_0` is a `red_1`, `0` an `agent`."""
LETTERED: Final = re.compile(
    r"(?P<stem>.+)(?P<line>[_-])[A-Za-z]|(?P<stem2>.*[a-z])[A-Z]", re.DOTALL
)
"""`wolf_a` and `wolfA` are a `wolf`, where another agent's name begins alike."""
MASK_KEY: Final = "action_mask"
"""Key of the mask in the Dict observations of PettingZoo's own environments."""


def draft_contract(env: Env) -> Contract:
    """The contract as far as the environment shows it before its first step.

    Seen are name, API, the roster's roles (agents whose names differ by a number or a letter, and
    whose spaces are equal), masks that stand in an observation space, the horizon of a `TickEnv` or
    `TurnEnv`, and a kernel's reward terms and endings. All else stays undeclared: `open_questions`
    asks for it.

    Args:
        env: is neither reset nor stepped.
    Raises:
        ContractError: it is no PettingZoo environment.
    """
    name, own = _metadata(env).get("name"), getattr(env, "unwrapped", env)
    return Contract(
        name=name if isinstance(name, str) and can_be_told(name) else None,
        api=_api(env),
        roles=_roles(
            {agent_name(agent): spaces_of(env, agent) for agent in possible_agents_of(env)}
        ),
        **(own.known_sections() if isinstance(own, Authored) else {}),
    )


def agent_specs(env: Env, contract: Contract) -> tuple[AgentSpec, ...]:
    """The lines of the agents in the roster, checked against their spaces.

    Raises:
        ContractError: declarations don't fit the agents' spaces; lists each of them once.
    """
    found: list[AgentSpec] = []
    mistakes: dict[str, GamekeeperError] = {}
    for agent in possible_agents_of(env):
        seen, done = spaces_of(env, agent)
        try:
            found.append(agent_spec(contract, agent, observation_space=seen, action_space=done))
        except ContractError as error:
            # A noop is told once for the first agent of its role, not for each.
            mistakes.setdefault(error.where, error)
    if mistakes:
        raise together(list(mistakes.values()), contract.places)
    return tuple(found)


def draft_questions(env: Env, contract: Contract) -> tuple[Question, ...]:
    """Questions that the contract leaves open, with hints from the environment.

    Raises:
        ContractError: a declaration doesn't fit the agents' spaces.
    """
    says = _metadata(env).get("is_parallelizable")
    return open_questions(
        contract,
        agent_specs(env, contract),
        parallelizable=says if isinstance(says, bool) else None,
    )


def _metadata(env: object) -> Mapping[str, object]:
    metadata = getattr(env, "metadata", None)
    return metadata if isinstance(metadata, Mapping) else {}


def _api(env: object) -> str:
    if isinstance(env, ParallelEnv):
        return "parallel"
    if isinstance(env, AECEnv):
        return "aec"
    raise ContractError(
        "only a PettingZoo environment has a structure to draft",
        expected="an AECEnv or a ParallelEnv",
        actual=f"{type(env).__module__}.{type(env).__qualname__}",
        fix="hand over the environment that its factory returns",
    )


def spaces_of(env: Env, agent: object) -> Kind:
    """Observation and action space of an agent, as far as the environment tells before reset."""
    return _space(env.observation_space, agent), _space(env.action_space, agent)


def _space(ask: Callable[[Any], object], agent: object) -> Space | None:
    """The space, or None where the environment can't tell before reset."""
    try:
        space = ask(agent)
    except Exception:
        # Foreign code may raise anything here. What it doesn't tell stays undeclared; the audit,
        # not the draft, says that it should have told.
        return None
    if not isinstance(space, spaces.Space):
        return None
    check_extent(space)
    return space


def _stems(roster: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Text before each agent's number or letter, and the line between them.

    Agents with neither have no entry, nor has one with a letter that no other name begins like: the
    `x` of `agent_x` numbers nothing.
    """
    numbered, lettered = (
        {agent: _parts(found) for agent in roster if (found := suffix.fullmatch(agent))}
        for suffix in (NUMBERED, LETTERED)
    )
    count = Counter([*numbered.values(), *lettered.values()])
    return numbered | {agent: stem for agent, stem in lettered.items() if count[stem] > 1}


def _parts(found: re.Match[str]) -> tuple[str, str]:
    parts = found.groupdict(default="")
    return parts["stem"] or parts["stem2"], parts["line"] or parts.get("line2", "")


def _roles(kinds: Mapping[str, Kind]) -> dict[str, Role]:
    """Roles of agents that are called alike and have equal spaces."""
    stems = _stems(list(filter(can_be_told, kinds)))
    groups: dict[str, list[list[str]]] = {}
    for agent in filter(can_be_told, kinds):
        stem, _ = stems.get(agent, (agent, ""))
        alike = groups.setdefault(stem or "agent", [])
        for group in alike:
            if kinds[group[0]] == kinds[agent]:
                group.append(agent)
                break
        else:
            alike.append([agent])
    return {
        name: Role(agents=_patterns(group, kinds, stems), mask=_mask(kinds[group[0]][0]))
        for name, group in _names(groups).items()
    }


def _names(groups: Mapping[str, list[list[str]]]) -> dict[str, list[str]]:
    """A name for each group: its stem, or the name of its first agent where a stem has several."""
    named: dict[str, list[str]] = {}
    for stem, alike in groups.items():
        for group in alike:
            name = stem if len(alike) == 1 else group[0]
            while name in named or name in RESERVED:
                name += "s"
            named[name] = group
    return named


def _patterns(
    group: list[str], roster: Iterable[str], stems: Mapping[str, tuple[str, str]]
) -> tuple[str, ...]:
    """One pattern for numbered or lettered agents where it covers no other; else their names."""
    if group[0] in stems:
        stem, line = stems[group[0]]
        ends = ("*", "[0-9]*", "[A-Za-z]") if line else ("[0-9]*", "[A-Z]")
        for pattern in (exact(stem) + line + end for end in ends):
            if {agent for agent in roster if matches(pattern, agent)} == set(group):
                return (pattern,)
    return tuple(exact(agent) for agent in group)


def _mask(space: Space | None) -> str | None:
    seen = isinstance(space, spaces.Dict) and MASK_KEY in space.spaces
    return f"observation.{MASK_KEY}" if seen else None
