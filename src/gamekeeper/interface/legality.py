"""Legality of actions: an agent's space, and its mask of the moment.

A mask has the form that the space's own `sample(mask)` takes: int8 arrays, one for a Discrete or
MultiBinary space, a tuple of them for a MultiDiscrete one, and tuples and dictionaries of masks for
Tuple and Dict spaces. Anything else in the form of numbers is brought into it once, here, so that
policies, observations and the check of the next action all read the same mask.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.errors import ActionError, ContractError, PolicyError
from gamekeeper.interface.action_mask import for_sample
from gamekeeper.interface.author_calls import AgentId

NOTHING: Final = range(0)
GOOD: Final = {1: b"\0\1", 2: b"\0\1\2"}  # bytes of a mask, by its highest number


def judge(space: spaces.Space[Any], action: Any, mask: Any = None) -> tuple[bool, Any]:
    """Tells whether an action is in its space and legal, and gives it in the form for rules.

    A whole number of a Discrete space becomes a Python int: NumPy's integers overflow and lift
    float32 to float64, so rules would compute one thing while recorded and another when replayed.
    """
    if isinstance(space, spaces.Discrete):
        if isinstance(action, int | np.integer):
            number = int(action)
            fits = 0 <= number - int(space.start) < int(space.n)
        else:
            fits = _contains(space, action)
            number = int(action) if fits else 0
        return (True, number) if fits and allows(space, mask, number) else (False, action)
    return _contains(space, action) and allows(space, mask, action), action


def learn_ranges(
    agents: Iterable[AgentId],
    space_of: Callable[[Any], spaces.Space[Any]],
    spaces_known: dict[Any, spaces.Space[Any]],
    ranges: dict[Any, range],
    *,
    trusted: bool = True,
) -> None:
    """Notes the whole numbers of each Discrete space, which spares asking it at every turn.

    Args:
        agents: whose spaces are read.
        space_of: the environment's action_space.
        spaces_known: by agent, the space its range was read from; written.
        ranges: by agent; empty for other spaces, and where a number in range may be refused;
            written.
        trusted: False where there are masks.
    """
    for agent in agents:
        space = space_of(agent)
        if spaces_known.get(agent) is not space:
            spaces_known[agent] = space
            ranges[agent] = _range_of(space) if trusted else NOTHING


def allows(space: spaces.Space[Any], mask: Any, action: Any) -> bool:
    """Tells whether a mask permits an action that is in the space; no mask permits everything."""
    if mask is None:
        return True
    if isinstance(space, spaces.Discrete):
        return bool(mask[int(action) - int(space.start)])
    if isinstance(space, spaces.MultiDiscrete):
        return _allows_each(mask, action, space.start)
    if isinstance(space, spaces.MultiBinary):
        return bool(np.all((mask == 2) | (mask == action)))  # 2: free, else what it must be
    if isinstance(space, spaces.Tuple):
        return all(map(allows, space.spaces, mask, action))
    if isinstance(space, spaces.Dict):
        return all(allows(part, mask[name], action[name]) for name, part in space.spaces.items())
    return True


def tidy_mask(space: spaces.Space[Any], mask: Any, agent: AgentId) -> Any:
    """The mask in the form that the space's `sample(mask)` takes, made of new arrays.

    Raises:
        ContractError: it doesn't fit the space.
    """
    try:
        return _tidy(space, mask)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise ContractError(
            f"the mask of agent {agent!r} doesn't fit its action space",
            where=f"mask({agent!r})",
            expected=f"a mask that {space!r} can sample under",
            actual=f"{mask!r} ({error})"[:300],
            fix="Discrete(n): n numbers 0 or 1; None: everything is legal",
        ) from None


def forbidden(
    agent: AgentId, action: Any, space: spaces.Space[Any], mask: Any, *, then: str, fix: str = ""
) -> ActionError | None:
    """Error of an action that the space holds and the mask forbids; None of any other action.

    Args:
        then: the failure that followed.
        fix: advice to the learner that chose it.
    """
    try:
        mask = for_sample(space, mask)
    except PolicyError:  # which actions it means isn't known
        return None
    if not _contains(space, action) or allows(space, mask, action):
        return None
    error = refused(agent, action, space, mask)
    actual = f"{error.actual}; then {then}"
    return ActionError(**error.parts() | {"actual": actual, "fix": fix or error.fix})


def copied(mask: Any) -> Any:
    """A mask that shares no memory with the one given, so that whoever gets it may write to it."""
    if isinstance(mask, np.ndarray):
        return mask.copy()
    if isinstance(mask, tuple):
        return tuple(map(copied, mask))
    if isinstance(mask, dict):
        return {name: copied(part) for name, part in mask.items()}
    return mask


def refused(agent: AgentId, action: Any, space: spaces.Space[Any], mask: Any = None) -> ActionError:
    """Names the agent, the action, the space, and what would have been legal."""
    fits = _contains(space, action)
    expected = repr(space)
    fix = "ask the mask in infos or in the observation before acting" if fits else ""
    if action is None:
        fix = "only an agent that has ended acts None: look at last()'s two flags first"
    if isinstance(space, spaces.Discrete) and mask is not None:
        legal = (np.flatnonzero(mask) + int(space.start)).tolist()
        expected = (
            f"one of {legal} of {space!r}" if legal else f"nothing: the mask of {space!r} is all 0"
        )
    elif mask is not None:
        expected = f"{space!r} under the mask {mask!r}"[:300]
    return ActionError(
        f"agent {agent!r} did what is " + ("masked out" if fits else "not in its action space"),
        where=f"action_space({agent!r})",
        expected=expected,
        actual=_described(action),
        fix=fix,
    )


def mismatch(
    actions: Any,
    agents: Sequence[Any],
    fault_of: Callable[[Any], str] = lambda agent: "an action of",
) -> ActionError:
    """Names agents without an action, and actions without a live agent.

    Args:
        agents: those that must act.
        fault_of: what is said of an action of another agent, before its name.
    """
    if not isinstance(actions, Mapping):
        return ActionError(
            "the actions of a tick are no dictionary",
            where="step",
            expected="{agent: action} of every agent in env.agents",
            actual=f"{actions!r} ({type(actions).__name__})"[:300],
            fix="hand a dictionary of actions by agent to step",
        )
    faults: dict[str, list[str]] = {}
    for agent in agents:
        if agent not in actions:
            faults.setdefault("no action of", []).append(repr(agent))
    for agent in actions:
        if agent not in agents:
            faults.setdefault(fault_of(agent), []).append(repr(agent))
    seen = "; ".join(f"{fault} {', '.join(names)}" for fault, names in faults.items())
    return ActionError(
        "the actions of a tick aren't those of the live agents",
        where="step",
        expected=f"one of each of {agents!r}"[:300],
        actual=seen[:600],
        fix="build the dictionary over env.agents",
    )


def _described(action: Any) -> str:
    """An action with its type; of an array also dtype and shape, where most misfits lie."""
    kind = type(action).__name__
    if isinstance(action, np.ndarray):
        kind += f" of {action.dtype}, shape {action.shape}"
    return f"{repr(action)[:300]} ({kind})"


def _range_of(space: spaces.Space[Any]) -> range:
    """The whole numbers of a Discrete space; none for another, whose `contains` decides."""
    if type(space) is not spaces.Discrete:
        return NOTHING
    return range(int(space.start), int(space.start) + int(space.n))


def _contains(space: spaces.Space[Any], action: Any) -> bool:
    """Tells whether the space holds the action; what it can't even look at, it doesn't hold."""
    if isinstance(space, spaces.Box) and not isinstance(action, np.ndarray | np.generic):
        return False  # Gymnasium would warn, cast a copy, and hand the rules a list
    try:
        return bool(space.contains(action))
    except (TypeError, ValueError, AttributeError, OverflowError, KeyError, IndexError):
        return False


def _allows_each(mask: Any, action: Any, start: Any) -> bool:
    """The masks of a MultiDiscrete space, nested as its axes are."""
    if isinstance(mask, tuple):
        return all(map(_allows_each, mask, action, start))
    return bool(mask[int(action) - int(start)])


def _tidy(space: spaces.Space[Any], mask: Any) -> Any:
    if mask is None:
        return None
    if isinstance(space, spaces.Discrete):
        return _flags(mask, (int(space.n),), 1)
    if isinstance(space, spaces.MultiDiscrete):
        return _tidy_each(space.nvec, mask)
    if isinstance(space, spaces.MultiBinary):
        return _flags(mask, space.shape, 2)
    if isinstance(space, spaces.Tuple):
        return tuple(_tidy(part, given) for part, given in zip(space.spaces, mask, strict=True))
    if isinstance(space, spaces.Dict):
        if mask.keys() != space.spaces.keys():
            raise KeyError(f"keys {sorted(mask)}, not {sorted(space.spaces)}")
        return {name: _tidy(part, mask[name]) for name, part in space.spaces.items()}
    raise TypeError("no mask is defined for a space of this kind")


def _tidy_each(nvec: Any, mask: Any) -> Any:
    if getattr(nvec, "ndim", 0):
        return tuple(_tidy_each(part, given) for part, given in zip(nvec, mask, strict=True))
    return _flags(mask, (int(nvec),), 1)


def _flags(mask: Any, shape: tuple[int, ...], highest: int) -> NDArray[np.int8]:
    """Numbers of [0, highest] in the given shape, as a new int8 array."""
    given = mask if type(mask) is np.ndarray else np.asarray(mask)
    if given.shape != shape or given.dtype.kind not in "biu":
        raise ValueError(f"shape {given.shape} of {given.dtype}, not {shape} of whole numbers")
    flags = given.astype(np.int8)
    cut = given.itemsize > 1 and (given != flags).any()
    # what is left of the bytes without the good ones; comparing arrays takes five times as long
    if cut or flags.tobytes().translate(None, GOOD[highest]):
        raise ValueError(f"numbers outside 0..{highest}")
    return flags
