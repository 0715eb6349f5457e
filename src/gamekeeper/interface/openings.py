"""Openings: what an episode began with beside seed and options, as data, and its setting up again.

A trainer seeds the first reset and no other. So at each reset without a seed the states of the
generators that the environment holds are taken down, and those of the process's own, `random` and
`numpy.random`, where it draws from them. Attributes that the caller sets are taken down too.
"""

from __future__ import annotations

import base64
import json
import operator
import random
import secrets
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.generators import at_end, chains, put_back, state_of
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.randomness.stream import Stream

GLOBALS: Final[Mapping[str, Any]] = {"random": random, "numpy.random": np.random}
"""Generators that all of the process shares."""
SPACES: Final = (Space,)
WARM_SEED: Final = 0
"""Seed of a reset before an episode that wasn't the first of its environment."""


# -- Taken down while an environment is recorded


class Openings:
    """Takes down the openings of one environment's episodes.

    Attributes:
        drawn: the global generators whose states are taken down too.
    """

    def __init__(self, env: Any) -> None:
        self._held = _HeldGenerators(env)
        self.drawn: Collection[str] = tuple(GLOBALS)
        self._attributes: dict[str, str] = {}
        self._later: list[tuple[int, str, str]] = []
        self._before: dict[str, Any] = {}
        self._was_reset = False

    def start(self, seed: int | None) -> str | None:
        """The opening of the episode whose reset comes now; None where seed and options are all."""
        self._attributes.update({name: text for _, name, text in self._later})
        self._later = []
        self._before, drawn = {}, self.drawn
        if seed is None:
            self._before["generators"] = {
                "own": [_state(each) for each in self._held.now()],
                "global": {name: _state(each) for name, each in GLOBALS.items() if name in drawn},
            }
            self._before["was_reset"] = self._was_reset
        if self._attributes:
            self._before["attributes"] = dict(self._attributes)
        self._was_reset = True
        return _text(self._before) if self._before else None

    def end(self) -> str | None:
        """The opening with attributes that were set since; None where there are none."""
        if not self._later:
            return None
        return _text({**self._before, "set": [list(each) for each in self._later]})

    def set(self, name: str, value: Any, *, turn: int, is_open: bool) -> None:
        """Takes down that an attribute is set to `value`, in an episode or between two."""
        text = to_json(value)
        if is_open:
            self._later.append((turn, name, text))
        else:
            self._attributes[name] = text


class SameOpenings:
    """Hands on the opening of an episode that is played again."""

    def __init__(self) -> None:
        self.text: str | None = None

    def start(self, seed: int | None) -> str | None:
        """The opening that was set."""
        return self.text

    def end(self) -> None:
        """Adds nothing."""


def _text(opening: Mapping[str, Any]) -> str:
    return json.dumps(opening, separators=(",", ":"))


class _HeldGenerators:
    """Generators that an environment holds, but for those of spaces, which sample for callers.

    The whole environment is looked through at the first reset without a seed, at the second, the
    fourth and so on, and wherever a generator isn't found in its place.
    """

    def __init__(self, env: Any) -> None:
        self._env, self._asked = env, 0
        self._chains: list[tuple[Any, ...]] = []

    def now(self) -> list[Any]:
        """The generators."""
        self._asked += 1
        found = [at_end(chain) for chain in self._chains]
        if None in found or self._asked & (self._asked - 1) == 0:
            self._chains = chains(self._env, without=SPACES)
            found = [chain[-1] for chain in self._chains]
        return found


def _state(generator: Any) -> dict[str, Any]:
    """State of a generator as plain JSON."""
    if isinstance(generator, Stream):
        return {"kind": "Stream", "state": list(generator.state)}
    if isinstance(generator, np.random.RandomState) or generator is np.random:
        return {"kind": "RandomState", "state": _plain(generator.get_state(legacy=False))}
    kind = "Generator" if isinstance(generator, np.random.Generator) else "Random"
    return {"kind": kind, "state": _plain(state_of(generator))}


