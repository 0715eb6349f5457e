"""Action masks of agents to move, and what they say. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.audit.checks._observations import spaces_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import MASK, Trace, Turn
from gamekeeper.errors import PolicyError
from gamekeeper.game.casting.mask import Reader, for_sample, reader

USUAL: Final = tuple(
    (f"{side}.{MASK}", reader(f"{side}.{MASK}")) for side in ("observation", "infos")
)
"""Where everybody looks for a mask."""


@dataclass(frozen=True, slots=True)
class Masked:
    """One look at one place where a mask stands.

    Attributes:
        place: `observation.action_mask` or another.
        space: the action space of the agent.
        mask: as it was given.
    """

    trace: Trace
    turn: Turn
    agent: str
    place: str
    space: Any
    mask: Any


def movers(api: str, turn: Turn) -> list[str]:
    """The live agents that are to move at this turn, whether or not they did."""
    ended = ended_in(turn)
    if api == "parallel":
        return [agent for agent in turn.agents if agent in turn.live - ended]
    acted = turn.order or tuple(turn.observations)  # at the last turn of a play it only looked
    return [agent for agent in acted if agent not in ended]


def places(contract: Contract, agent: str) -> tuple[tuple[str, Reader], ...]:
    """Where a mask of the agent may stand: where it is declared, else where everybody looks."""
    declared = contract.mask_of(agent) if contract.roles else None
    return USUAL if declared is None else ((declared, reader(declared)),)


def masks(contract: Contract, evidence: Gathered) -> Iterator[Masked]:
    """Every mask that an agent to move was given in a rollout."""
    known = spaces_of(evidence, "action")
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            for agent in movers(evidence.api, turn):
                for place, read in places(contract, agent):
                    mask = read(turn.observations.get(agent), turn.infos.get(agent))
                    if mask is not None and known.get(agent) is not None:
                        yield Masked(trace, turn, agent, place, known[agent], mask)


def mask_of(contract: Contract, turn: Turn, agent: str) -> Any:
    """The mask that holds for an agent; None where it may do everything."""
    seen, info = turn.observations.get(agent), turn.infos.get(agent)
    found = (read(seen, info) for _, read in places(contract, agent))
    return next((mask for mask in found if mask is not None), None)


def fits(space: Any, mask: Any) -> str | None:
    """Why a mask has not the form of the action space; None where it has."""
    try:
        for_sample(space, mask)
    except PolicyError as error:
        return f"{error.expected}, seen {error.seen}"
    except Exception as error:  # a mask may be any object
        return f"a mask for {space}, seen {type(error).__name__}: {error}"
    return None


def parts(space: Any, mask: Any) -> list[Any]:
    """One array of flags for each choice that the mask leaves, of Discrete and MultiDiscrete."""
    if isinstance(space, spaces.Discrete):
        return [np.asarray(mask)]
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        if isinstance(mask, np.ndarray) and mask.shape == (int(space.nvec.sum()),):
            return list(np.split(mask, np.cumsum(space.nvec)[:-1]))
        return [np.asarray(part) for part in mask]
    return []


def is_legal(space: Any, mask: Any, action: Any) -> bool:
    """Whether an action is in its space and, as far as that can be said, allowed by the mask."""
    try:
        if not space.contains(action):
            return False
        if mask is None:
            return True
        flags = parts(space, mask)
        if isinstance(space, spaces.Discrete):
            return bool(flags[0][int(action) - int(space.start)])
        chosen = np.asarray(action) - space.start if flags else ()
        return all(bool(part[int(at)]) for part, at in zip(flags, chosen, strict=True))
    except Exception:  # a mask that doesn't fit, an action that a foreign space can't judge
        return False


def lines(api: str, agent: str, place: str) -> str:
    """Lines of a proof that find the agent's mask."""
    side, _, path = place.partition(".")
    keys = "".join(f"[{key!r}]" for key in path.split("."))
    if api == "aec":
        value = "env.last()[0]" if side == "observation" else "env.last()[-1]"
        return f"agent = env.agent_selection\nmask = {value}{keys}"
    name = "observations" if side == "observation" else "infos"
    return f"agent = next(a for a in {name} if str(a) == {agent!r})\nmask = {name}[agent]{keys}"
