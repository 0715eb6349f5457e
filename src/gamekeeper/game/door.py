"""The door: the only way to a live environment, and the only place where anything is captured.

A `Game` is the same for both of PettingZoo's APIs: reset, step, close. What the environment gives
and what is done to it goes onto a tape, if a sink was handed in. The door makes only the calls that
its caller makes, but for `state()` (and `render()` where frames are asked for), each looked at once
for drawing from a random generator before it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any, Final, Protocol

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from gamekeeper.core.canon import to_json, type_name
from gamekeeper.core.layout import LARGE_BYTES, Layout, Side
from gamekeeper.core.space import Codec
from gamekeeper.core.tape import EpisodeEnd, EpisodeStart, Tape
from gamekeeper.game.infos import InfoTexts
from gamekeeper.game.ring import Rings
from gamekeeper.game.stillness import is_still

AgentId = Hashable
Pack = Callable[[Any], Any]
REALS: Final = frozenset(
    {float, int, *(np.dtype(code).type for code in "bhilqBHILQefd")}
)  # what PettingZoo environments pay in; a bool or a text is no reward
BOOLS: Final = frozenset({bool, np.bool_})
EXACT: Final = 1 << 53  # beyond it a whole number has no exact float64
GIVEN_NOTHING: Final = (None, None, None, None, None, None)  # observation, mask, ..., info
CHECK_TURNS: Final = 256  # how often the sink is asked whether it keeps up


class Missing:
    """Stands for a key that a dictionary should have had."""


MISSING: Final = Missing()


class Sink(Protocol):
    """Takes what a game puts on the tape."""

    tape: Tape
    layout: Layout
    rings: Rings | None

    def keep_up(self) -> None:
        """Called every few turns and at an episode's end; may wait until the tape is shorter."""

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes one rendered frame."""


class Game:
    """One live environment behind the door. Use `ParallelGame` or `AECGame`."""

    api: str

    def __init__(
        self, env: Any, *, sink: Sink | None = None, frames: bool = False, state: bool = True
    ) -> None:
        """Takes hold of `env`; nothing is called on it yet but for its spaces."""
        self.env = env
        self.sink = sink
        self.policies: str | None = None
        self.episode = -1
        self.turn = 0
        self._since = -1
        self._frames = frames
        self._open = False
        self._failure: str | None = None
        self._wants_state = state and sink is not None
        self._state: Callable[[], Any] | None = None
        self._state_entry: tuple[Any, str | None] = (None, None)
        self._pack_state: Pack | None = None
        self._known: dict[int, Codec] = {}
        self._info_text = InfoTexts().text
        self._desk: dict[AgentId, tuple[int, Pack, Pack]] = {}
        self._paid_terms: Callable[[AgentId], Any] | None = None
        if sink is not None:
            self._tape = sink.tape
            self._paid_terms = _terms_reader(env, sink.layout.terms)
            sink.layout.announce(list(getattr(env, "possible_agents", ())), self._codecs)

    # -- seats and spaces

    def _sit(self, agent: AgentId) -> tuple[int, Pack, Pack]:
        """The desk of an agent: its seat's number, how observations and actions are packed."""
        assert self.sink is not None
        layout = self.sink.layout
        seat = layout.seats.get(agent)
        if seat is None:
            seat = layout.seat(agent, *self._codecs(agent))
        packers = (_packer(seat.observation, self.sink.rings), _action_packer(seat))
        desk = self._desk[agent] = (seat.index, *packers)
        return desk

    def _codecs(self, agent: AgentId) -> tuple[Codec | None, Codec | None]:
        return self._codec(self.env.observation_space, agent), self._codec(
            self.env.action_space, agent
        )

    def _codec(self, space_of: Callable[[AgentId], Any], agent: AgentId) -> Codec | None:
        try:
            space = space_of(agent)
        except Exception:  # an agent that nobody declared has no space: its values are kept as odd
            return None
        if not isinstance(space, Space):
            return None
        known = self._known.get(id(space))
        if known is None:  # the codec keeps its space alive, so the id stays its own
            known = self._known[id(space)] = Codec(space)
        return known

    # -- episodes

    def _begin(self, seed: int | None, options: Mapping[str, Any] | None) -> None:
        self.episode += 1
        self.turn = 0
        if seed is not None:
            self._since = self.episode
        self._open, self._failure = True, None
        text = None if options is None else to_json(options)
        start = EpisodeStart(self.episode, seed, self._since, text, self.policies)
        self._tape.starts.append(start)

    def _finish(self, end: str) -> None:
        """Closes the books of the episode in progress."""
        assert self.sink is not None
        self._open = False
        error, self._failure = self._failure, None
        types = {
            seat.name: type_name_of(seat.action_type)
            for seat in self.sink.layout.order
            if seat.action_type
        }
        end = "failed" if error is not None else end
        self._tape.ends.append(
            EpisodeEnd(self.episode, end, self.turn, error, self._endings(), to_json(types))
        )
        self.sink.keep_up()

    def _endings(self) -> str | None:
        """Reasons by agent, where the environment's rules name them."""
        reasons = getattr(self.env.unwrapped, "endings", None)
        return to_json(reasons) if isinstance(reasons, dict) and reasons else None

    def fail(self, error: str) -> None:
        """Notes why the episode in progress can't go on; it ends as *failed*."""
        self._failure = error

    # -- the turn

    def _info(self, info: Any, fields: list[str]) -> tuple[str | None, bytes | None]:
        """An info as JSON and the mask in it as bytes; what is no dictionary goes to `fields`."""
        if not isinstance(info, dict):
            fields.append(odd("info", info))
            return None, None
        return self._info_text(info) if info else (None, None)

    def _commit(self, rows: int, wall_ns: int | None) -> None:
        self._tape.turns.extend((self.episode, self.turn, rows, wall_ns, *self._state_entry))

    def _crossed(self) -> None:
        """After a crossing: the next turn begins with a look at state and frame."""
        self.turn += 1
        if self._state is not None:
            self._state_entry = self._look_at_state()
        if self._frames:
            self._take_frame()
        if not self.turn % CHECK_TURNS:
            self.sink.keep_up()  # type: ignore[union-attr]  # only called with a sink

    def _first_look(self) -> None:
        """After a reset: state() and render() are probed once, then used."""
        if self._wants_state:
            self._wants_state = False
            self._state = self._still_state()
        self._state_entry = self._look_at_state() if self._state is not None else (None, None)
        if self._frames and not is_still(self.env, self.env.render):
            self._frames = False
        if self._frames:
            self._take_frame()

    def _still_state(self) -> Callable[[], Any] | None:
        state = getattr(self.env, "state", None)
        return state if callable(state) and is_still(self.env, state) else None

    def _look_at_state(self) -> tuple[Any, str | None]:
        assert self._state is not None
        assert self.sink is not None
        try:
            state = self._state()
        except Exception as error:  # foreign code: kept as evidence, not as our failure
            return None, "{" + f'"state":{{"raised":{to_json(type_name(error))}}}' + "}"
        if self._pack_state is None:
            self.sink.layout.take_state(self._state_codec(state))
            self._pack_state = _packer(self.sink.layout.state, None)
        packed = self._pack_state(state)
        return (packed, None) if packed is not None else (None, "{" + odd("state", state) + "}")

    def _state_codec(self, state: Any) -> Codec | None:
        declared = getattr(self.env, "state_space", None)
        if isinstance(declared, Space) and Codec(declared).pack(state) is not None:
            return Codec(declared)
        if isinstance(state, np.ndarray) and state.dtype.kind in "biuf":
            return Codec(_box_of(state))
        return None

    def _take_frame(self) -> None:
        frame = self.env.render()
        if frame is not None:
            self.sink.frame(self.episode, self.turn, frame)  # type: ignore[union-attr]

    def close(self) -> None:
        """Closes the environment; an episode in progress is kept as *cut*."""
        self.end_episode()
        self.env.close()

    def end_episode(self) -> None:
        """Closes the books of an episode in progress, if there is one."""
        raise NotImplementedError


