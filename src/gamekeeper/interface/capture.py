"""The only way to a live environment, and the only place where anything is captured.

A `Capture` is the same for both of PettingZoo's APIs: reset, step, close. What the environment
gives and what is done to it goes onto a buffer, if a sink was handed in. A capture makes only the
calls that its caller makes, but for `state()` (and `render()` where frames are asked for), each
looked at once for drawing from a random generator before it is used.

Ctrl-C may come between any two lines of ours. So only whole turns go onto the buffer, and what was
still to be booked after a step stands in `_half` until it is: whoever comes next books it.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from time import perf_counter_ns
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from gamekeeper.episodes.buffer import EpisodeEnd, EpisodeStart, LargePlace, cut_back
from gamekeeper.episodes.canonical import to_json, type_name
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.episodes.layout import AgentColumns
from gamekeeper.episodes.spaces import Codec
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.author_calls import AgentId, reset_arguments
from gamekeeper.interface.generators import is_still
from gamekeeper.interface.openings import Openings, SameOpenings
from gamekeeper.interface.packing import (
    InfoTexts,
    Pack,
    Sink,
    action_packer,
    nonconforming,
    nonconforming_type,
    observation_packer,
    other_whole,
    type_name_of,
)

__all__ = ["AgentId", "Capture", "Pack", "Sink", "type_name_of"]

NO_STATE: Final = (None, None)
CHECK_TURNS: Final = 256  # how often the sink is asked whether it keeps up
SEEDS: Final = range(-(1 << 63), 1 << 63)  # what stands in the column of seeds


class Capture:
    """One live environment whose calls are recorded. Use `ParallelCapture` or `AECCapture`."""

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
        self.failed_at: int | None = None
        self.openings: Openings | SameOpenings | None = None
        self.was_reset = False  # an episode was begun
        self._since = -1
        self._frames = frames
        self._open = False
        self._is_closed = False  # the closing rows of the episode are on the buffer
        self._half: tuple[Any, ...] | None = None  # a step that isn't booked yet
        self._failure: str | None = None
        self._wants_state = state and sink is not None
        self._state: Callable[[], Any] | None = None
        self._state_entry: tuple[Any, str | None] = NO_STATE
        self._reset_ns = self._started_ns = 0  # by the clock: the reset returned, the step began
        self._observed_ns = 0  # since the reset: what the turn's agents observe was there
        self._pack_state: Pack | None = None
        self._types: tuple[list[type | None], str] = [], "{}"
        self._known: dict[int, Codec] = {}
        self._info_text = InfoTexts().text
        self._packers: dict[AgentId, tuple[int, Pack, Pack]] = {}
        self._paid_terms: Callable[[AgentId], Any] | None = None
        self._unfit: BaseException | None = None  # why nothing of this environment can be recorded
        if sink is not None:
            self._buffer = sink.buffer
            self._buffer.lock = Lock()  # the writer cuts it in a thread of its own
            self._paid_terms = _terms_reader(env, sink.layout.terms)
            try:
                sink.layout.announce(list(getattr(env, "possible_agents", ())), self._codecs)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # told where it is evidence: by the first episode
                self._unfit = error

    # -- columns and spaces

    def _packers_of(self, agent: AgentId) -> tuple[int, Pack, Pack]:
        """Column number of an agent, and the functions that pack its observations and actions."""
        assert self.sink is not None
        layout = self.sink.layout
        columns = layout.agents.get(agent)
        if columns is None:
            columns = layout.add(agent, *self._codecs(agent))
        found = (
            columns.index,
            observation_packer(columns.observation, self.sink),
            action_packer(columns),
        )
        self._packers[agent] = found
        return found

    def _columns_of(self, agent: AgentId) -> AgentColumns:
        assert self.sink is not None
        return self.sink.layout.agents[agent]

    def _codecs(self, agent: AgentId) -> tuple[Codec | None, Codec | None]:
        return (
            self._codec(self.env.observation_space, agent),
            self._codec(self.env.action_space, agent),
        )

    def _codec(self, space_of: Callable[[AgentId], Any], agent: AgentId) -> Codec | None:
        try:
            with warnings.catch_warnings():  # PettingZoo's own method warns of its being called
                warnings.simplefilter("ignore")
                space = space_of(agent)
        except KeyboardInterrupt:
            raise
        except BaseException:  # an agent nobody declared has no space: its values are nonconforming
            return None
        if not isinstance(space, Space):
            return None
        known = self._known.get(id(space))
        if known is None:  # the codec keeps its space alive, so the id stays its own
            known = self._known[id(space)] = Codec(space)
        return known

    # -- episodes

    def _begin(self, seed: int | None, options: Mapping[str, Any] | None) -> None:
        assert self.sink is not None
        seed = _whole_seed(seed)
        self.episode += 1
        self.turn = 0
        if seed is not None:
            self._since = self.episode
        self._open, self._is_closed, self._half = True, False, None
        self._failure, self._state_entry = None, NO_STATE
        for columns in self.sink.layout.order:
            columns.acts_as = None
        text = None if options is None else to_json(options)
        opening = None if self.openings is None else self.openings.start(seed)
        self.was_reset = True
        start = EpisodeStart(self.episode, seed, self._since, text, self.policies, opening=opening)
        self._buffer.starts.append(start)

    def _reset_env(self, seed: int | None, options: Mapping[str, Any] | None) -> Any:
        """Resets the environment, which starts an episode; one that can't start has failed."""
        arguments = reset_arguments(seed, options)
        if self.sink is None:
            return self.env.reset(**arguments)
        self.end_episode()
        self._begin(seed, options)
        try:
            if self._unfit is not None:
                raise self._unfit
            out = self.env.reset(**arguments)
            self._reset_ns, self._observed_ns = perf_counter_ns(), 0
            return out
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a panic of Rust code is no Exception
            self.fail(traceback_text(error))
            self.end_episode()
            raise

    def _finish(self, end: str) -> None:
        """Closes the books of the episode in progress."""
        assert self.sink is not None
        self._open = False
        error, self._failure = self._failure, None
        end = "failed" if error is not None else end
        opening = None if self.openings is None else self.openings.end()
        columns = self._endings(), self._action_types(), opening
        self._buffer.ends.append(EpisodeEnd(self.episode, end, self.turn, error, *columns))
        self.sink.keep_up()

    def _action_types(self) -> str:
        """Python or NumPy type of each agent's whole-number actions in this episode, as JSON."""
        assert self.sink is not None
        agents = self.sink.layout.order
        types = [columns.acts_as for columns in agents]
        if types != self._types[0]:
            named = {s.name: type_name_of(s.acts_as) for s in agents if s.acts_as is not None}
            self._types = types, to_json(named)
        return self._types[1]

    def _endings(self) -> str | None:
        """Reasons by agent, where the environment's rules name them."""
        assert self.sink is not None
        try:
            found = self.env.unwrapped.endings
        except KeyboardInterrupt:
            raise
        except BaseException:  # most environments have none; an attribute may do anything
            return None
        if not isinstance(found, dict):
            return None
        agents = self.sink.layout.agents
        reasons = {
            agents[agent].name: reason
            for agent, reason in found.items()
            if agent in agents and isinstance(reason, str)
        }
        return to_json(reasons) if reasons else None

    def fail(self, error: str, *, in_step: bool = False) -> None:
        """Notes why the episode in progress can't go on; it ends as *failed*.

        Args:
            in_step: the step raised whose turn was recorded last.
        """
        self.failed_at = self.turn - in_step
        if self._state_entry[0].__class__ is LargePlace:  # its slot went with the turn that raised
            self._state_entry = NO_STATE
        self._failure = error

    def fail_at_last(self, error: str) -> None:
        """Notes why the episode in progress can't go on, where no step has said it already."""
        if self.sink is not None and self._open and self._failure is None:
            self.fail(error)

    @property
    def is_open(self) -> bool:
        """True while an episode is in progress."""
        return self._open

    # -- the turn

    def _info(self, info: Any, fields: list[str]) -> tuple[str | None, bytes | None]:
        """An info as JSON and the mask in it as bytes; what is no dictionary goes to `fields`."""
        if not isinstance(info, dict):
            fields.append(nonconforming("info", info))
            return None, None
        return self._info_text(info) if info else (None, None)

    def _nonconforming_action(self, agent: AgentId, action: Any) -> tuple[int | None, tuple[str]]:
        """Payload and `nonconforming` entry of an action that its packer didn't take."""
        payload = other_whole(self._columns_of(agent), action)
        entry = (
            nonconforming("action", action)
            if payload is None
            else nonconforming_type("action", action)
        )
        return payload, (entry,)

    def _commit(
        self, given: Sequence[Any], done: Sequence[Any], rows: int, wall_ns: int | None
    ) -> None:
        """Puts a whole turn on the buffer, its mark last; without `wall_ns` the closing rows.

        From the turn's number to the mark nothing is called, so no interrupt comes between them.
        """
        buffer, turn = self._buffer, self.turn
        observed_ns, acted_ns = self._observed_ns, self._started_ns - self._reset_ns
        buffer.given.extend(given)
        buffer.done.extend(done)
        if wall_ns is None:
            self._is_closed = True
        else:
            self.turn = turn + 1
        buffer.turns.extend(
            (self.episode, turn, rows, wall_ns, observed_ns, acted_ns, *self._state_entry)
        )
        self._observed_ns = acted_ns + (wall_ns or 0)

    def _fix(self) -> None:
        """Books the rest of a step in whose books an interrupt came."""
        half, self._half = self._half, None
        if half is None or not self._open or self._is_closed:
            return
        try:
            cut_back(self._buffer)
            self._book(*half)
        except KeyboardInterrupt:  # a second one: the step stays for whoever comes next
            self._half = half
            raise

    def _book(self, turn: int, *env_step: Any) -> None:
        """Books a step, or the rest of it where its own turn stands on the buffer already."""
        raise NotImplementedError

    def _stepped(self) -> None:
        """After a step: the next turn begins with a look at state and frame."""
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
        self._state_entry = self._look_at_state() if self._state is not None else NO_STATE
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
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # foreign code: kept as evidence, not as our failure
            return None, f'{{"state":{{"raised":{to_json(type_name(error))}}}}}'
        if self._pack_state is None:
            self.sink.layout.take_state(self._state_codec(state))
            side = self.sink.layout.state
            self._pack_state = observation_packer(side, self.sink)
        packed = self._pack_state(state)
        return (
            (packed, None)
            if packed is not None
            else (None, "{" + nonconforming("state", state) + "}")
        )

    def _state_codec(self, state: Any) -> Codec | None:
        declared = getattr(self.env, "state_space", None)
        if isinstance(declared, Space) and Codec(declared).pack(state) is not None:
            return Codec(declared)
        if isinstance(state, np.ndarray) and state.dtype.kind in "biuf":
            return Codec(_box_of(state))
        return None

    def _take_frame(self) -> None:
        try:
            frame = self.env.render()
        except KeyboardInterrupt:
            raise
        except BaseException:  # once it could be rendered; a turn without a frame says it can't
            return
        if frame is not None:
            self.sink.frame(self.episode, self.turn, frame)  # type: ignore[union-attr]

    def close(self) -> None:
        """Closes the environment; an episode in progress is kept as *cut*."""
        try:
            self.end_episode()
        finally:
            self.env.close()

    def end_episode(self) -> None:
        """Closes the books of an episode in progress; what was given last becomes closing rows."""
        if self.sink is None or not self._open:
            return
        try:
            if self._half is not None:
                self._fix()
            if self._open:
                self._end()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # what the environment gave can't be booked
            if not self._open:  # the writer failed
                raise
            self.fail_at_last(traceback_text(error))
            cut_back(self._buffer)
            self._finish("failed")

    def _end(self) -> None:
        """The closing rows of the episode in progress."""
        raise NotImplementedError