def _plain(value: Any) -> Any:
    """Whole numbers of any size, floats, texts, and arrays by their bytes."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"dtype": value.dtype.str, "base64": data}
    if isinstance(value, tuple):
        if len(value) > 8 and all(type(each) is int and each >> 32 == 0 for each in value):
            return {"tuple": _plain(np.array(value, np.uint32))}
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def seed_each_reset(game: Any) -> None:
    """Gives each reset of a capture that comes without a seed a derived one.

    It is `episode_seed` of the seed that was given last, or of a random one, and of the episode's
    number.
    """
    reset, last = game.reset, [secrets.randbits(31)]

    def seeded(seed: int | None = None, options: Mapping[str, Any] | None = None) -> Any:
        if seed is None:
            seed = episode_seed(last[0], game.episode + 1)
        else:
            last[0] = abs(operator.index(seed))
        return reset(seed, options)

    game.reset = seeded


# -- Set up again


@dataclass(frozen=True, slots=True)
class Opening:
    """Opening of an episode that is about to be played again."""

    own: tuple[Any, ...] | None = None
    shared: Mapping[str, Any] = field(default_factory=dict)
    was_reset: bool = False
    attributes: Mapping[str, str] = field(default_factory=dict)
    later: tuple[tuple[int, str, str], ...] = ()

    @classmethod
    def from_text(cls, text: str | None) -> Opening:
        """The opening that stands in a run; an empty one where none does.

        Raises:
            EvidenceError: the text is damaged.
        """
        if text is None:
            return cls()
        try:
            found = json.loads(text)
            states = found.get("generators")
            return cls(
                own=None if states is None else tuple(states["own"]),
                shared={} if states is None else dict(states["global"]),
                was_reset=bool(found.get("was_reset")),
                attributes={str(k): str(each) for k, each in found.get("attributes", {}).items()},
                later=tuple((int(t), str(n), str(each)) for t, n, each in found.get("set", ())),
            )
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise _damaged(text) from error

    @property
    def has_states(self) -> bool:
        """True if the episode can be played without those before it."""
        return self.own is not None

    def begin(self, env: Any, *, was_reset: bool) -> None:
        """Sets up the environment right before the reset.

        Args:
            was_reset: this object was reset before.
        Raises:
            EvidenceError: it holds other generators than it did.
        """
        if self.was_reset and not was_reset:  # a first reset may make generators and attributes
            env.reset(seed=WARM_SEED)
        for name, text in self.attributes.items():
            _set(env, name, text)
        if self.own is None:
            return
        # States last, as they were taken down right before the reset: setting an attribute may
        # draw.
        own = [chain[-1] for chain in chains(env, without=SPACES)]
        kinds = [_state(each)["kind"] for each in own]
        before = [each.get("kind") for each in self.own]
        if kinds != before:
            raise EvidenceError(
                "the environment holds other random generators than when the episode began",
                where=type(env.unwrapped).__name__,
                expected=", ".join(map(str, before)) or "none",
                actual=", ".join(kinds) or "none",
                fix="record with seed_resets=True, which seeds every reset",
            )
        pairs = [*zip(own, self.own, strict=True)]
        pairs += [(GLOBALS[name], each) for name, each in self.shared.items() if name in GLOBALS]
        for generator, state in pairs:
            try:
                _put_back(generator, state)
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                raise _damaged(json.dumps(state)) from error

    def set_at(self, turn: int, env: Any) -> None:
        """Sets the attributes that were set in this turn, before its step."""
        for at, name, text in self.later:
            if at == turn:
                _set(env, name, text)


def _set(env: Any, name: str, text: str) -> None:
    """Sets an attribute; a value that no text can build is left out, and comparing tells."""
    if is_exact(text):
        setattr(env, name, from_json(text))


def _put_back(generator: Any, entry: Mapping[str, Any]) -> None:
    state = _built(entry["state"])
    if isinstance(generator, Stream):
        seed, episode, lane, draws = state
        Stream.__init__(generator, seed, episode, lane=lane)
        generator.draws = draws
    elif isinstance(generator, random.Random) or generator is random:
        put_back(generator, (state[0], tuple(state[1]), state[2]))
    else:
        put_back(generator, state)


def _built(value: Any) -> Any:
    if isinstance(value, list):
        return [_built(each) for each in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {"dtype", "base64"}:
        return np.frombuffer(base64.b64decode(value["base64"]), np.dtype(value["dtype"])).copy()
    if value.keys() == {"tuple"}:
        return tuple(_built(value["tuple"]).tolist())
    return {key: _built(each) for key, each in value.items()}


def _damaged(text: str) -> EvidenceError:
    return EvidenceError(
        "the recorded start of an episode (seed, options) can't be read",
        where="episodes, opening",
        actual=text[:200],
        fix="restore the run from a copy",
    )
