"""Episodes of a data set as rows of evidence, turn by turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.core.canon import to_json
from gamekeeper.game.capture.infos import InfoTexts

Space = spaces.Space[Any]
Pairs = Mapping[str, tuple[Space, Space]]


@dataclass(frozen=True, slots=True)
class Row:
    """One agent's row; None where the data set says nothing."""

    agent: str
    observation: Any
    mask: bytes | None
    received: float | None
    terminated: bool | None
    truncated: bool | None
    info: str | None
    live: bool
    order: int | None = None
    action: Any = None
    reward: float | None = None
    terms: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Script:
    """How a data set is read.

    Attributes:
        spaces: of each agent, observation and action.
        terms: reward terms.
        reader: gives the rows of each turn of an episode; the last turn's rows did nothing.
        is_joint: whether its Dict spaces are agents.
    """

    spaces: Pairs
    terms: list[str]
    reader: Callable[[Script, Any], Iterator[list[Row]]]
    is_joint: bool = False

    @property
    def only(self) -> str:
        """The one agent."""
        return next(iter(self.spaces))

    @property
    def lacks(self) -> list[str]:
        """What the evidence lacks beside what every import does."""
        if self.reader is agents_apart:
            return ["the order of actions", "each agent's own reward and end", "policies"]
        if self.reader is our_agent:
            return ["the other agents", "the turns between this one's decisions"]
        return [] if self.reader is ours_together else ["policies"]

    def rows(self, episode: Any) -> Iterator[list[Row]]:
        """The rows of each turn."""
        return self.reader(self, episode)


def one_agent(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Somebody else's data set: one agent, a step a turn."""
    agent, (seen, did) = next(iter(script.spaces.items()))
    text = InfoTexts().text
    count = len(episode.rewards)
    for turn in range(count + 1):
        info = at(episode.infos or {}, turn)
        told, mask = text(info) if info else (None, None)
        yield [_row(agent, episode, turn, (seen, did), told, mask)]


def our_agent(script: Script, episode: Any) -> Iterator[list[Row]]:
    """An agent that we exported: its masks, terms and infos stand as they did."""
    agent, pair = next(iter(script.spaces.items()))
    infos = episode.infos or {}
    count = len(episode.rewards)
    for turn in range(count + 1):
        told = _text(infos["info"][turn])
        mask = infos["action_mask"][turn].tobytes() if "action_mask" in infos else None
        mask = mask if told is not None and '"action_mask":"' in told else None
        terms = None
        if turn < count and script.terms:
            terms = tuple(float(infos["terms"][term][turn + 1]) for term in script.terms)
        yield [_row(agent, episode, turn, pair, told, mask, terms)]


def ours_together(script: Script, episode: Any) -> Iterator[list[Row]]:
    """All agents that we exported as one: each has its own rows again, in their order."""
    infos, count = episode.infos, len(episode.rewards)
    for turn in range(count + 1):
        rows = []
        for agent in script.spaces:
            field = {
                name: by_agent[agent][turn]
                for name, by_agent in infos.items()
                if agent in by_agent and name != "terms"
            }
            if field["given"] or field["was_paid"]:
                rows.append(_row_of(script, episode, agent, turn, field, is_last=turn == count))
        yield rows


def _row_of(
    script: Script, episode: Any, agent: str, turn: int, field: Mapping[str, Any], *, is_last: bool
) -> Row:
    """One agent's row of a turn, as the fields of a joint data set of ours have it."""
    seen, did = script.spaces[agent]
    order, given = int(field["order"]), bool(field["given"])
    acts = order >= 0 and not is_last
    told = _text(field["info"])
    has_mask = told is not None and '"action_mask":"' in told
    return Row(
        agent=agent,
        observation=value_at(seen, episode.observations[agent], turn) if field["saw"] else None,
        mask=field["action_mask"].tobytes() if has_mask else None,
        received=float(field["received"]) if given else None,
        terminated=bool(field["terminated"]) if given else None,
        truncated=bool(field["truncated"]) if given else None,
        info=told, live=bool(field["live"]), order=order if acts else None,
        action=value_at(did, episode.actions[agent], turn) if acts else None,
        reward=float(field["paid"]) if field["was_paid"] else None,
        terms=None if is_last else _terms(script, episode.infos, agent, turn),
    )  # fmt: skip


def agents_apart(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Dict spaces by agent of somebody else: what each saw and did, and one reward for all."""
    infos, count = episode.infos or {}, len(episode.rewards)
    for turn in range(count + 1):
        last = turn == count
        reward = {} if last else {"joint_reward": float(episode.rewards[turn])}
        info = {**at(infos, turn), **reward}
        is_over = last and bool(count)
        yield [
            Row(
                agent=agent,
                observation=value_at(pair[0], episode.observations[agent], turn),
                mask=None, received=None,
                terminated=is_over and bool(episode.terminations[turn - 1]),
                truncated=is_over and bool(episode.truncations[turn - 1]),
                info=to_json(info) if info else None, live=not last,
                action=None if last else value_at(pair[1], episode.actions[agent], turn),
            )
            for agent, pair in script.spaces.items()
        ]  # fmt: skip


def _row(
    agent: str, episode: Any, turn: int, pair: tuple[Space, Space], info: str | None,
    mask: bytes | None, terms: tuple[float, ...] | None = None,
) -> Row:  # fmt: skip
    last = turn == len(episode.rewards)
    before = turn - 1
    ended = [bool(turn and each[before]) for each in (episode.terminations, episode.truncations)]
    return Row(
        agent=agent, observation=value_at(pair[0], episode.observations, turn), mask=mask,
        received=float(episode.rewards[before]) if turn else 0.0,
        terminated=ended[0], truncated=ended[1], info=info, live=not (last and any(ended)),
        order=None if last else 0,
        action=None if last else value_at(pair[1], episode.actions, turn),
        reward=None if last else float(episode.rewards[turn]), terms=terms,
    )  # fmt: skip


def value_at(space: Space, column: Any, row: int) -> Any:
    """One value out of whole columns, as its space has it."""
    if isinstance(space, spaces.Dict):
        return {key: value_at(part, column[key], row) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple([value_at(p, c, row) for p, c in zip(space.spaces, column, strict=True)])
    value = column[row]
    if isinstance(space, spaces.Text):
        return value.decode() if isinstance(value, bytes) else str(value)
    if isinstance(space, spaces.Discrete) and isinstance(value, np.integer):
        return space.dtype.type(value)  # HDF5 may hold it in fewer bytes
    return np.array(value)  # of whatever dtype it is: what isn't the space's is kept as odd


def at(infos: Mapping[str, Any], row: int) -> dict[str, Any]:
    """The info of one step; a field that doesn't reach so far isn't in it."""
    found: dict[str, Any] = {}
    for name, column in infos.items():
        if isinstance(column, Mapping):
            found[name] = at(column, row)
        elif np.ndim(column) == 0:
            found[name] = column
        elif row < len(column):
            value = column[row]
            found[name] = value.decode(errors="replace") if isinstance(value, bytes) else value
    return found


def _terms(script: Script, infos: Mapping[str, Any], agent: str, turn: int) -> Any:
    if not script.terms:
        return None
    return tuple(float(infos["terms"][agent][term][turn]) for term in script.terms)


def _text(value: Any) -> str | None:
    text = value.decode() if isinstance(value, bytes) else str(value)
    return text or None
