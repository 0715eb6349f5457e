"""Observations and rewards in units of their own spread, with statistics that are saved.

A policy that learnt from normalized observations is worth nothing without their statistics.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import Space

from gamekeeper.episodes.layout import agent_name, role
from gamekeeper.errors import PolicyError
from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.wrappers.transform import Transform, unfit
from gamekeeper.interface.wrappers.wrapped_env import wrapped

PRIOR: Final = 1e-4
"""Count of the mean 0 and the variance 1 with which statistics begin, as in Gymnasium."""


@dataclass(frozen=True, slots=True)
class Normalization:
    """Statistics as they stood at one moment.

    Attributes:
        parts: by key of a Dict, or "" for the whole observation: mean, variance, count.
        paid: variance and count of the discounted return.
        clip, epsilon: observations lie within +-clip; epsilon is added to a variance.
    """

    parts: Mapping[str, tuple[Any, Any, float]]
    paid: tuple[float, float]
    clip: float
    epsilon: float

    def __call__(self, observation: Any) -> Any:
        """The observation as the policy is shown it."""
        if "" in self.parts:
            return self._scaled(observation, "")
        if not isinstance(observation, Mapping):
            return observation
        return {
            key: self._scaled(part, key) if key in self.parts else part
            for key, part in observation.items()
        }

    def _scaled(self, part: Any, key: str) -> Any:
        mean, variance, _ = self.parts[key]
        scaled = (part - mean) / np.sqrt(variance + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)

    def to_json(self) -> str:
        """As text; floats are read back to the bit."""
        parts = {k: [m.tolist(), v.tolist(), n] for k, (m, v, n) in self.parts.items()}
        data = {"parts": parts, "paid": self.paid, "clip": self.clip, "epsilon": self.epsilon}
        return json.dumps(data, sort_keys=True)

    @classmethod
    def of_json(cls, text: str) -> Normalization:
        """Reads what `to_json` wrote."""
        data = json.loads(text)
        parts = {
            key: (np.array(mean), np.array(variance), float(count))
            for key, (mean, variance, count) in data["parts"].items()
        }
        return cls(parts, tuple(data["paid"]), data["clip"], data["epsilon"])


class Moments:
    """Mean and variance of what was added so far.

    Source: Chan, Golub & LeVeque 1983 (pairwise update).
    """

    __slots__ = ("count", "mean", "var")

    def __init__(self, shape: tuple[int, ...] = ()) -> None:
        self.mean: Any = np.zeros(shape)
        self.var: Any = np.ones(shape)
        self.count = PRIOR

    def add(self, row: Any) -> None:
        """Adds one observation of everything."""
        count = self.count + 1
        off = row - self.mean
        self.mean = self.mean + off / count
        self.var = (self.var * self.count + off * off * (self.count / count)) / count
        self.count = count

    def add_rows(self, rows: Any) -> None:
        """Adds observations [row, ...] at once; the same as one by one but for rounding."""
        if len(rows):
            count, more = self.count + len(rows), len(rows)
            off = rows.mean(0, dtype=np.float64) - self.mean
            spread = rows.var(0, dtype=np.float64) * more
            self.mean = self.mean + off * (more / count)
            moved = off * off * (self.count * more / count)
            self.var = (self.var * self.count + spread + moved) / count
            self.count = count


class Statistics:
    """Running statistics of observations and returns: agents of a role share theirs.

    A role is an agent's name without its number: `picker_0` is a `picker`.
    """

    def __init__(self, *, clip: float = 10.0, epsilon: float = 1e-8) -> None:
        self.clip, self.epsilon = clip, epsilon
        self.seen: dict[str, dict[str, Moments]] = {}
        self.paid: dict[str, Moments] = {}
        self._current: dict[str, Normalization] = {}

    def of(self, agent: AgentId) -> Normalization:
        """The statistics of an agent's role as they stand.

        Raises:
            PolicyError: nothing was seen of this role.
        """
        return self.of_role(role(agent_name(agent)))

    def of_role(self, name: str) -> Normalization:
        """The statistics of a role as they stand; raises as `of` does."""
        current = self._current.get(name)
        if current is not None:
            return current
        if name not in self.seen:
            raise PolicyError(
                f"there are no statistics of the role {name!r}",
                where="Statistics",
                expected=f"those of {name!r}",
                actual=", ".join(self.seen) or "none at all",
                fix="learn them first: normalize(env, statistics, learning=True)",
            )
        parts = {key: (m.mean, m.var, m.count) for key, m in self.seen[name].items()}
        paid = float(self.paid[name].var), float(self.paid[name].count)
        self._current[name] = current = Normalization(parts, paid, self.clip, self.epsilon)
        return current

    def open(self, agent: AgentId, parts: Mapping[str, tuple[int, ...]]) -> None:
        """Begins an agent's role, of these shapes, where it has no statistics yet."""
        name = role(agent_name(agent))
        if name not in self.seen:
            self.seen[name] = {key: Moments(shape) for key, shape in parts.items()}
            self.paid[name] = Moments()
        known = {key: np.shape(moments.mean) for key, moments in self.seen[name].items()}
        if known != dict(parts):
            raise PolicyError(
                f"the statistics of the role {name!r} are of other observations",
                where=f"Statistics, {agent!r}",
                expected=str(dict(parts)),
                actual=str(known),
                fix="normalize the same observations that they were learnt from",
            )

    def add_seen(self, agent: AgentId, observation: Any) -> None:
        """Adds what an agent decided by."""
        name = role(agent_name(agent))
        for key, moments in self.seen[name].items():
            moments.add(observation[key] if key else observation)
        self._current.pop(name, None)

    def add_return(self, agent: AgentId, value: float) -> None:
        """Adds a discounted return."""
        name = role(agent_name(agent))
        self.paid[name].add(value)
        self._current.pop(name, None)

    def add_rows(self, agent: AgentId, parts: Mapping[str, Any]) -> None:
        """Adds what agents of one role decided by, [row, ...] by key of a Dict, or ""."""
        name = role(agent_name(agent))
        for key, moments in self.seen[name].items():
            moments.add_rows(parts[key])
        self._current.pop(name, None)

    def add_returns(self, agent: AgentId, values: Any) -> None:
        """Adds discounted returns [row] of agents of one role."""
        name = role(agent_name(agent))
        self.paid[name].add_rows(values)
        self._current.pop(name, None)

    def to_json(self) -> str:
        """As text; floats are read back to the bit."""
        found = {name: json.loads(self.of_role(name).to_json()) for name in sorted(self.seen)}
        return json.dumps(found, sort_keys=True)

    @classmethod
    def of_json(cls, text: str) -> Statistics:
        """Reads what `to_json` wrote."""
        found = cls()
        for name, data in json.loads(text).items():
            one = Normalization.of_json(json.dumps(data))
            found.clip, found.epsilon = one.clip, one.epsilon
            found.seen[name] = {}
            for key, (mean, var, count) in one.parts.items():
                moments = found.seen[name][key] = Moments()
                moments.mean, moments.var, moments.count = mean, var, count
            paid = found.paid[name] = Moments()
            paid.var, paid.count = np.float64(one.paid[0]), one.paid[1]
        return found

    def save(self, path: str | Path) -> Path:
        """Writes them into a file, beside the policy; returns the file."""
        path = Path(path)
        path.write_text(self.to_json() + "\n", encoding="utf-8")
        return path

    @classmethod
    def load(cls, path: str | Path) -> Statistics:
        """Reads what `save` wrote."""
        return cls.of_json(Path(path).read_text(encoding="utf-8"))

    def policy(self, policy: Any) -> PolicyWithStatistics:
        """The policy for the environment as it is: what it is shown is normalized first."""
        return PolicyWithStatistics(policy, self)


