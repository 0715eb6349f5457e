"""Checks of action masks."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.spaces.observation_values import spaces_of
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import type_name
from gamekeeper.episodes.episode import MASK, Episode, Turn
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import PolicyError
from gamekeeper.interface.action_mask import Reader, for_sample, reader

USUAL: Final = tuple(
    (f"{side}.{MASK}", reader(f"{side}.{MASK}")) for side in ("observation", "infos")
)
"""Usual places of a mask."""


@dataclass(frozen=True, slots=True)
class GivenMask:
    """One look at one place where a mask stands, such as `observation.action_mask`."""

    episode: Episode
    turn: Turn
    agent: str
    place: str
    space: Any
    mask: Any


def movers(api: str, turn: Turn) -> list[str]:
    """The live agents that are to move at this turn, whether or not they did."""
    ended = ended_in(turn)
    if api == "parallel":
        live = turn.live - ended
        return [agent for agent in turn.agents if agent in live]
    acted = turn.order or tuple(turn.observations)  # at the last turn of a play it only looked
    return [agent for agent in acted if agent not in ended]


def mask_places(contract: Contract, agent: str) -> tuple[tuple[str, Reader], ...]:
    """Places where the agent's mask may stand: the declared one, else the usual ones."""
    declared = contract.mask_of(agent) if contract.roles else None
    return USUAL if declared is None else ((declared, reader(declared)),)


def masks(contract: Contract, evidence: ProbeEvidence) -> Iterator[GivenMask]:
    """Every mask that an agent to move was given in a rollout."""
    known = spaces_of(evidence, "action")
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            for agent in movers(evidence.api, turn):
                seen, info = turn.observations.get(agent), turn.infos.get(agent)
                for place, read in mask_places(contract, agent):
                    mask = read(seen, info)
                    if mask is not None and known.get(agent) is not None:
                        yield GivenMask(episode, turn, agent, place, known[agent], mask)


