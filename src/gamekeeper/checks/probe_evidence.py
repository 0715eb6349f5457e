"""Evidence of an audit: facts, episodes and counterfactuals by probe, for checks to read."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from gamekeeper.checks.case import Reproducer
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.episodes.divergence import Comparison, Divergence, compare
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.where import Where

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True)
class Fact(Generic[Kind]):
    """Observation of a probe that is no turn: an exception, a changed array, a time, a frame.

    Attributes:
        where: the episode, and as far as there is one the turn, the agent and the field.
        value: of a frozen class in `checks/facts/`; a check decides what it means.
        proof: how a reader sees it again, where the probe knows better than the check.
    """

    where: Where
    value: Kind
    proof: Reproducer | None = None


@dataclass(frozen=True, slots=True)
class ProbeDeath:
    """Death or hang of a probe's process, in words."""

    text: str


@dataclass(frozen=True, slots=True)
class ProbeCounterfactual:
    """An episode and the same with one thing done differently.

    Attributes:
        base: the episode as it was.
        unchanged_rerun: the same once more with nothing changed; what differs here is nobody's
            doing.
        episode: the episode with the change.
        change: what was changed, as plain data, its kind under `change`.
        volatile: fields of infos that may differ between equal plays.
    """

    base: Episode
    unchanged_rerun: Episode
    episode: Episode
    change: Mapping[str, Any]
    volatile: tuple[str, ...] = ()
    _cache: dict[str, Comparison] = field(default_factory=dict, repr=False, compare=False)

    @property
    def noise(self) -> Divergence | None:
        """First divergence of the unchanged rerun: the change isn't to blame for what follows."""
        return self._compared("unchanged_rerun", self.unchanged_rerun)

    @property
    def divergence(self) -> Divergence | None:
        """First divergence of the changed rerun from its base."""
        return self._compared("counterfactual", self.episode)

    def _compared(self, name: str, other: Episode) -> Divergence | None:
        if name not in self._cache:
            self._cache[name] = compare(self.base, other, volatile=self.volatile)
        return self._cache[name].divergence


@dataclass(frozen=True, slots=True)
class ProbeRun:
    """Result of one rerun by a probe."""

    episodes: tuple[Episode, ...] = ()
    counterfactuals: tuple[ProbeCounterfactual, ...] = ()
    facts: tuple[Fact[Any], ...] = ()

    def fact(self, kind: type[Kind]) -> Fact[Kind] | None:
        """The first fact of this kind; None where there is none."""
        return next((fact for fact in self.facts if isinstance(fact.value, kind)), None)


@dataclass(frozen=True, slots=True)
class ProbeEvidence:
    """All that probes saw of one environment.

    Attributes:
        api: `aec` or `parallel`.
        agents: what is known of each possible agent, its spaces as the environment gave them.
        looks: by probe, a look for each of its plays.
        not_exercised: probes that couldn't look, and why.
        blind: reason why no two episodes can be compared; empty where they can.
    """

    api: str
    agents: Mapping[str, AgentSpec] = field(default_factory=dict)
    looks: Mapping[str, tuple[ProbeRun, ...]] = field(default_factory=dict)
    not_exercised: Mapping[str, str] = field(default_factory=dict)
    blind: str = ""
    _facts: dict[type, list[Fact[Any]]] = field(
        init=False, default_factory=dict, repr=False, compare=False
    )

    def __getitem__(self, probe: str) -> tuple[Episode, ...]:
        """The episodes of a probe; none where it didn't run."""
        return tuple(episode for look in self.looks.get(probe, ()) for episode in look.episodes)

    def counterfactuals(self, probe: str) -> Iterator[ProbeCounterfactual]:
        """The counterfactuals of a probe."""
        for look in self.looks.get(probe, ()):
            yield from look.counterfactuals

    def facts(self, kind: type[Kind]) -> Sequence[Fact[Kind]]:
        """The facts of a kind, probe by probe."""
        if not self._facts:  # sorted once: some hundred checks ask, and probes leave thousands
            for look in (each for looks in self.looks.values() for each in looks):
                for fact in look.facts:
                    self._facts.setdefault(type(fact.value), []).append(fact)
        return self._facts.get(kind, ())
