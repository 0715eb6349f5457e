"""A task whose every transition is known beforehand, for every form of space, mask, role and end.

What an agent sees is a code of four small numbers (seed, agent, time, its last action) in the form
of the space; what it does follows from the code and the mask; what it is paid follows from both. So
the log of an episode is worked out by hand, `decisions`, without a line of the library.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces

import gamekeeper as gk

Code = tuple[int, int, int, int]
SIZES: Final = (16, 4, 16, 4)  # of the parts of a code
BOX: Final = spaces.Box(0, 16, (4,), np.float32)
PARTS: Final = {"place": spaces.Box(0, 16, (2,), np.float32), "number": spaces.Discrete(64)}
SEEN: Final[dict[str, Any]] = {
    "Box": BOX,
    "image": spaces.Box(0, 255, (36, 36, 3), np.uint8),
    "Discrete": spaces.Discrete(4096),
    "MultiDiscrete": spaces.MultiDiscrete(SIZES),
    "MultiBinary": spaces.MultiBinary(12),
    "Tuple": spaces.Tuple(tuple(PARTS.values())),
    "Dict": spaces.Dict(PARTS),
    "nested Dict": spaces.Dict({"own": spaces.Dict(PARTS), "all": BOX}),
}
DONE: Final[dict[str, Any]] = {
    "Box": spaces.Box(-1, 1, (1,), np.float32),
    "MultiDiscrete": spaces.MultiDiscrete([3, 2]),
    "MultiBinary": spaces.MultiBinary(2),
}
ENDS: Final = {"together": (4, 4, 4), "one by one": (2, 3, 5), "late": (5, 5, 5)}
JOINS: Final = {1: 2}  # in "late": agent 1 after two ticks
TURNS_A_TICK: Final = 3


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the matrix.

    Attributes:
        seen: form of observations; actions have it too where an action can.
        mask: actions are masked: in Dict observations, else in infos.
        roles: with two, the last agent is a cat, which has spaces of its own and doesn't learn.
        ends: a key of `ENDS`.
        api: "parallel" or "aec".
    """

    seen: str
    mask: bool
    roles: int
    ends: str
    api: str

    def __str__(self) -> str:
        mask = "masked" if self.mask else "unmasked"
        return f"{self.seen}, {mask}, {self.roles} role, {self.ends}, {self.api}"

    @property
    def form(self) -> str:
        """Form of actions: only whole numbers are masked."""
        masks = "Discrete", "MultiDiscrete"
        is_form = self.seen in DONE and (not self.mask or self.seen in masks)
        return self.seen if is_form else "Discrete"

    @property
    def spec(self) -> str:
        """Source of the environment."""
        return f"{__file__}:{'LedgerTicks' if self.api == 'parallel' else 'LedgerTurns'}"

    @property
    def kwargs(self) -> dict[str, Any]:
        """Arguments of the environment."""
        return {"seen": self.seen, "mask": self.mask, "roles": self.roles, "ends": self.ends}

    @property
    def learners(self) -> list[str]:
        """Agents that learn."""
        return [f"dog_{i}" for i in range(4 - self.roles)]


CELLS: Final = [
    Cell(*parts)
    for parts in itertools.product(SEEN, (False, True), (1, 2), ENDS, ("parallel", "aec"))
]

