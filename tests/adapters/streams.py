"""An agent's stream of decisions: as an episode has it, and as whoever steps slots has it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces

MASK = "action_mask"


@dataclass
class Stream:
    """One agent in one episode.

    `seen`, `masks`, `did` by decision; `paid` what came between it and the next one; `before` what
    was paid before the first; `final` what was seen last.
    """

    seen: list[Any] = field(default_factory=list)
    masks: list[Any] = field(default_factory=list)
    did: list[Any] = field(default_factory=list)
    paid: list[float] = field(default_factory=list)
    before: float = 0.0
    end: tuple[bool, bool] = (False, False)
    final: Any = None

    def pay(self, reward: float) -> None:
        """To the last decision."""
        if self.paid:
            self.paid[-1] += reward
        else:
            self.before += reward


def chosen(space: spaces.Space[Any], seen: Any, mask: Any) -> Any:
    """An action that what is seen decides, among those that are legal."""
    number = int(sum(float(np.sum(part)) for part in _parts(seen)))
    flags = (
        np.ones(spaces.flatdim(space), bool)
        if mask is None
        else np.concatenate(
            [np.asarray(part, bool) for part in (mask if isinstance(mask, tuple) else (mask,))]
        )
    )
    if isinstance(space, spaces.Discrete):
        legal = np.flatnonzero(flags)
        return int(legal[number % len(legal)])
    if isinstance(space, spaces.MultiDiscrete):
        cuts = np.split(flags, np.cumsum(space.nvec)[:-1])
        return np.array([int(np.flatnonzero(part)[-1]) for part in cuts])
    return np.full(space.shape, np.sin(number), space.dtype)


def _parts(seen: Any) -> list[Any]:
    return [seen[key] for key in sorted(seen)] if isinstance(seen, dict) else [seen]


class ByWhatIsSeen:
    """`chosen` as a policy."""

    def __init__(self, space: spaces.Space[Any]) -> None:
        self.space = space

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        mask = info.get(MASK)
        if isinstance(observation, dict):
            mask = observation.get(MASK, mask)
        return chosen(self.space, bare(observation), mask)


def bare(observation: Any) -> Any:
    """As slots show it: without the mask."""
    if not isinstance(observation, dict) or MASK not in observation:
        return observation
    rest = {key: part for key, part in observation.items() if key != MASK}
    return rest if len(rest) > 1 else next(iter(rest.values()))


def of_episode(episode: Any, agent: str) -> Stream | None:
    """What an episode says of an agent; None where it never came."""
    stream, last, turns = Stream(), None, list(episode.turns)
    for turn in turns:
        if agent in turn.rewards and agent not in turn.order:
            stream.pay(turn.rewards[agent])
        if agent in turn.actions and turn.actions[agent] is not None:
            stream.seen.append(bare(turn.observations[agent]))
            stream.masks.append(turn.masks.get(agent))
            stream.did.append(turn.actions[agent])
            stream.paid.append(turn.rewards.get(agent, 0.0))
        if agent in turn.observations and turn.observations[agent] is not None:
            stream.final = bare(turn.observations[agent])
        if agent in turn.cumulative_reward:
            stream.end = bool(turn.terminated[agent]), bool(turn.truncated[agent])
            last = turn.index
    if last is None:
        return None
    return stream


Told = list[dict[str, Any]]


def of_slots(told: Told, slot: int) -> list[Stream]:
    """What a slot went through, episode by episode; the last one hasn't ended."""
    streams = [Stream()]
    for step in told:
        stream = streams[-1]
        if step["acted"][slot]:
            stream.seen.append(_row(step["obs"], slot))
            stream.masks.append(step["masks"][slot])
            stream.did.append(step["actions"][slot])
            stream.paid.append(0.0)
        stream.pay(float(step["rewards"][slot]))
        if step["terminated"][slot] or step["truncated"][slot]:
            stream.end = bool(step["terminated"][slot]), bool(step["truncated"][slot])
            stream.final = step["final"][slot]
            streams.append(Stream())
    return streams


def _row(obs: Any, slot: int) -> Any:
    return {k: part[slot] for k, part in obs.items()} if isinstance(obs, dict) else obs[slot]


def played(slots: Any, steps: int, choose: Callable[..., Any] = chosen) -> Told:
    """What every slot was given and paid, each acting by what it sees."""
    told, obs = [], slots.reset()
    for _ in range(steps):
        masks, acting = slots.masks.copy(), slots.acting.copy()
        has_masks = masks.shape[1] > 0
        actions = np.array(
            [
                choose(slots.action_space, _row(obs, slot), _mask(slots, masks[slot], has_masks))
                for slot in range(slots.count)
            ]
        )
        step = slots.step(actions)
        assert np.array_equal(acting, slots.acted)
        told.append(
            {
                "obs": obs,
                "masks": masks if has_masks else [None] * slots.count,
                "actions": actions,
                "acted": acting,
                "rewards": step.rewards,
                "terminated": step.terminated,
                "truncated": step.truncated,
                "final": step.final,
            }
        )
        obs = step.obs
    return told


def _mask(slots: Any, mask: Any, has_masks: bool) -> Any:
    return mask if has_masks else None


def same(one: Stream, two: Stream, *, paid: float = 1e-9) -> None:
    """Asserts that both say the same: `one` of an episode, `two` of a slot."""
    assert len(one.seen) == len(two.seen)
    for first, second in zip(one.seen, two.seen, strict=True):
        _equal(first, second)
    for first, second in zip(one.did, two.did, strict=True):
        np.testing.assert_array_equal(first, second)
    for first, second in zip(one.masks, two.masks, strict=True):
        if first is not None and second is not None:
            parts = first if isinstance(first, tuple) else (first,)
            np.testing.assert_array_equal(np.concatenate([np.asarray(p) for p in parts]), second)
    np.testing.assert_allclose(two.paid, one.paid, atol=paid, rtol=0)
    assert abs(one.before - two.before) <= paid
    assert one.end == two.end
    _equal(one.final, two.final)


def _equal(first: Any, second: Any) -> None:
    if isinstance(first, dict):
        assert set(first) == set(second)
        for key in first:
            _equal(first[key], second[key])
        return
    np.testing.assert_array_equal(first, second)