def _whole_seed(seed: Any) -> int | None:
    """The seed as it stands in its column.

    Raises:
        EvidenceError: it is no whole number of 64 bits, and couldn't be handed over again.
    """
    if seed is None:
        return None
    if isinstance(seed, int | np.integer) and int(seed) in SEEDS:
        return int(seed)
    raise EvidenceError(
        "a seed can't be recorded",
        where="reset(seed=...)",
        expected="a whole number of at most 64 bits",
        actual=f"{type(seed).__name__} {seed!r:.60}",
        fix="reset with a smaller number, or make one of it: seed % 2**63",
    )


def _terms_reader(env: Any, names: tuple[str, ...]) -> Callable[[AgentId], Any] | None:
    """Reads what the last step paid an agent by term, where the environment keeps `terms`."""
    if not names or not isinstance(getattr(env, "terms", None), dict):
        return None

    def read(agent: AgentId) -> tuple[float, ...]:
        paid = env.terms.get(agent)
        if paid.__class__ is not dict:
            paid = {}
        return tuple(paid.get(name, 0.0) for name in names)

    return read


def _box_of(state: NDArray[Any]) -> Box:
    """A Box without bounds for arrays like `state`."""
    kind, dtype = state.dtype.kind, state.dtype.type
    if kind == "f":
        return Box(-np.inf, np.inf, state.shape, dtype)
    limits = (False, True) if kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    return Box(*limits, state.shape, dtype)
