"""Opened environments, and the sources that openers hand over."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.interface.conversion import to_aec, to_parallel

Env: TypeAlias = AECEnv[Any, Any, Any] | ParallelEnv[Any, Any, Any]

APIS: Final = ("parallel", "aec")


@dataclass(frozen=True, slots=True)
class Opened:
    """A live environment with what is needed to name it and to build it again."""

    env: Env
    """As its factory built it; converted only where another API was asked for."""
    api: str
    """`aec` or `parallel`."""
    spec: str
    """Text that opens it again; for an object, a description in angle brackets."""
    identity: dict[str, Any]
    """JSON; see `gamekeeper.interface.identity.identity_of`."""
    make: Callable[..., Env] | None
    """Builds another instance, apart from `env`, with keyword arguments on top of those given;
    None where only an object was given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Source of an environment as an opener found it: a factory, and the names it goes by."""

    kind: str
    """`id`, `module`, `file`, `factory`, `object`, or a word of the opener's own."""
    factory: Callable[..., object]
    """Called with the user's keyword arguments, once for each instance."""
    spec: str
    """Text that a reader types, without an API in front."""
    entry_point: str
    """The same without anything of this machine (a file without its folder)."""
    default_api: str | None = None
    """The API that is opened when none is asked for; None: the one of what the factory builds."""
    accepts: Callable[..., object] | None = None
    """Callable that takes the keyword arguments in the end, where `factory` takes any."""
    pip: str = ""
    """Package to install where building it needs one that is missing: `pip install X`."""
    extra: str = ""
    """The extra of the owning distribution that this environment needs."""
    is_single: bool = False
    """The factory hands out one existing instance: there is no second one."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Entries of the identity, such as the `path` of a file, beside or in place of the usual."""


class NotHereError(SpecError):
    """An opener can read the text but finds nothing under it; the next opener is asked."""


@runtime_checkable
class Opener(Protocol):
    """A way of naming environments: a module of `openers` or `foreign`, or an entry point's object.

    Optional: `ORDER`, a number (default 50; smaller is asked earlier), and `distrust(spec)`,
    which says without running anything why the environment must not be opened unasked, or None;
    without it, evidence from elsewhere can never have such an environment opened.
    """

    SYNTAX: str
    """Form in which it is typed, for messages: `module:factory`."""

    def matches(self, spec: object, /) -> bool:
        """Tells whether the text (or object) has its form, decided without looking anywhere."""

    def locate(self, spec: Any, api: str | None, /) -> Source:
        """The factory behind the text.

        Raises:
            NotHereError: there is none; the next opener is asked.
            SpecError: there is one, and it is broken.
        """


def possible_agents_of(env: Any) -> list[Any]:
    """Possible agents in a list, whatever holds them; empty where only a reset names them."""
    agents = getattr(env, "possible_agents", None)
    return [] if agents is None else list(agents)


def api_of(env: object) -> str | None:
    """`aec`, `parallel`, or None for what is no PettingZoo environment."""
    if isinstance(env, ParallelEnv):
        return "parallel"
    return "aec" if isinstance(env, AECEnv) else None


def convert(env: Env, api: str) -> Env:
    """The same environment behind the other API, or itself where it has that API already.

    Raises:
        SpecError: an AEC environment doesn't say that a round of its turns can be one tick.
    """
    return to_aec(env) if api == "aec" else to_parallel(env)
