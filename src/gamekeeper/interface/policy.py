"""Policies by what a user names: a word, a callable in a module or a file, a callable."""

import contextlib
import difflib
import inspect
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

import numpy as np
from gymnasium.spaces import Discrete, Space
from numpy.random import Generator

from gamekeeper import plugins
from gamekeeper.episodes.exception_text import message, said_by
from gamekeeper.errors import ActionError, GamekeeperError, PolicyError, SpecError
from gamekeeper.interface.action_mask import legal_flags, reader, unreadable
from gamekeeper.interface.construction import did_you_mean, foreign, foreign_traceback, nearest
from gamekeeper.interface.identity import source_digest
from gamekeeper.interface.modules import load_file, load_module, split_file

_UNFIT: Final = (PolicyError, AssertionError, ValueError, TypeError, IndexError)
"""Errors to which a mask of a wrong form leads, here or in Gymnasium's `sample`."""

Player: TypeAlias = Callable[[Any, Any], Any]
"""From an observation and an info to an action: a policy in an agent's place, for one episode."""

Start: TypeAlias = Callable[[Generator], Player]
"""From the stream of one episode to the player of that episode."""


@dataclass(frozen=True, slots=True)
class AgentSlot:
    """Facts about an agent before it plays."""

    agent: Any
    space: Space[Any]
    """Its action space; the environment's own, so nothing may be drawn from it."""
    role: str | None = None
    noop: Any = None
    """The action that does nothing, as its contract declares it; None where it declares none."""
    mask: str | None = None
    """Place of the mask by its contract: `observation.KEY` or `infos.KEY`."""
    shared: dict[Any, Any] = field(default_factory=dict)
    """The same object for all agents: what they have in common need stand only once."""


@runtime_checkable
class SlotPolicy(Protocol):
    """A policy that wants to know each agent it plays: a module of `policies`, or an object.

    Optional: `check(agent, role, noop)`, called before anything runs, raises a PolicyError where
    the policy can't play an agent.
    """

    VERSION: str
    """A text that changes when the same seed would lead to other actions."""

    def start_for(self, given: AgentSlot, /) -> Start:
        """The policy in an agent's place, ready to start episodes."""


@contextlib.contextmanager
def masks_blamed_on(given: AgentSlot, mask: object) -> Iterator[None]:
    """Names the agent whose mask can't be used, and tells a wrong form from code that raises.

    Raises:
        PolicyError: the mask doesn't fit the action space.
        RuntimeError: the mask's own code raised; no error of ours, so that the environment failed.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raised = unreadable(mask) if issubclass(type(error), _UNFIT) else error
        if raised is not None:
            raise RuntimeError(
                f"the action mask of {given.agent!r} can't be read: {said_by(raised)}"
            ) from raised
        refusal = error if isinstance(error, PolicyError) else PolicyError(message(error))
        raise PolicyError(
            f"the action mask of {given.agent!r} doesn't fit its action space",
            where=given.mask or "action_mask in the observation or the info",
            expected=refusal.expected or f"a mask for {given.space}",
            actual=refusal.actual or refusal.what,
            fix=f"say where the mask stands: roles.{given.role or '<role>'}.mask in the contract",
        ) from error


GROUP: Final = "gamekeeper.policies"
SCHEMES: Final = "gamekeeper.schemes"
"""Entry points by the word before a policy's colon; each is a `Scheme`."""
_PACKAGE: Final = "gamekeeper.interface.policies"
EVERYONE: Final = "*"
"""Key of the choice for all agents that no other choice names."""
REFERENCE: Final = "reference"
"""The policy that an environment brings for how it is meant to be played."""
SAME: Final = "same:"
"""In front of an agent, a role or `*`: the very object that plays there."""
_FORMS: Final = "module:callable, file.py:callable, same:AGENT, or a Python callable"
_CALL: Final = "(observation, agent, info, rng)"


class Policy(Protocol):
    """Chooser of actions: any callable of this form, called once a turn for each of its agents.

    Optional: `version`, a text kept with the evidence; `reset(seed)` or `reset()`, called before
    each episode, with a whole number in [0, 2**31) that depends on the run's seed, the episode and
    the agent that it plays.
    All randomness should come from `rng`, a stream of the agent's own for the episode.
    """

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> Any:
        """The action of a live agent; never None."""


def reset_policy(policy: Any, seed: int) -> None:
    """Calls the `reset` of a policy, with a seed where it takes one."""
    try:
        parameters = inspect.signature(policy.reset).parameters
    except (TypeError, ValueError):  # compiled code says nothing of its parameters
        takes_seed = True
    else:
        kinds = {each.kind for each in parameters.values()}
        takes_seed = "seed" in parameters or inspect.Parameter.VAR_KEYWORD in kinds
    policy.reset(**({"seed": seed} if takes_seed else {}))


Choice: TypeAlias = "str | Policy | Chosen"
Scheme: TypeAlias = Callable[[str], Policy]
"""From what stands behind a scheme's colon to a policy: `sb3:model.zip`."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A policy that was found, and what evidence says of it."""

    name: str
    """Text that a user types to have it again; for a callable in memory its module and name."""
    version: str | None
    """A built-in's version, the policy's own `version`, or else the digest of its source."""
    policy: Policy | SlotPolicy