class PolicyWithStatistics:
    """A policy and the statistics without which it is worth nothing, in one object."""

    def __init__(self, policy: Any, statistics: Statistics) -> None:
        self._policy = policy
        text = statistics.to_json()
        self._statistics = Statistics.of_json(text)
        own = getattr(policy, "version", None)
        digest = blake2b(text.encode(), digest_size=8).hexdigest()
        self.version = f"{own or type(policy).__qualname__}+{digest}"

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The policy's action, by the normalized observation."""
        shown = self._statistics.of(agent)(observation)
        return self._policy(shown, agent, info, rng)

    def reset(self, seed: int) -> None:
        """Resets the policy, where it can be."""
        reset = getattr(self._policy, "reset", None)
        if reset is not None:
            reset(seed)


def normalize(
    env: Any,
    statistics: Statistics,
    *,
    learning: bool = False,
    rewards: bool = True,
    gamma: float = 0.99,
) -> Any:
    """Shows observations, and pays rewards, in units of their spread.

    Float parts of observations become (x - mean) / deviation, within +-clip; rewards are divided by
    the deviation of discounted returns, without their mean. Statistics are taken over decisions:
    what others do between an agent's turns isn't counted. While they are learnt, the same seed
    doesn't give the same observations twice; once they are frozen, it does.

    Args:
        env: AECEnv or ParallelEnv.
        statistics: of all copies of the environment; `save` them beside the policy.
        learning: also adds what agents see and are paid.
        rewards: False: rewards stay.
        gamma: discount of the returns.
    Raises:
        SpecError: an observation has no part of floats.
        PolicyError: the statistics are of other observations.
    """
    kind = NormalizedRewards if rewards else NormalizedViews
    return wrapped(env, kind(statistics, learning=learning, gamma=gamma))


