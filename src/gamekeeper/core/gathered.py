"""What an audit has gathered: plays, twins and facts by probe, for checks to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from gamekeeper.core.contract.agent_spec import AgentSpec
from gamekeeper.core.divergence import Comparison, Divergence, compare
from gamekeeper.core.fact import Fact
from gamekeeper.core.trace import Trace


@dataclass(frozen=True, slots=True)
class Twin:
    """A play and the same with one thing done differently.

    Attributes:
        base: the play as it was.
        sham: the same once more with nothing changed; what differs here is nobody's doing.
        trace: the play with the change.
        change: what was changed, as plain data, its kind under `change`.
        volatile: fields of infos that may differ between equal plays.
    """

    base: Trace
    sham: Trace
    trace: Trace
    change: Mapping[str, Any]
    volatile: tuple[str, ...] = ()
    _cache: dict[str, Comparison] = field(default_factory=dict, repr=False, compare=False)

    @property
    def noise(self) -> Divergence | None:
        """Where the sham parts from its base: the change can't be blamed for more than that."""
        return self._compared("sham", self.sham)

    @property
    def divergence(self) -> Divergence | None:
        """Where the changed play parts from its base."""
        return self._compared("twin", self.trace)

    def _compared(self, name: str, other: Trace) -> Divergence | None:
        if name not in self._cache:
            self._cache[name] = compare(self.base, other, volatile=self.volatile)
        return self._cache[name].divergence


@dataclass(frozen=True, slots=True)
class Look:
    """What one play of a probe came to."""

    traces: tuple[Trace, ...] = ()
    twins: tuple[Twin, ...] = ()
    facts: tuple[Fact, ...] = ()


@dataclass(frozen=True, slots=True)
class Gathered:
    """All that probes saw of one environment.

    Attributes:
        api: `aec` or `parallel`.
        agents: what is known of each possible agent, its spaces as the environment gave them.
        looks: by probe, a look for each of its plays.
        unseen: probes that couldn't look, and why.
    """

    api: str
    agents: Mapping[str, AgentSpec] = field(default_factory=dict)
    looks: Mapping[str, tuple[Look, ...]] = field(default_factory=dict)
    unseen: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, probe: str) -> tuple[Trace, ...]:
        """The traces of a probe; none where it didn't run."""
        return tuple(trace for look in self.looks.get(probe, ()) for trace in look.traces)

    def twins(self, probe: str) -> Iterator[Twin]:
        """The twins of a probe."""
        for look in self.looks.get(probe, ()):
            yield from look.twins

    def facts(self, probe: str, *names: str) -> Iterator[Fact]:
        """The facts of a probe; with `names` only those."""
        for look in self.looks.get(probe, ()):
            for fact in look.facts:
                if not names or fact.name in names:
                    yield fact