def resolve(choice: Choice) -> Chosen:
    """The policy behind a user's choice. A class is made into an instance, without arguments.

    Args:
        choice: `random`, `first-legal`, `noop`, `module:callable`, `file.py:callable`, a form that
            an entry point brings (`sb3:model.zip`), or a callable.
    Raises:
        PolicyError: there is no such policy, loading it raised, or it can't be called as a policy.
    """
    if isinstance(choice, Chosen):
        return choice
    if not isinstance(choice, str):
        return _in_memory(choice)
    name = choice.strip()
    built_ins = _built_ins()
    if name in built_ins:
        return Chosen(name, built_ins[name].VERSION, built_ins[name])
    scheme, colon, rest = name.partition(":")
    if colon:
        with _as_policy_error(name):
            load: Any = plugins.one(SCHEMES, scheme)
            policy = None if load is None else load(rest)
        if policy is not None:
            return _checked(name, policy)
    if not colon or not rest:
        raise _no_policy(name, built_ins)
    with _as_policy_error(name):
        return _checked(name, _loaded(name))


def check_words(choices: Iterable[str], own: Iterable[str]) -> None:
    """The bare words among the choices are known; nothing is loaded to find out.

    Args:
        choices: as users name them.
        own: words that the environment knows, as `reference`.
    Raises:
        PolicyError: there is no such policy.
    """
    words = [*_built_ins(), *own]
    for name in map(str.strip, choices):
        if ":" not in name and name not in words:
            raise _no_policy(name, words)


def check_spelling(texts: Iterable[str]) -> None:
    """Checks policies that nothing plays, as far as no environment is needed to.

    Raises:
        PolicyError: one is incomplete, or a bare word is a known one misspelt, as far as can be
            seen.
    """
    words = [*_built_ins(), REFERENCE]
    near = [name for name in parse_choices(texts).values() if nearest(name, words)]
    check_words(near, words)


def _no_policy(name: str, words: Iterable[str]) -> PolicyError:
    if name == REFERENCE:
        return PolicyError(
            "this environment brings no reference policy",
            where="policies",
            expected=", ".join([*words, _FORMS]),
            actual=repr(name),
            fix="use random, or a policy of your own: module:callable or file.py:callable; "
            "reference is the scripted policy of Gamekeeper's own tasks, and of an environment "
            "that lists one in its attribute `policies`",
        )
    words = list(words)
    return PolicyError(
        f"there is no policy called {name!r}",
        expected=", ".join([*words, _FORMS]),
        actual=repr(name),
        fix=did_you_mean(difflib.get_close_matches(name, words, n=1))
        or "use one of these, or module:callable for a policy of your own",
    )


def distrust_policy(name: str) -> str | None:
    """Reason why evidence needs consent to run a policy; None for a bare word.

    A word is a policy that Gamekeeper brings, or one of the environment's own (`reference`), which
    is trusted as far as the environment is; only a name with a colon can lead anywhere else.
    """
    is_code = ":" in name and shared_with(name) is None
    return f"the policy {name!r} is code that evidence names" if is_code else None


def shared_with(choice: object) -> str | None:
    """Returns the place whose object a choice shares (`same:wolf`: wolf); None for its own."""
    is_shared = isinstance(choice, str) and choice.startswith(SAME)
    return str(choice).removeprefix(SAME) if is_shared else None


def is_schemed(name: str) -> bool:
    """A trainer's adapter loads it from data (`sb3:model.zip`), which may hold code."""
    scheme, colon, _ = name.partition(":")
    return bool(colon) and scheme in plugins.names(SCHEMES)


def parse_choices(texts: Iterable[str]) -> dict[str, str]:
    """Choices by agent, by role, or under `*`, from any number of `[AGENT|ROLE=]X`.

    Raises:
        PolicyError: a text is empty, or two of them are for the same players.
    """
    choices: dict[str, str] = {}
    for text in texts:
        place, equals, name = text.partition("=")
        if not equals or any(mark in place for mark in ":/\\"):  # the = of a path or of an argument
            place, name = EVERYONE, text
        place, name = place.strip(), name.strip()
        if not place or not name:
            raise PolicyError(
                "a policy is incomplete",
                expected="[AGENT|ROLE=]POLICY",
                actual=repr(text),
                fix="put a policy behind the equals sign: picker_0=random",
            )
        if place in choices:
            raise PolicyError(
                f"two policies for {'everyone' if place == EVERYONE else place}",
                expected="one",
                actual=f"{choices[place]!r} and {name!r}",
                fix="name one policy for each agent or role",
            )
        choices[place] = name
    return choices


def _built_ins() -> dict[str, SlotPolicy]:
    found = plugins.load(GROUP, _PACKAGE).found
    return {n.replace("_", "-"): part for n, part in found.items() if isinstance(part, SlotPolicy)}


