"""Probes and their decorator: a probe is a schedule of episodes, and a function that looks at one.

`look` is asked again with shorter plays (of scripted actions) to find the shortest way to see
something again, so it may depend on nothing but its play.
"""

import inspect
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

from gamekeeper import plugins
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.errors import EvidenceError
from gamekeeper.rollouts.episode_loop import EpisodePlan

GROUP: Final = "gamekeeper.probes"
PACKAGE: Final = "gamekeeper.auditing.probes"

Watcher: TypeAlias = Callable[[ProbeSession, EpisodePlan], Iterator[Saw]]


@dataclass(frozen=True, slots=True)
class Probe:
    """A schedule of episodes that lets promises be seen to hold or break.

    Attributes:
        name: checks name it in `needs`.
        about: what it does, and the facts that it yields; Markdown.
        share: of the budget, beside the shares of the others.
        look: yields a fact, `Counterfactual` or `Episode` for all that it saw in one episode.
        api: `aec` or `parallel` where it is for one of them only.
        fresh: needs more than one instance.
        against: says why it can't look here; None where it can.
        tries: shorter plays that are tried for one finding; None: as many as of any other.
        on_top: part of the budget that it may take in addition, in place of a share.
    """

    name: str
    about: str
    share: float
    look: Watcher
    plays: Callable[[ProbeSession], Iterator[EpisodePlan]]
    api: str | None
    fresh: bool
    against: Callable[[ProbeSession], str | None] | None
    tries: int | None
    on_top: float = 0.0

    def reason_against(self, session: ProbeSession) -> str | None:
        """Says why it can't look at this environment; None where it can."""
        if self.api is not None and self.api != session.api:
            return f"only for {'AEC' if self.api == 'aec' else 'Parallel'} environments"
        if self.fresh and not session.can_make:
            return "a second instance is needed, and only an object was handed over"
        return None if self.against is None else self.against(session)


def probe(
    name: str,
    *,
    share: float,
    plays: Callable[[ProbeSession], Iterator[EpisodePlan]] = lambda session: session.plays(3),
    api: str | None = None,
    fresh: bool = False,
    against: Callable[[ProbeSession], str | None] | None = None,
    tries: int | None = None,
    on_top: float = 0.0,
) -> Callable[[Watcher], Probe]:
    """Makes a probe of a function that looks at one episode; the arguments are `Probe`'s."""

    def made(look: Watcher) -> Probe:
        about = inspect.cleandoc(look.__doc__ or "")
        return Probe(name, about, share, look, plays, api, fresh, against, tries, on_top)

    return made


def probes(names: Collection[str] | None = None) -> dict[str, Probe]:
    """The probes of these names, or all: built-in ones and those of installed distributions.

    Raises:
        EvidenceError: there is no such probe.
    """
    found = plugins.load(GROUP, PACKAGE).parts(Probe)
    known = {each.name: each for _, each in found}
    wanted = set(known if names is None else names)
    missing = sorted(wanted - known.keys())
    if missing:
        raise EvidenceError(
            f"a check needs a probe that isn't there: {', '.join(missing)}",
            where=GROUP,
            expected=", ".join(sorted(known)),
            fix="install the package that brings the probe, or name one of these",
        )
    return {name: known[name] for name in sorted(wanted)}
