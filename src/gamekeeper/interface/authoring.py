"""Attributes and methods that both base classes, `TurnEnv` and `TickEnv`, give an author.

The author's methods are looked at once, as the class is made: `observe`, `state` and `render`
refuse to be called before a reset, and where there is a `mask` it goes into infos and Dict
observations. At a turn nothing is looked up that the class hasn't got.
"""

import copy
import pickle
import re
import secrets
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium.spaces import Dict, Space

from gamekeeper.contract import Contract, Ending, Schedule
from gamekeeper.errors import ActionError, ContractError, SpecError
from gamekeeper.interface.author_calls import HORIZON, AuthorCalls, before_reset
from gamekeeper.interface.casting import Cast, CastError, Casts, cast_to, own
from gamekeeper.interface.legality import copied, judge, refused, tidy_mask
from gamekeeper.interface.names_in_source import named_in
from gamekeeper.interface.object_source import kept_arguments
from gamekeeper.randomness.stream import Stream

ROOM: Final = "gamekeeper.interface"
_PRIVATE: Final = re.compile(r"_(?!_)(?![A-Za-z0-9]\w*__)\w+")  # and not mangled, which can't clash
_PETTINGZOO: Final = frozenset({"_cumulative_rewards"})  # PettingZoo's own name, known to authors


def reserved_names(kind: type) -> tuple[str, ...]:
    """Private names of the classes of this package that `kind` is built on."""
    ours = (base for base in kind.__mro__ if _is_ours(base))
    names = {name for base in ours for name in vars(base) if _PRIVATE.fullmatch(name)}
    return tuple(sorted(names - _PETTINGZOO))


def refuse_methods(kind: type, *, root: type) -> None:
    """A class that is about to be finished writes none of the base's names, nor do its mixins.

    Args:
        kind: the class; those under it that are built on `root` were looked at before.
        root: the base of all that authors write.
    Raises:
        ContractError: it does.
    """
    if _is_ours(kind):
        return
    reserved = reserved_names(kind)
    for base in kind.__mro__:
        if _is_ours(base) or (base is not kind and issubclass(base, root)):
            continue
        for name in reserved:
            if name in vars(base):
                raise _clash(base, name, "a method or attribute of the class")


def refuse_attributes(env: object, names: tuple[str, ...]) -> None:
    """An instance holds none of the base's names.

    Raises:
        ContractError: it does.
    """
    kind = type(env)
    for name in names:
        found = getattr(env, name)
        if getattr(found, "__func__", found) is not getattr(kind, name):
            raise _clash(kind, name, f"self.{name} = {found!r:.80}")


def _is_ours(kind: type) -> bool:
    return kind.__module__.startswith(f"{ROOM}.")


def _clash(kind: type, name: str, seen: str) -> ContractError:
    return ContractError(
        f"{kind.__qualname__} has a {name} of its own, and the base class needs that name",
        where=f"{kind.__module__}.{kind.__qualname__}",
        expected="another name",
        actual=seen,
        fix=f"rename it: {name[1:]}, or __{name[1:]}, which can't clash",
    )


@dataclass(frozen=True, slots=True, repr=False)
class Snapshot:
    """Everything that changes in a running environment, as it was; opaque, and good for many uses.

    It lives in memory and belongs to one class of environment; it is no evidence, and not for disk.
    """

    of: type
    _held: bytes | dict[str, Any]

    def __repr__(self) -> str:
        return f"<Snapshot of a {self.of.__qualname__}>"


def take(env: object, without: Collection[str]) -> Snapshot:
    """Puts aside all attributes of an environment but those named.

    Pickled in memory where that can be done (8 us for a small environment, a tenth of a deep copy),
    else copied deeply. What two attributes share they share again afterwards, but for arrays that
    are views of one another: these come apart, as in a deep copy.

    Raises:
        ContractError: an attribute can't be copied at all; names it.
    """
    attributes = {name: value for name, value in _attributes(env).items() if name not in without}
    try:
        return Snapshot(type(env), pickle.dumps(attributes, pickle.HIGHEST_PROTOCOL))
    except Exception:  # a local class, a lambda, a handle: each raises what it likes
        return Snapshot(type(env), _deeply(attributes))