COVERING: Final = [cell for at, cell in enumerate(CELLS) if at % 5 == at // 24 % 5]
"""A fifth of them, in which each form of observation meets every mask, role, end and interface."""


def encode(form: str, code: Code) -> Any:
    """The observation of a code."""
    number = int(np.ravel_multi_index(code, SIZES))
    pair = np.array(code[:2], np.float32), np.int64(code[2] * 4 + code[3])
    if form == "image":
        picture = np.full((36, 36, 3), 7, np.uint8)
        picture[0, :4, 0] = code
        return picture
    plain = {
        "Box": np.array(code, np.float32),
        "Discrete": np.int64(number),
        "MultiDiscrete": np.array(code),
        "MultiBinary": np.array([number >> bit & 1 for bit in range(12)], np.int8),
        "Tuple": pair,
        "Dict": dict(zip(PARTS, pair, strict=True)),
    }
    plain["nested Dict"] = {"own": plain["Dict"], "all": plain["Box"]}
    return plain[form]


def decode(form: str, seen: Any) -> Code:
    """The code of an observation; pictures may have their channels first."""
    if form == "Tuple":
        seen, form = dict(zip(PARTS, seen, strict=True)), "Dict"
    if form == "Dict":
        number = int(seen["number"])
        parts = [*seen["place"], number // 4, number % 4]
    elif form == "image":
        parts = seen[0, 0, :4] if seen.shape[0] == 3 else seen[0, :4, 0]
    elif form in ("Discrete", "MultiBinary"):
        bits = np.ravel(seen)
        number = int(
            bits[0] if form == "Discrete" else sum(int(b) << i for i, b in enumerate(bits))
        )
        parts = np.unravel_index(number, SIZES)
    else:
        parts = seen["all"] if form == "nested Dict" else seen
    a, b, c, d = (int(part) for part in parts)
    return a, b, c, d


def same(found: Any, expected: Any) -> None:
    """Asserts that two observations are equal, part by part."""
    if isinstance(expected, dict):
        assert set(found) == set(expected)
        for key, part in expected.items():
            same(found[key], part)
    elif isinstance(expected, tuple):
        for one, two in zip(found, expected, strict=True):
            same(one, two)
    else:
        np.testing.assert_array_equal(found, expected)


def flags_of(form: str, code: Code) -> Any:
    """The mask that goes with a code."""
    own = np.array([1, (code[1] + code[2]) % 2, 1], np.int8)
    return (own, np.array([0, 1], np.int8)) if form == "MultiDiscrete" else own


def flat_flags(form: str, code: Code) -> Any:
    """The same in one row."""
    flags = flags_of(form, code)
    return np.concatenate(flags) if isinstance(flags, tuple) else flags


def act(form: str, code: Code, *, masked: bool) -> Any:
    """The action that a code decides, a legal one."""
    number = sum(code)
    legal = np.flatnonzero(flags_of("Discrete", code)) if masked else np.arange(3)
    first = int(legal[number % len(legal)])
    if form == "MultiDiscrete":
        return np.array([first, 1 if masked else number % 2])
    if form == "MultiBinary":
        return np.array([number % 2, number // 2 % 2], np.int8)
    return np.array([number % 3 - 1], np.float32) if form == "Box" else np.int64(first)


def last_of(form: str, action: Any) -> int:
    """An action as the last part of a code, in 1 to 3."""
    if form == "MultiBinary":
        return 1 + int(np.sum(action))
    return (2 if form == "Box" else 1) + int(np.ravel(action)[0])


def payment(time: int, agent: int, last: int) -> float:
    """Reward of an action, exact in float32."""
    return 1 + time + agent / 4 + last / 8


def ending(seed: int, agent: int) -> tuple[bool, bool]:
    """Terminated and truncated; now and then both."""
    kind = (seed + agent) % 5
    return kind in (0, 2, 4), kind in (1, 3, 4)


class _Ledger:
    """Rules of both forms."""

    agents: list[str]

    def __init__(
        self, seen: str = "Box", mask: bool = False, roles: int = 1, ends: str = "together"
    ) -> None:
        super().__init__()
        api = "parallel" if isinstance(self, gk.TickEnv) else "aec"
        self.cell = cell = Cell(seen, mask, roles, ends, api)
        self.possible_agents = ["dog_0", "dog_1", "dog_2" if roles == 1 else "cat_0"]
        shown = SEEN[seen]
        if mask and isinstance(shown, spaces.Dict):
            shown = spaces.Dict({**shown.spaces, "action_mask": spaces.MultiBinary(3)})
        done = DONE.get(cell.form, spaces.Discrete(3))
        self.observation_spaces = dict.fromkeys(cell.learners, shown)
        self.action_spaces: dict[str, Any] = dict.fromkeys(cell.learners, done)
        if roles == 2:
            self.observation_spaces["cat_0"] = spaces.Box(0, 99, (2,), np.float32)
            self.action_spaces["cat_0"] = spaces.Discrete(5)

    def starting_agents(self) -> list[str]:
        """All but the late one."""
        late = JOINS if self.cell.ends == "late" else {}
        return [agent for i, agent in enumerate(self.possible_agents) if i not in late]

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Begins at time 0, with a seed that is seen; a reset without one goes on to the next."""
        self.first = (rng.seed + rng.episode) % SIZES[0]
        self.time, self.did = 0, [0, 0, 0]

    def _code(self, agent: str) -> Code:
        place = self.possible_agents.index(agent)
        return self.first, place, self.time, self.did[place]

    def observe(self, agent: str) -> Any:
        """The code."""
        if agent == "cat_0":
            return np.array([self.time, 99], np.float32)
        seen = encode(self.cell.seen, self._code(agent))
        if self.cell.mask and isinstance(seen, dict):
            seen = {**seen, "action_mask": flags_of("Discrete", self._code(agent))}
        return seen

    def mask(self, agent: str) -> Any:
        """Two actions of three, or all."""
        if not self.cell.mask or agent == "cat_0":
            return None
        return flags_of(self.cell.form, self._code(agent))

    def _move(self, env: Any, actions: dict[str, Any], ticks: float) -> None:
        """Pays for actions, and the time to those who watched; ends agents and brings them in."""
        self.time += 1
        for place, agent in enumerate(self.possible_agents):
            if agent in actions:
                form = self.cell.form if agent != "cat_0" else "Discrete"
                self.did[place] = last_of(form, actions[agent])
                env.add_reward(agent, payment(self.time, place, self.did[place]))
            elif agent in self.agents:
                env.add_reward(agent, self.time / 16)
            if agent in self.agents and ticks >= ENDS[self.cell.ends][place]:
                flags = ending(self.first, place)
                if flags[0]:
                    env.terminate(agent, "done")
                if flags[1]:
                    env.truncate(agent, "night")
            elif (
                agent not in self.agents and self.cell.ends == "late" and ticks == JOINS.get(place)
            ):
                env.join(agent)
                env.add_reward(agent, 0.5)


class LedgerTicks(_Ledger, gk.TickEnv):
    """All at once."""

    metadata = {"name": "ledger_ticks_v0"}  # noqa: RUF012  # as PettingZoo has it

    def tick(self, actions: dict[str, Any]) -> None:
        """One tick."""
        self._move(self, actions, self.time + 1)


class LedgerTurns(_Ledger, gk.TurnEnv):
    """One after the other."""

    metadata = {"name": "ledger_turns_v0"}  # noqa: RUF012  # as PettingZoo has it

    def act(self, agent: str, action: Any) -> None:
        """One turn."""
        self._move(self, {agent: action}, (self.time + 1) / TURNS_A_TICK)


@dataclass(slots=True)
class Decision:
    """A transition of the hand-made log.

    Attributes:
        seen, following: codes; the last `following` is the final observation.
        reward: all that came until the agent decided again or ended.
        before: what it was paid before this decision and after no other one.
        end: terminated and truncated.
    """

    agent: int
    seen: Code
    action: Any
    reward: float = 0.0
    before: float = 0.0
    end: tuple[bool, bool] = (False, False)
    following: Code | None = None


def decisions(cell: Cell, seed: int) -> Iterator[Decision]:
    """The log of one episode, each agent's own decisions in order, worked out from the rules."""
    is_late, is_aec = cell.ends == "late", cell.api == "aec"
    roster = [i for i in range(3) if not (is_late and i in JOINS)]
    last, logs, before, turn = [0, 0, 0], {i: [] for i in range(3)}, [0.0] * 3, 0
    first, due = seed % SIZES[0], 0
    joined: set[int] = set(roster)
    while roster:
        acting = [roster[due % len(roster)]] if is_aec else list(roster)
        for i in acting:
            code = first, i, turn, last[i]
            is_cat = cell.roles == 2 and i == 2
            action = np.int64(0) if is_cat else act(cell.form, code, masked=cell.mask)
            if logs[i]:
                logs[i][-1].following = code
            logs[i].append(Decision(i, code, action, before=0.0 if logs[i] else before[i]))
            last[i] = last_of("Discrete" if is_cat else cell.form, action)
        turn += 1
        ticks = turn / TURNS_A_TICK if is_aec else turn
        paid = {i: payment(turn, i, last[i]) if i in acting else turn / 16 for i in roster}
        ended = [i for i in roster if ticks >= ENDS[cell.ends][i]]
        comes = [i for i in JOINS if is_late and ticks == JOINS[i] and i not in joined]
        for i, amount in {**paid, **dict.fromkeys(comes, 0.5)}.items():
            if logs[i]:
                logs[i][-1].reward += amount
            else:
                before[i] += amount
        for i in ended:
            if logs[i]:
                logs[i][-1].end, logs[i][-1].following = ending(first, i), (first, i, turn, last[i])
        joined |= set(comes)
        after = _after(roster, acting[-1], ended, comes)
        roster = [i for i in roster if i not in ended] + comes
        due = roster.index(after) if is_aec and roster else 0
    for log in logs.values():
        yield from log


def _after(roster: Sequence[int], actor: int, ended: Sequence[int], comes: Sequence[int]) -> Any:
    """The agent of the next turn: the next in the round that hasn't ended."""
    place = roster.index(actor)
    rest = [*roster[place + 1 :], *comes, *roster[: place + 1]]
    return next((i for i in rest if i not in ended), None)
