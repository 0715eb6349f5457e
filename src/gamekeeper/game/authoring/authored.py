"""What an author of rules finds in both base classes, `TurnEnv` and `TickEnv`.

The author's methods are looked at once, as the class is made: `observe`, `state` and `render`
refuse to be called before a reset, and where there is a `mask` it goes into infos and Dict
observations. At a turn nothing is looked up that the class hasn't got.
"""

from __future__ import annotations

import secrets
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium.spaces import Dict, Space

from gamekeeper.core.contract import Contract
from gamekeeper.core.stream import Stream
from gamekeeper.errors import ActionError, ContractError
from gamekeeper.game.authoring.legality import copied, judge, refused, tidy_mask
from gamekeeper.game.authoring.reserved import refuse_attributes, refuse_methods, reserved_names
from gamekeeper.game.authoring.snapshot import Snapshot, put_back, take
from gamekeeper.game.authoring.verbs import Verbs, before_reset

MASK: Final = "action_mask"
GUARDED: Final = ("observe", "state", "render")
FIXED: Final = frozenset(  # never part of a snapshot: they don't change, or are learnt again
    {
        "_Books__ranges",
        "_Books__spaces",
        "_TickEnv__ranges",
        "_TickEnv__spaces",
        "_Authored__declared",
        "action_spaces",
        "observation_spaces",
        "possible_agents",
        "render_mode",
        "state_space",
    }
)