def put_back(env: object, snapshot: Snapshot, without: Collection[str]) -> None:
    """Makes an environment what it was, but for the attributes named.

    Raises:
        SpecError: the snapshot is none, or was taken of another class.
    """
    if not isinstance(snapshot, Snapshot) or snapshot.of is not type(env):
        raise SpecError(
            "an environment can't be restored from this",
            where="restore",
            expected=f"a snapshot of a {type(env).__qualname__}",
            actual=repr(snapshot)[:200],
            fix="restore what snapshot() of an environment of this class returned",
        )
    held = snapshot._held
    # our own bytes, made in this process by take(): never anything that was read from a file
    attributes = pickle.loads(held) if isinstance(held, bytes) else copy.deepcopy(held)
    for name in _attributes(env):
        if name not in attributes and name not in without:
            object.__delattr__(env, name)
    for name, value in attributes.items():
        object.__setattr__(env, name, value)


def _deeply(attributes: dict[str, Any]) -> dict[str, Any]:
    """A deep copy, or an error that names the attribute that stands in its way."""
    try:
        return copy.deepcopy(attributes)
    except Exception as error:
        for name, value in attributes.items():
            try:
                copy.deepcopy(value)
            except Exception:
                raise ContractError(
                    f"the environment can't be put aside because of self.{name}",
                    where="snapshot",
                    expected="attributes that can be pickled or copied",
                    actual=f"{type(value).__name__}: {error}"[:300],
                    fix=f"snapshot_without = ({name!r},), if it is no part of the state",
                ) from error
        raise


def _attributes(env: object) -> dict[str, Any]:
    """Attributes of an object, in its dictionary and in its slots."""
    state = object.__getstate__(env)
    plain, slotted = state if isinstance(state, tuple) else (state, None)
    return {**(plain or {}), **(slotted or {})}


MASK: Final = "action_mask"
GUARDED: Final = ("observe", "state", "render")
FIXED: Final = frozenset(  # never part of a snapshot: they don't change, or are learnt again
    {
        "_Books__ranges",
        "_Books__spaces",
        "_TickEnv__ranges",
        "_TickEnv__spaces",
        "_Authored__casts",
        "_Authored__declared",
        "action_spaces",
        "built_with",
        "observation_spaces",
        "possible_agents",
        "render_mode",
        "state_space",
    }
)