def _loaded(name: str) -> object:
    file = split_file(name)
    if file is not None and file[1] is not None:
        module, attribute = load_file(file[0])[0], file[1]
    else:
        path, _, attribute = name.partition(":")
        module = load_module(path)
    value: object = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            public = [other for other in dir(value) if not other.startswith("_")]
            raise SpecError(
                f"there is no {part!r} in {name}{nearest(part, public)}",
                where=name,
                expected=f"a callable {_CALL}",
                fix="name a callable of the module",
            )
        value = getattr(value, part)
    return value


def _in_memory(choice: object) -> Chosen:
    kind = choice if inspect.isclass(choice) or inspect.isroutine(choice) else type(choice)
    name = f"{getattr(kind, '__module__', '?')}:{getattr(kind, '__qualname__', '?')}"
    with _as_policy_error(name):
        return _checked(name, choice)


def _checked(name: str, policy: Any) -> Chosen:
    if inspect.isclass(policy):
        policy = policy()
    if isinstance(policy, SlotPolicy):
        return Chosen(name, policy.VERSION, policy)
    if not callable(policy):
        raise PolicyError(
            f"{name} can't be called",
            where="policies",
            expected=f"a callable {_CALL}",
            actual=type(policy).__qualname__,
            fix="hand in a callable, or a class whose objects are callable",
        )
    try:
        signature = inspect.signature(policy)
        signature.bind(None, None, None, None)
    except ValueError:  # some builtins have no signature; calling will tell
        pass
    except TypeError:
        raise PolicyError(
            f"{name} can't be called as a policy",
            where="policies",
            expected=f"a callable {_CALL}",
            actual=f"{getattr(policy, '__qualname__', name)}{signature}",
            fix="take these four arguments, in this order",
        ) from None
    version = getattr(policy, "version", None)
    return Chosen(name, source_digest([policy]) if version is None else str(version), policy)


@contextlib.contextmanager
def _as_policy_error(name: str) -> Iterator[None]:
    try:
        with foreign(f"loading the policy {name}", where=name):
            yield
    except SpecError as error:
        raise PolicyError(**error.parts()) from error


def guarded(slot: AgentSlot, chosen: Chosen, policy: Policy) -> Start:
    """A user's policy in an agent's place: tells what it raises, or answers that can't be used.

    Actions of a Discrete space are looked at. Those of other spaces pass as they are: many
    environments take a list or a float64 where their space says float32.
    """
    agent, space = slot.agent, slot.space
    first = int(space.start) if isinstance(space, Discrete) else None
    end = first + int(space.n) if isinstance(space, Discrete) and first is not None else 0

    def legal(observation: Any, info: Any) -> str:
        return _legal_actions(slot, observation, info)

    def start(rng: Generator) -> Player:
        def play(observation: Any, info: Any) -> Any:
            try:
                action = policy(observation, agent, info, rng)
            except (Exception, SystemExit) as error:
                raise raised(chosen, agent, error) from error
            if action is None:
                raise _returned(PolicyError, chosen, slot, action, legal(observation, info))
            if first is not None:
                is_number = type(action) is int or isinstance(action, np.integer)
                if not (first <= action < end if is_number else space.contains(action)):
                    raise _returned(ActionError, chosen, slot, action, legal(observation, info))
            return action

        return play

    return start


def raised(chosen: Chosen, player: Any, error: BaseException) -> PolicyError:
    """Error that names the policy and its agent, with the traceback as text."""
    return PolicyError(
        f"the policy {chosen.name} raised for {player!r}: {said_by(error)}",
        where=str(player),
        actual=f"\n{foreign_traceback(error)}",
        fix="fix the policy, or give the agent another one",
    )


_MOST_LEGAL: Final = 20
"""Legal actions that an error lists."""


def _legal_actions(slot: AgentSlot, observation: Any, info: Any) -> str:
    """The actions that were legal, as an error names them."""
    space = slot.space
    if not isinstance(space, Discrete):
        return f"an action of {space}"
    first, size = int(space.start), int(space.n)
    mask = reader(slot.mask)(observation, info)
    try:
        flags = None if mask is None else legal_flags(mask, size)
    except PolicyError:  # a mask that doesn't fit: which actions are legal isn't known
        flags = None
    if flags is None or not flags.any():
        return f"an action of {space}: {first} to {first + size - 1}"
    legal = (np.flatnonzero(flags) + first).tolist()
    more = f" and {len(legal) - _MOST_LEGAL} more" if len(legal) > _MOST_LEGAL else ""
    return f"an action that is legal by the mask: {', '.join(map(str, legal[:_MOST_LEGAL]))}{more}"


def _returned(
    kind: type[GamekeeperError], chosen: Chosen, slot: AgentSlot, action: Any, legal: str
) -> GamekeeperError:
    return kind(
        f"the policy {chosen.name} returned {action!r:.80} for {slot.agent!r}, which is alive"
        if action is None
        else f"the policy {chosen.name} chose {action!r:.80} for {slot.agent!r}",
        where=str(slot.agent),
        expected=legal,
        actual=f"{action!r:.80}",
        fix="return a legal action of the agent at every call",
    )