class Authored(Verbs):
    """The author's surface; see `TurnEnv`, where it is told whole."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  # PettingZoo declares it so
    contract: str | PathLike[str] | Contract | None = None
    snapshot_without: ClassVar[Iterable[str]] = ()
    render_mode: str | None
    horizon: int | None
    rng: Stream
    observation_spaces: dict[Any, Space[Any]]
    action_spaces: dict[Any, Space[Any]]
    turns: int

    _masks = _informs = _pardons = False  # whether the class has mask, info, illegal
    _trusts_ranges = True
    _reserved: tuple[str, ...] = ()  # names of the base's own that an author may not take
    __fresh: dict[Any, Any]  # masks asked since the last crossing
    __fresh_turn: int  # the turn they hold for: inside a crossing `turns` is one ahead
    __declared: Contract | None = None
    __is_checked = False  # no attribute has a name of the base's, as far as the first state went

    def __init__(self, *, render_mode: str | None = None, horizon: int | None = None) -> None:
        """Takes what every environment has.

        Args:
            render_mode: one of metadata["render_modes"], or None; "human" draws by itself.
            horizon: ticks after which everybody left is truncated ("horizon"); None: what the
                contract declares, else never.
        Raises:
            ContractError: the horizon isn't a whole number above 0.
        """
        super().__init__()
        if horizon is not None and (type(horizon) is not int or horizon < 1):
            raise ContractError(
                "a horizon is no number of ticks",
                where="horizon",
                expected="a whole number above 0, or None",
                seen=repr(horizon),
            )
        self.render_mode, self.horizon = render_mode, horizon
        self.terms, self.endings = {}, {}

    def __init_subclass__(cls, **given: Any) -> None:
        """Looks at which methods the author wrote, and puts the guards in front of them.

        Raises:
            ContractError: one of them has the name of something of the base's.
        """
        super().__init_subclass__(**given)
        refuse_methods(cls, root=Authored)
        cls._reserved = reserved_names(cls)
        cls._masks = cls.mask is not Authored.mask
        cls._informs = cls.info is not Authored.info
        cls._pardons = cls.illegal is not Authored.illegal
        cls._trusts_ranges = not cls._masks
        for name in GUARDED:
            method = getattr(cls, name)
            if method.__module__ != "pettingzoo.utils.env" and not hasattr(method, "guards"):
                setattr(cls, name, _guarded(name, method))
        seen = cls.observe.guards  # type: ignore[attr-defined]  # just guarded, if not before
        cls._view = _with_mask(seen) if cls._masks else seen  # type: ignore[assignment]

    # -- what the author may write

    def starting_agents(self) -> Iterable[Any]:
        """Who is in the roster as an episode begins, in order; `self.rng` may be drawn from."""
        return self.possible_agents

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """Makes the first state. The books are open already; nobody may be paid or ended yet.

        Args:
            rng: the episode's random numbers, also `self.rng`.
            options: what reset was given; empty where it was given none.
        """

    def observe(self, agent: Any) -> Any:
        """What an agent sees: anybody in the roster, at any time."""
        raise NotImplementedError(f"{type(self).__name__} has no observe(agent)")

    def mask(self, agent: Any) -> Any:
        """Which actions an agent may take, as its space's `sample(mask)` takes it; None: all."""
        return None

    def info(self, agent: Any) -> Mapping[str, Any]:
        """What stands in `infos` beside the mask."""
        return {}

    def illegal(self, agent: Any, action: Any) -> Any:
        """What becomes of an action that is masked out or outside its space: an error.

        Written by the author it is a rule: it may pay a penalty and end agents, and returns the
        action that is played instead, or None, and none is (a TurnEnv's turn is over; a TickEnv's
        `actions` have no such agent).

        Raises:
            ActionError: always, as it stands here.
        """
        raise self._refused(agent, action)

    # -- PettingZoo's side

    def observation_space(self, agent: Any) -> Space[Any]:
        """The space of an agent's observations, the same object every time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: Any) -> Space[Any]:
        """The space of an agent's actions, the same object every time."""
        return self.action_spaces[agent]

    def close(self) -> None:
        """Closes windows and files; there are none here."""

    # -- the contract

    @property
    def contract_path(self) -> Path | None:
        """Where the class says its contract lies: beside the file that says so; None: it doesn't.

        Raises:
            ContractError: the class comes from no file.
        """
        if self.contract is None or isinstance(self.contract, Contract):
            return None
        path = Path(self.contract)
        if path.is_absolute():
            return path
        owner = next(kind for kind in type(self).__mro__ if "contract" in vars(kind))
        file = getattr(sys.modules.get(owner.__module__), "__file__", None)
        if file is None:
            raise ContractError(
                f"the contract of {owner.__qualname__} can't be found",
                where=f"{owner.__qualname__}.contract",
                expected="a class in a file, beside which the contract lies",
                seen=f"{path} beside no file",
                mend="write the whole path of the contract",
            )
        return Path(file).parent / path

    @property
    def declared(self) -> Contract | None:
        """The contract that the class names, read when it is first asked for.

        Raises:
            ContractError: it can't be found, read or understood.
        """
        if isinstance(self.contract, Contract):
            return self.contract
        if self.__declared is None and (path := self.contract_path) is not None:
            from gamekeeper.game.contract_file import load_contract  # only where there is one

            self.__declared = load_contract(path)
        return self.__declared

    # -- copies

    def snapshot(self) -> Snapshot:
        """The running environment put aside: every attribute, the author's too, and the stream.

        Left out are spaces, and the attributes named in the class's `snapshot_without` (windows,
        open files, large tables that never change).
        """
        return take(self, FIXED | set(self.snapshot_without))

    def restore(self, snapshot: Snapshot) -> None:
        """Goes on bit for bit from where a snapshot was taken, as often as wanted.

        The snapshot may be of another instance of the same class, built with the same arguments.

        Raises:
            SpecError: it is of another class, or no snapshot.
        """
        put_back(self, snapshot, FIXED | set(self.snapshot_without))
        if hasattr(self, "agents"):
            self._learn_spaces(self.agents)

    # -- for the two base classes

    def _take_seed(self, seed: int | None) -> Stream:
        """The stream of the episode that begins: a new seed's, or the last seed's next."""
        try:
            _ = self.horizon, self.possible_agents
        except AttributeError as error:
            raise ContractError(
                f"{type(self).__name__} wasn't built completely",
                where="__init__",
                expected="super().__init__(), then possible_agents and both dictionaries of spaces",
                seen=str(error),
            ) from None
        self._check_names(is_begun=False)
        self.__fresh, self.__fresh_turn = {}, -1
        last: Stream | None = getattr(self, "rng", None)
        if seed is not None:
            self.rng = Stream(seed)
        else:
            self.rng = Stream(secrets.randbits(63)) if last is None else last.next_episode()
        return self.rng

    def _check_names(self, *, is_begun: bool) -> None:
        """Looks at an instance's attributes: before its first episode, and once that has begun.

        Raises:
            ContractError: one of them has the name of something of the base's.
        """
        if not self.__is_checked:
            refuse_attributes(self, self._reserved)
            self.__is_checked = is_begun

    def _limit(self) -> int | None:
        """The horizon: the one given, else the contract's."""
        if self.horizon is not None:
            return self.horizon
        form = self.declared
        return None if form is None or form.schedule is None else form.schedule.horizon

    def _judge(self, agent: Any, action: Any) -> tuple[bool, Any]:
        """Whether an action may be played, and in which form.

        Raises:
            ActionError: it is masked out or outside its space, and the author wrote no `illegal`.
        """
        if self._masks:
            mask = self._legal_of(agent)
        elif isinstance(action, np.integer) and int(action) in self._range_of(agent):
            return True, int(action)  # what NumPy samples, so most actions there are
        else:
            mask = None
        plays, played = judge(self.action_space(agent), action, mask)
        if not plays and not self._pardons:
            raise self._refused(agent, action)
        return plays, played

    def _refused(self, agent: Any, action: Any) -> ActionError:
        """Names agent, action, space and mask."""
        return refused(agent, action, self.action_space(agent), self._legal_of(agent))

    def _legal_of(self, agent: Any) -> Any:
        """An agent's mask now; the author is asked once for it between two crossings."""
        if not self._masks:
            return None
        still = self.__fresh_turn == self.turns
        if still and agent in self.__fresh:
            return self.__fresh[agent]
        mask = tidy_mask(self.action_space(agent), self.mask(agent), agent)
        if still:
            self.__fresh[agent] = mask
        return mask

    def _forget_masks(self) -> None:
        """Masks are asked anew: what they hang on has changed."""
        self.__fresh, self.__fresh_turn = {}, self.turns

    def _info_of(self, agent: Any) -> dict[str, Any]:
        """A new info: what the author tells, and the mask."""
        info = dict(self.info(agent)) if self._informs else {}
        if self._masks and MASK not in info:
            mask = self._legal_of(agent)
            if mask is not None:
                info[MASK] = copied(mask)
        return info

    def _masked(self, agent: Any, observation: Any) -> Any:
        """An observation with the mask in it, where its space has a place for one, still free."""
        if not isinstance(observation, dict) or MASK in observation:
            return observation
        space = self.observation_space(agent)
        if not isinstance(space, Dict) or MASK not in space.spaces:
            return observation
        mask, place = self._legal_of(agent), space.spaces[MASK]
        if mask is None:
            mask = np.ones(place.shape or (), dtype=place.dtype)
        elif isinstance(mask, np.ndarray):
            mask = mask.astype(place.dtype)
        else:
            mask = copied(mask)
        return {**observation, MASK: mask}


def _guarded(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """The author's method, refused before the first reset; an observation gets its mask."""

    @wraps(method)
    def guarded(self: Any, *args: Any, **options: Any) -> Any:
        if not hasattr(self, "agents"):
            raise before_reset(name)
        return method(self, *args, **options)

    @wraps(method)
    def observe(self: Any, agent: Any) -> Any:
        if not hasattr(self, "agents"):
            raise before_reset(name)
        seen = method(self, agent)
        return self._masked(agent, seen) if self._masks else seen

    chosen: Any = observe if name == "observe" else guarded
    chosen.guards = method
    return chosen  # type: ignore[no-any-return]


def _with_mask(seen: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """The author's observe without its guard, and with the mask."""

    def view(self: Any, agent: Any) -> Any:
        return self._masked(agent, seen(self, agent))

    return view