class Authored(AuthorCalls):
    """The author's surface; see `TurnEnv`, which documents all of it."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    contract: str | PathLike[str] | Contract | None = None
    snapshot_without: ClassVar[Iterable[str]] = ()
    copy: ClassVar[Any] = True  # False: what observe, info and state return is handed out as it is
    render_mode: str | None
    horizon: int | None
    built_with: str | None  # arguments in canonical text; None: no text builds them again
    rng: Stream
    observation_spaces: dict[Any, Space[Any]]
    action_spaces: dict[Any, Space[Any]]
    turns: int

    _masks = _informs = _pardons = False  # whether the class has mask, info, illegal
    _trusts_ranges = True
    _reserved: tuple[str, ...] = ()  # names of the base's own that an author may not take
    __fresh: dict[Any, Any]  # masks asked since the last step
    __fresh_turn: int  # the turn they hold for: inside a step `turns` is one ahead
    __casts: Casts  # of this episode, each made as it is first needed
    __declared: Contract | None = None
    __is_checked = False  # no attribute has a name of the base's, as far as the first state went

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        """Keeps the arguments as text, so that a run of the object can open it again."""
        env = super().__new__(cls)
        env.built_with = kept_arguments(args, kwargs)
        return env

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
                actual=repr(horizon),
                fix="set horizon to a number of ticks, or to None for episodes without a limit",
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
        for name in GUARDED:  # what is inherited from an author's class has its guard already
            method = getattr(cls, name)
            if method.__module__ != "pettingzoo.utils.env" and not hasattr(method, "guards"):
                setattr(cls, name, _guarded(name, method))
        seen = cls.observe.guards  # type: ignore[attr-defined]  # just guarded, if not before
        view = seen if cls.copy is False else _cast(seen)
        cls._view = _with_mask(view) if cls._masks else view  # type: ignore[assignment,method-assign]  # bound as it was

    # -- what the author may write

    def starting_agents(self) -> Iterable[Any]:
        """Agents of the roster as an episode begins, in order; may draw from `self.rng`."""
        return self.possible_agents

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """Makes the first state. The books are open already; nobody may be paid or ended yet.

        Args:
            rng: the episode's random numbers, also `self.rng`.
            options: what reset was given; empty where it was given none.
        """

    def observe(self, agent: Any) -> Any:
        """Observation of any agent in the roster, at any time."""
        raise NotImplementedError(f"{type(self).__name__} has no observe(agent)")

    def mask(self, agent: Any) -> Any:
        """Mask of the actions that an agent may take, as `sample(mask)` takes it; None: all."""
        return None

    def info(self, agent: Any) -> Mapping[str, Any]:
        """Info of an agent, beside its mask."""
        return {}

    def illegal(self, agent: Any, action: Any) -> Any:
        """Answers an action that is masked out or outside its space: raises an error.

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
        """Path of the contract that the class names, beside its file; None where it names none.

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
                actual=f"{path} beside no file",
                fix="write the whole path of the contract",
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
            self.__declared = Contract.load(path)
        return self.__declared

    def known_sections(self) -> dict[str, Any]:
        """Sections of a contract that the environment knows of itself, for a draft."""
        limit = self._limit()
        terms, endings = named_in(kind for kind in type(self).__mro__ if not _is_ours(kind))
        if limit is not None:
            endings.setdefault(HORIZON, Ending(kind="truncation", owner="all"))
        sections = {"rewards": terms, "endings": endings}
        known = {name: table for name, table in sections.items() if table}
        return {"schedule": Schedule(horizon=limit), **known}

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
        self.__casts = Casts()
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
                actual=str(error),
                fix="call super().__init__() first, then set possible_agents and the spaces",
            ) from None
        self._check_names(is_begun=False)
        self.__fresh, self.__fresh_turn = {}, -1
        self.__casts = Casts()
        last: Stream | None = getattr(self, "rng", None)
        if seed is not None:
            self.rng = Stream(seed)
        else:
            self.rng = Stream(secrets.randbits(63)) if last is None else last.next_episode()
        if last is not None:
            self.rng.follow(last)
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
        """Tells whether an action may be played, and gives it in the form for rules.

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
        return refused(agent, action, self.action_space(agent), self._legal_of(agent))

    def _legal_of(self, agent: Any) -> Any:
        """An agent's mask now; the author is asked once for it between two steps."""
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
        if info and self.copy is not False:
            info = own(info)
        if self._masks and MASK not in info:
            mask = self._legal_of(agent)
            if mask is not None:
                info[MASK] = copied(mask)
        return info

    def _learn_cast(self, agent: Any) -> Cast:
        """Makes the function that copies an agent's observations and converts them."""
        space = self.observation_space(agent)
        return self.__casts.setdefault(agent, cast_to(space, MASK if self._masks else None))

    def _own_state(self, value: Any, method: Callable[..., Any]) -> Any:
        """The state copied, and of its space where the environment has one."""
        space = getattr(self, "state_space", None)
        try:
            return own(value) if space is None else cast_to(space)(value)
        except CastError as misfit:
            raise _unfit(misfit, "state()", method) from None

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
    """The author's method, refused before the first reset; what it shows is handed out whole."""

    @wraps(method)
    def guarded(self: Any, *args: Any, **options: Any) -> Any:
        if not hasattr(self, "agents"):
            raise before_reset(name)
        return method(self, *args, **options)

    @wraps(method)
    def observe(self: Any, agent: Any) -> Any:
        if not hasattr(self, "agents"):
            raise before_reset(name)
        if type(self).observe is observe:
            return self._view(agent)
        seen = method(self, agent)  # asked by a subclass, whose space may be another
        return self._masked(agent, seen) if self._masks else seen

    @wraps(method)
    def state(self: Any) -> Any:
        seen = guarded(self)
        return seen if self.copy is False else self._own_state(seen, method)

    chosen: Any = {"observe": observe, "state": state}.get(name, guarded)
    chosen.guards = method
    return chosen  # type: ignore[no-any-return]


def _cast(seen: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """The author's observe without its guard; its values are copied and fit their space."""

    def view(self: Any, agent: Any) -> Any:
        value = seen(self, agent)
        try:
            cast = self._Authored__casts[agent]
        except KeyError:
            cast = self._learn_cast(agent)
        try:
            return cast(value)
        except CastError as misfit:
            raise _unfit(misfit, f"observe({agent!r})", seen) from None

    return view


def _with_mask(view: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def masked(self: Any, agent: Any) -> Any:
        return self._masked(agent, view(self, agent))

    return masked


def _unfit(misfit: CastError, call: str, method: Callable[..., Any]) -> ContractError:
    """Error about a value that its space has no form for; names the author's method and line."""
    code = getattr(method, "__code__", None)
    line = f" ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code else ""
    return ContractError(
        f"{call} returned a value that isn't of its space",
        where=f"{call}{misfit.path}{line}",
        expected=misfit.expected,
        actual=misfit.actual,
        fix=f"{misfit.fix}; or copy = False in the class: nothing is copied or converted",
    )