def without_masks(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Says that no agent is given a mask anywhere; None where one is, or nothing was played."""
    is_played = any(episode.turns for episode in evidence["rollout"])
    if (
        not is_played
        or _none_declared(contract, evidence) is None
        or any(masks(contract, evidence))
    ):
        return None
    return "no agent is given an action mask"


def mask_of(contract: Contract, turn: Turn, agent: str) -> Any:
    """The mask that holds for an agent; None where it may do everything."""
    seen, info = turn.observations.get(agent), turn.infos.get(agent)
    found = (read(seen, info) for _, read in mask_places(contract, agent))
    return next((mask for mask in found if mask is not None), None)


def fits(space: Any, mask: Any) -> str | None:
    """Reason why a mask doesn't have the form of the action space; None where it has."""
    try:
        for_sample(space, mask)
    except PolicyError as error:
        return f"{error.expected}, actual {error.actual}"
    except Exception as error:  # a mask may be any object
        return f"a mask for {space}, actual {said_by(error)}"
    return None


def is_joint(space: Any, mask: Any) -> bool:
    """Tells whether a mask has one number for each joint action of a space of several choices."""
    counts = [count for count, _ in _choices(space)]
    if not counts or not isinstance(mask, np.ndarray):
        return False
    in_order = sorted if isinstance(space, spaces.Dict) else list  # Gymnasium sorts the names
    return in_order(mask.shape) == in_order(counts) and fits(space, mask) is not None


def _choices(space: Any) -> list[tuple[int, int]]:
    """Number of values, and the first, of each choice: of MultiDiscrete, Tuple or Dict; else none.

    A part of Tuple or Dict that is no Discrete leaves none.
    """
    if isinstance(space, spaces.MultiDiscrete):
        return list(zip(space.nvec.ravel().tolist(), space.start.ravel().tolist(), strict=True))
    if not isinstance(space, spaces.Tuple | spaces.Dict):
        return []
    parts = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
    found = [(int(each.n), int(each.start)) for each in parts if isinstance(each, spaces.Discrete)]
    return found if len(found) == len(parts) else []


def _allows(space: Any, mask: Any, action: Any) -> bool:
    """Tells what a mask of joint actions says; True where a Dict's names fit several axes."""
    is_named = isinstance(space, spaces.Dict)
    values = [action[name] for name in space.spaces] if is_named else np.ravel(action)
    choices = _choices(space)
    chosen = [int(value) - start for value, (_, start) in zip(values, choices, strict=True)]
    if is_named:
        at = dict(zip((count for count, _ in choices), chosen, strict=True))
        if len(at) < len(chosen):
            return True
        chosen = [at[size] for size in mask.shape]
    return bool(mask[tuple(chosen)])


def is_shared(space: Any, mask: Any) -> bool:
    """Tells whether a mask has a number for each value, and all choices of its space share it."""
    if not isinstance(space, spaces.MultiDiscrete) or not isinstance(mask, np.ndarray):
        return False
    return {mask.shape} == {(size,) for size in space.nvec.ravel().tolist()}


def is_in_parts(space: Any, mask: Any) -> bool:
    """Tells whether a mask of several choices has named parts, one of which may hang on another."""
    return isinstance(mask, Mapping) and isinstance(space, spaces.MultiDiscrete | spaces.Tuple)


def stands_elsewhere(space: Any, turn: Turn, agent: str) -> bool:
    """Tells whether an agent is given a mask under a name that nobody reads: `mask`."""
    sizes = {int(getattr(space, "n", 0))}
    if isinstance(space, spaces.MultiDiscrete):
        sizes = {int(space.nvec.sum()), int(space.nvec.prod())}
    if isinstance(space, spaces.Tuple):  # a flag for each joint choice
        sizes = {math.prod(int(getattr(part, "n", 0)) for part in space.spaces)}
    given = (turn.observations.get(agent), turn.infos.get(agent))
    found = (each.get("mask") for each in given if isinstance(each, Mapping))
    return any(isinstance(mask, np.ndarray | list) and np.size(mask) in sizes for mask in found)


def mask_parts(space: Any, mask: Any) -> list[Any]:
    """One array of flags for each choice that the mask leaves, of Discrete and MultiDiscrete."""
    if isinstance(space, spaces.Discrete):
        return [np.asarray(mask)]
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        if isinstance(mask, np.ndarray) and mask.shape == (int(space.nvec.sum()),):
            return list(np.split(mask, np.cumsum(space.nvec)[:-1]))
        return [np.asarray(part) for part in mask]
    return []


def is_legal(space: Any, mask: Any, action: Any) -> bool:
    """Tells whether an action is in its space and, as far as can be said, allowed by the mask."""
    try:
        if not space.contains(action):
            return False
        if mask is None:
            return True
        if is_joint(space, mask):
            return _allows(space, mask, action)
        if _is_unread(space, mask):
            return False
        flags = mask_parts(space, mask)
        if isinstance(space, spaces.Discrete):
            return bool(flags[0][int(action) - int(space.start)])
        chosen = np.asarray(action) - space.start if flags else ()
        return all(bool(part[int(at)]) for part, at in zip(flags, chosen, strict=True))
    except Exception:  # a mask that doesn't fit, an action that a foreign space can't judge
        return False


def _is_unread(space: Any, mask: Any) -> bool:
    """Tells whether a mask says of continuous actions what no list of flags can: bounds."""
    if isinstance(space, spaces.Box):
        return mask is not None and not np.all(np.asarray(mask) == 1)
    if isinstance(space, spaces.Dict):
        return any(_is_unread(part, mask.get(key)) for key, part in space.items())
    if isinstance(space, spaces.Tuple):
        return any(map(_is_unread, space.spaces, mask))
    return False


def is_alone(space: Any, mask: Any) -> bool:
    """Tells whether a mask is that of the one choice of a space whose other parts are numbers."""
    if not isinstance(space, spaces.Tuple | spaces.Dict):
        return False
    parts = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
    choices = [part for part in parts if not isinstance(part, spaces.Box)]
    return (
        len(choices) == 1
        and isinstance(choices[0], spaces.Discrete | spaces.MultiDiscrete)
        and fits(choices[0], mask) is None
    )


def mask_lines(api: str, agent: str, place: str) -> str:
    """Lines of a proof that find the agent's mask."""
    side, _, path = place.partition(".")
    keys = "".join(f"[{key!r}]" for key in path.split("."))
    if api == "aec":
        value = "env.last()[0]" if side == "observation" else "env.last()[-1]"
        return f"agent = env.agent_selection\nmask = {value}{keys}"
    name = "observations" if side == "observation" else "infos"
    return f"agent = next(a for a in {name} if str(a) == {agent!r})\nmask = {name}[agent]{keys}"


OF_MASKS: Final[dict[str, Any]] = {
    "applies": without_masks,
    "looks_at": "an agent with an action mask",
}


@check("GK230", HIGH, "rollout", "spaces", **OF_MASKS)
def masks_fit_the_action_space(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An action mask has one number for each action of its agent, no more and no fewer.

    A mask of another length, or of another agent's action space, can't be laid over what a policy
    may choose: some actions are never offered, or choosing crashes. One number for each joint
    action of several choices (MultiDiscrete, or a Tuple or Dict of Discrete) is a mask too, and so
    is one for each value where all choices share it, or where only one part of a Tuple or Dict is a
    choice, and the others are numbers of a Box. Of a dictionary for choices without names, as of
    the kinds of an action and the targets of each, nothing is said.

    Bad:
        spaces.Discrete(5); mask = np.ones(4, np.int8)      # "stay" was forgotten

    Good:
        spaces.Discrete(5); mask = np.ones(5, np.int8)

    Fix: give a mask with one number for each action of the agent's action space
    """
    for each in masks(contract, evidence):
        if is_in_parts(each.space, each.mask):
            continue
        where = each.episode.at(each.turn, each.agent, each.place)
        fault = fits(each.space, each.mask)
        others = (is_joint, is_shared, is_alone)
        if fault is None or any(is_one(each.space, each.mask) for is_one in others):
            yield Case(where, True)
            continue
        expected, _, seen = fault.partition(", actual ")
        proof = mask_lines(evidence.api, each.agent, each.place)
        yield Case(
            where, False, expected, seen, proof=f"{proof}\nenv.action_space(agent).sample(mask)"
        )


@check("GK231", MEDIUM, "rollout", "spaces", **OF_MASKS)
def masks_are_int8_zeros_and_ones(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An action mask is an int8 array of zeros and ones, so that `space.sample(mask)` takes it.

    Gymnasium refuses masks of bool, of other whole numbers, and lists, so whoever samples as
    PettingZoo's documentation does fails at the first action. A mask whose space says int8 is also
    outside its observation space in all but name.

    Bad:
        {"observation": board, "action_mask": board == 0}                    # bool

    Good:
        {"observation": board, "action_mask": (board == 0).astype(np.int8)}

    Fix: give masks as np.int8 arrays of 0 and 1: mask.astype(np.int8)
    """
    for each in masks(contract, evidence):
        if not isinstance(each.space, spaces.Discrete | spaces.MultiDiscrete):
            continue
        if fits(each.space, each.mask) is not None:  # told by another check
            continue
        seen = _fault(each.space, each.mask)
        proof = mask_lines(evidence.api, each.agent, each.place)
        yield Case(
            each.episode.at(each.turn, each.agent, each.place),
            seen is None,
            "an int8 array of 0 and 1",
            seen,
            proof=f"{proof}\nenv.action_space(agent).sample(mask)",
        )


def _fault(space: Any, mask: Any) -> str | None:
    if isinstance(space, spaces.Discrete) or space.nvec.ndim != 1:
        return _fault_of(mask)
    if isinstance(mask, np.ndarray) and mask.shape == (int(space.nvec.sum()),):
        return None  # a flat one is cut by its readers, whatever its dtype
    faults = [_fault_of(part) for part in mask]
    return next((fault for fault in faults if fault is not None), None)


def _fault_of(mask: Any) -> str | None:
    if isinstance(mask, tuple):
        return next((fault for fault in map(_fault_of, mask) if fault is not None), None)
    if not isinstance(mask, np.ndarray):
        return f"a {type_name(mask)}"
    if mask.dtype != np.int8:
        return f"an array of {mask.dtype}"
    strange = mask[(mask != 0) & (mask != 1)]
    return None if strange.size == 0 else f"{strange.flat[0].item()} among the numbers"


@check("GK233", HIGH, "rollout", "spaces", **OF_MASKS)
def masks_allow_something(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The mask of a live agent that is to move allows at least one action.

    With nothing to choose from a policy crashes, or a softmax over minus infinity gives NaN. An
    all-zero mask of an agent that isn't to move, or has ended, is right. Where the mask in the info
    is another than the one in the observation, that is GK234's.

    Bad:
        mask = np.zeros(n, np.int8)                    # it is stuck, and it is its turn

    Good:
        mask[NOOP] = 1                                 # or the agent terminates when it is stuck

    Fix: allow an action that does nothing, end the agent, or don't let it be its turn
    """
    for each in masks(contract, evidence):
        if fits(each.space, each.mask) is not None:
            continue
        flags = mask_parts(each.space, each.mask)
        if not flags:
            continue
        is_stuck = not all(part.any() for part in flags)
        if is_stuck and not all(_same(*pair) for pair in _pair_of(each.turn, each.agent)):
            continue
        proof = mask_lines(evidence.api, each.agent, each.place)
        test = (
            "all(np.any(part) for part in mask)" if isinstance(each.mask, tuple) else "mask.any()"
        )
        test += " or any(env.last()[2:4])" if evidence.api == "aec" else ""  # one that has ended
        yield Case(
            each.episode.at(each.turn, each.agent, each.place),
            not is_stuck,
            "an action that is allowed",
            "none is",
            proof=f"{proof}\nassert {test}, mask",
        )


@check(
    "GK234",
    HIGH,
    "rollout",
    applies=without_masks,
    looks_at="an agent with a mask both in its info and in its observation",
)
def masks_agree(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The action mask in an agent's info is the same as the one in its observation.

    Some readers take the one, some the other: where they disagree, half of the trainers play
    another game, and choose actions that the environment refuses.

    Bad:
        infos[agent] = {"action_mask": np.ones(n, np.int8)}        # the observation's says less

    Good:
        infos[agent] = {"action_mask": observations[agent]["action_mask"].copy()}

    Fix: make the mask once and put it into both places, or into one of them only
    """
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            for agent in movers(evidence.api, turn):
                for seen, told in _pair_of(turn, agent):
                    where = episode.at(turn, agent, f"infos[{MASK!r}]")
                    yield Case(where, _same(seen, told), seen, told, _proof(evidence.api, agent))


def _pair_of(turn: Turn, agent: str) -> Iterator[tuple[Any, Any]]:
    """Yields the masks of an agent's observation and of its info, where it has both."""
    places = turn.observations.get(agent), turn.infos.get(agent)
    seen, told = (each.get(MASK) if isinstance(each, dict) else None for each in places)
    if seen is not None and told is not None:
        yield seen, told


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(_same, one, other))
    try:
        return bool(np.array_equal(np.asarray(one), np.asarray(other)))
    except Exception:  # masks may be any objects
        return False


def _proof(api: str, agent: str) -> str:
    if api == "aec":
        found = "observation, _, _, _, info = env.last()"
    else:
        found = (
            f"agent = next(a for a in observations if str(a) == {agent!r})\n"
            "observation, info = observations[agent], infos[agent]"
        )
    return (
        f"{found}\n"
        f"one, other = observation[{MASK!r}], info[{MASK!r}]\n"
        "assert np.array_equal(one, other), (one, other)"
    )


def _none_declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    is_declared = any(role.mask not in (None, "none") for role in contract.roles.values())
    return None if is_declared else "the contract says of no role where its mask stands"


@check(
    "GK236", MEDIUM, "rollout", applies=_none_declared, looks_at="a mask that the contract declares"
)
def masks_stand_where_declared(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A mask stands where the contract says it does, in each episode in which its agent moves.

    Policies look for it at that place, and take everything for legal where they find nothing.

    Bad:
        mask = "infos.action_mask"           # and the environment puts it into the observation

    Good:
        mask = "observation.action_mask"

    Fix: put the mask where roles.<role>.mask says, or declare where it stands
    """
    for episode in evidence["rollout"]:
        first: dict[str, int] = {}
        found: set[str] = set()
        for turn in episode.turns:
            for agent in movers(evidence.api, turn):
                place = contract.mask_of(agent)
                if place is not None:
                    first.setdefault(agent, turn.index)
                    if mask_of(contract, turn, agent) is not None:
                        found.add(agent)
        for agent, turn_index in first.items():
            place = str(contract.mask_of(agent))
            where = episode.at(turn_index, agent, place)
            proof = f"{mask_lines(evidence.api, agent, place)}\nassert mask is not None, {place!r}"
            yield Case(where, agent in found, f"a mask at {place}", "nothing stands there", proof)