def odd(field: str, value: object) -> str:
    """One entry of a row's `odd` object: the value as it was, with its type."""
    if value is MISSING:
        return f'"{field}":{{"type":"missing"}}'
    return f'"{field}":{{"type":{to_json(type_name(value))},"value":{to_json(value)}}}'


def reward_of(reward: Any) -> float | None:
    """`reward` if it is a real number that a float64 holds exactly, else None."""
    if reward.__class__ not in REALS:
        return None
    if isinstance(reward, int | np.integer) and not -EXACT <= reward <= EXACT:
        return None
    return reward  # type: ignore[no-any-return]  # one of REALS


def type_name_of(kind: type) -> str:
    """`int`, `numpy.int64`: the name of a type as evidence spells it."""
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


def _terms_reader(env: Any, names: tuple[str, ...]) -> Callable[[AgentId], Any] | None:
    """Reads what the last crossing paid an agent by term, where the environment keeps `terms`."""
    if not names or not isinstance(getattr(env, "terms", None), dict):
        return None

    def read(agent: AgentId) -> tuple[float, ...]:
        paid = env.terms.get(agent, {})
        return tuple(paid.get(name, 0.0) for name in names)

    return read


def _box_of(state: NDArray[Any]) -> Box:
    """A Box without bounds for arrays like `state`."""
    kind, dtype = state.dtype.kind, state.dtype.type
    if kind == "f":
        return Box(-np.inf, np.inf, state.shape, dtype)
    limits = (False, True) if kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    return Box(*limits, state.shape, dtype)


def _packer(side: Side | None, rings: Rings | None) -> Pack:
    if side is None:
        return _nothing
    codec = side.codec
    pack = codec.pack_one or codec.pack
    leaf = codec.leaves[0] if len(codec.leaves) == 1 else None
    if rings is None or leaf is None or leaf.kind != "bytes":
        return pack
    dtype, shape, put = np.dtype(leaf.dtype), leaf.shape, rings.put
    if int(np.prod(shape, dtype=np.int64)) * dtype.itemsize < LARGE_BYTES or leaf.path:
        return pack

    def pack_large(value: Any) -> int | None:
        if value.__class__ is np.ndarray and value.dtype == dtype and value.shape == shape:
            return put(value)
        return None

    return pack_large


def _action_packer(seat: Any) -> Pack:
    """As the action space's codec packs; a whole number must also be of the type it had first.

    Environments treat int and numpy.int64 differently (`action is 1`, overflow, JSON), so a replay
    hands over what was handed over; the type is kept once for each agent.
    """
    side = seat.action
    if side is None:
        return _nothing
    codec = side.codec
    pack: Pack = codec.pack_one or codec.pack
    if len(codec.leaves) != 1 or codec.leaves[0].kind != "int" or codec.leaves[0].path:
        return pack

    def pack_whole(action: Any) -> int | None:
        kind = action.__class__
        if kind is not seat.action_type:
            if seat.action_type is not None or pack(action) is None:
                return None
            seat.action_type = kind
        return int(action)

    return pack_whole


def _nothing(value: object) -> None:
    return None