class NormalizedViews(Transform):
    """Use `normalize(env, statistics, rewards=False)`."""

    def __init__(self, statistics: Statistics, *, learning: bool, gamma: float) -> None:
        self._statistics, self._learning, self._gamma = statistics, learning, gamma
        self.begin(None)

    def begin(self, seed: int | None) -> None:
        """Begins new returns."""
        self._returns: dict[AgentId, float] = {}
        self._acted: set[AgentId] = set()

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space with its float parts within +-clip."""
        is_dict = isinstance(space, spaces.Dict)
        parts = dict(space.spaces) if isinstance(space, spaces.Dict) else {"": space}
        floats = {key: part for key, part in parts.items() if _is_float_box(part)}
        if not floats:
            raise unfit(
                "normalize",
                agent,
                expected="a Box of floats, or a Dict with one",
                actual=space,
                fix="networks scale pictures themselves; numbers of other spaces have no spread",
            )
        self._statistics.open(agent, {key: part.shape or () for key, part in floats.items()})
        clip = self._statistics.clip
        shown = {key: spaces.Box(-clip, clip, part.shape) for key, part in floats.items()}
        return spaces.Dict({**parts, **shown}) if is_dict else shown[""]

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The observation in units of its spread."""
        return self._statistics.of(agent)(seen)

    def keep(self, agent: AgentId, noted: Any) -> None:
        """Adds a decision to the statistics, while these are learnt."""
        if self._learning:
            self._statistics.add_seen(agent, noted)
            self._returns[agent] = self._returns.get(agent, 0.0) * self._gamma
            self._acted.add(agent)

    def note(self, agent: AgentId, seen: Any, action: Any) -> Any:
        """Copy of what the agent decided by."""
        if not self._learning:
            return None
        if isinstance(seen, dict):
            return {key: np.array(part) for key, part in seen.items()}
        return np.array(seen)


class NormalizedRewards(NormalizedViews):
    """Use `normalize`."""

    def reward(self, agent: AgentId, reward: Any) -> Any:
        """The reward in units of the spread of returns."""
        statistics = self._statistics
        if self._learning:
            self._returns[agent] = self._returns.get(agent, 0.0) + float(reward)
            if agent in self._acted:  # once for each decision, however often it is paid until then
                self._acted.discard(agent)
                statistics.add_return(agent, self._returns[agent])
        variance = statistics.of(agent).paid[0]
        scaled = float(reward) / float(np.sqrt(variance + statistics.epsilon))
        return min(max(scaled, -statistics.clip), statistics.clip)


def _is_float_box(space: Any) -> bool:
    return isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating)
