"""Policies by what a user names: a word, a callable in a module or a file, a callable."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeAlias

from numpy.random import Generator

from gamekeeper import plugins
from gamekeeper.errors import PolicyError, SpecError
from gamekeeper.game.casting.seat import SeatedPolicy
from gamekeeper.game.opening.construct import foreign, nearest
from gamekeeper.game.opening.identity import source_digest
from gamekeeper.game.opening.load import load_file, load_module, split_file

GROUP: Final = "gamekeeper.policies"
SCHEMES: Final = "gamekeeper.schemes"
"""Entry points by the word before a policy's colon; each is a `Scheme`."""
_PACKAGE: Final = "gamekeeper.game.policies"
EVERYONE: Final = "*"
"""Whom a choice is for that names neither an agent nor a role."""
_FORMS: Final = "module:callable, file.py:callable, or a Python callable"
_CALL: Final = "(observation, agent, info, rng)"


class Policy(Protocol):
    """What chooses actions: any callable of this form, called once a turn for each of its agents.

    Optional: `version`, a text kept with the evidence; `reset(seed)`, called before each episode
    with a whole number in [0, 2**31) that depends on the run's seed, the episode and whom it plays.
    All randomness should come from `rng`, a stream of the agent's own for the episode.
    """

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> Any:
        """The action of a live agent; never None."""


Choice: TypeAlias = "str | Policy | Chosen"
Scheme: TypeAlias = Callable[[str], Policy]
"""From what stands behind a scheme's colon to a policy: `sb3:model.zip`."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A policy that was found, and what evidence says of it."""

    name: str
    """What a user types to have it again; for a callable in memory its module and name."""
    version: str | None
    """A built-in's version, the policy's own `version`, or else the digest of its source."""
    policy: Policy | SeatedPolicy


def resolve(choice: Choice, *, schemes: Mapping[str, Scheme] | None = None) -> Chosen:
    """The policy behind a user's choice. A class is made into one instance, without arguments.

    Args:
        choice: `random`, `first-legal`, `noop`, `module:callable`, `file.py:callable`, or a
            callable.
        schemes: further forms by the word before their colon, beside those that entry points
            bring (`sb3:model.zip`).

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
            load: Any = (schemes or {}).get(scheme) or plugins.one(SCHEMES, scheme)
            policy = None if load is None else load(rest)
        if policy is not None:
            return _checked(name, policy)
    if not colon or not rest:
        raise _no_policy(name, [*built_ins, *(f"{one}:..." for one in schemes or {})])
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


def _no_policy(name: str, words: Iterable[str]) -> PolicyError:
    return PolicyError(
        f"there is no policy called {name!r}{nearest(name, words)}",
        expected=", ".join([*words, _FORMS]),
        seen=repr(name),
    )


def distrust_policy(name: str) -> str | None:
    """Why evidence may not have a policy run unasked; None for a bare word.

    A word is a policy that Gamekeeper brings, or one of the environment's own (`reference`), which
    is trusted as far as the environment is; only a name with a colon can lead anywhere else.
    """
    return None if ":" not in name else f"the policy {name!r} is code that evidence names"


def parse_choices(texts: Iterable[str]) -> dict[str, str]:
    """Choices by agent, by role, or under `*`, from any number of `[AGENT|ROLE=]X`.

    Raises:
        PolicyError: a text is empty, or two of them are for the same players.
    """
    choices: dict[str, str] = {}
    for text in texts:
        whom, equals, name = text.partition("=")
        if not equals or any(mark in whom for mark in ":/\\"):  # the = of a path or of an argument
            whom, name = EVERYONE, text
        whom, name = whom.strip(), name.strip()
        if not whom or not name:
            raise PolicyError(
                "a policy is incomplete", expected="[AGENT|ROLE=]POLICY", seen=repr(text)
            )
        if whom in choices:
            raise PolicyError(
                f"two policies for {'everyone' if whom == EVERYONE else whom}",
                expected="one",
                seen=f"{choices[whom]!r} and {name!r}",
            )
        choices[whom] = name
    return choices


def _built_ins() -> dict[str, SeatedPolicy]:
    found = plugins.load(GROUP, _PACKAGE).found
    return {
        n.replace("_", "-"): part for n, part in found.items() if isinstance(part, SeatedPolicy)
    }


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
    if isinstance(policy, SeatedPolicy):
        return Chosen(name, policy.VERSION, policy)
    if not callable(policy):
        raise PolicyError(
            f"{name} can't be called",
            where="policies",
            expected=f"a callable {_CALL}",
            seen=type(policy).__qualname__,
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
            seen=f"{getattr(policy, '__qualname__', name)}{signature}",
            mend="take these four arguments, in this order",
        ) from None
    version = getattr(policy, "version", None)
    return Chosen(name, source_digest([policy]) if version is None else str(version), policy)


@contextlib.contextmanager
def _as_policy_error(name: str) -> Iterator[None]:
    try:
        with foreign(f"loading the policy {name}", where=name):
            yield
    except SpecError as error:
        raise PolicyError(
            error.what,
            where=error.where,
            expected=error.expected,
            seen=error.seen,
            mend=error.mend,
        ) from error
