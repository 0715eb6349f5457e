"""Specification of an evaluation: environments, policies, seeds, comparisons."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

from gamekeeper.contract import Contract

EPISODES: Final = 100
"""Default; enough for the intervals of one checkpoint."""
LEVEL: Final = 0.95
MOST_CELLS: Final = 2_000
"""Line-ups of an environment beyond which cross-play is refused rather than played for days."""
EVERYONE: Final = "*"


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentSpec:
    """An environment that policies are evaluated in.

    Attributes:
        spec: what opens it.
        options: of every reset.
        contract: in place of the one beside it; a path, or a contract.
        success: conditions by scope (`team`, a role, `agent`) under which an episode succeeded;
            empty: where none of the contract's `[failure]` holds.
        most_turns: longer episodes are cut; None: as recordings do.
        team: whether a sum over all agents means something; None: unless a reward is zero-sum, or
            returns add up to one number in every episode.
        failed_return: return of each agent in an episode that an exception broke off; None: none.
        score: the team's returns that count as 0 and as 1, so that environments share a scale.
        version, digest: pinned; another environment is refused.
    """

    spec: Any
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] | None = None
    contract: str | Contract | None = None
    success: Mapping[str, str] = field(default_factory=dict)
    most_turns: int | None = None
    team: bool | None = None
    failed_return: float | None = None
    score: tuple[float, float] | None = None
    version: str | None = None
    digest: str | None = None


Choices = Mapping[str, Any]
"""Policies by agent, by role, or under `*` for all others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySpec:
    """A policy: one checkpoint, or a method, of which there are several training runs.

    Attributes:
        runs: the choices of each run; one where it is no method.
        is_method: claims are about the method, and its training runs are the unit.
        environments: other runs for environments by name.
        files: files whose bytes count in its digests.
        version: as its author calls it; noted.
        digests: pinned, one a run; another policy is refused.
        curve: name of the learning curve that it is a point of; None: of none.
        step: training steps after which it was saved; None without a curve.
    """

    runs: tuple[Choices, ...] = ()
    is_method: bool = False
    environments: Mapping[str, tuple[Choices, ...]] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    version: str | None = None
    digests: tuple[str, ...] = ()
    curve: str | None = None
    step: int | None = None

    def runs_in(self, environment: str) -> tuple[Choices, ...]:
        """The runs that play in an environment; none where it doesn't play there."""
        return self.environments.get(environment, self.runs)


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossplaySpec:
    """Policies that meet partners they weren't trained with.

    Attributes:
        roles: the positions, by environment or under `*`: roles, agents, or `*` for all others.
        partners: names of the policies that others are paired with; empty: all of them.
        sample: of a method's runs, with how many each run is paired; None: with all.
    """

    enabled: bool = False
    roles: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    partners: tuple[str, ...] = ()
    sample: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StopSpec:
    """Playing until an interval is narrow enough.

    Attributes:
        metric: as results name it: `return`, `success`, `reward.TERM`, `info.FIELD`.
        who: the team, a role, or an agent.
        width: of the interval of every policy, at most.
        most: episodes beyond which nothing more is played.
        every: episodes of a round.
    """

    metric: str = "return"
    who: str = "team"
    width: float = 0.0
    most: int = 1_000
    every: int = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """An evaluation, whole.

    Attributes:
        suite: its id and version where it is one that others cite.
        seed: of the run; settles every episode's and every policy's draws.
        episodes: numbers 0 to episodes - 1, the same for everybody.
        compare: pairs of names; None: all pairs.
        stop: playing on until it is known well enough.
        infos: fields of the last infos that are metrics too.
        terms: reward terms that are metrics; None: all.
        unit: `auto`, `episode` or `run`.
        record: `digest` or `full`: evidence is kept beside the results; None: none.
        folder: where paths in it are looked for first; no part of its value.
    """

    name: str = "evaluation"
    suite: tuple[str, str] | None = None
    environments: Mapping[str, EnvironmentSpec] = field(default_factory=dict)
    policies: Mapping[str, PolicySpec] = field(default_factory=dict)
    seed: int = 0
    episodes: int = EPISODES
    compare: tuple[tuple[str, str], ...] | None = None
    crossplay: CrossplaySpec = field(default_factory=CrossplaySpec)
    stop: StopSpec | None = None
    infos: tuple[str, ...] = ()
    terms: tuple[str, ...] | None = None
    unit: str = "auto"
    level: float = LEVEL
    record: str | None = None
    folder: str | None = field(default=None, compare=False)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The policies that are compared, each pair once; of a learning curve its last point."""
        if self.compare is not None:
            return self.compare
        last = [points[max(points)] for points in self.curves.values()]
        names = [name for name, each in self.policies.items() if not each.curve or name in last]
        return tuple((a, b) for k, a in enumerate(names) for b in names[k + 1 :])

    @property
    def curves(self) -> dict[str, dict[int, str]]:
        """Names of the policies of each learning curve, by their training steps, ascending."""
        found: dict[str, dict[int, str]] = {}
        for name, policy in self.policies.items():
            if policy.curve is not None and policy.step is not None:
                found.setdefault(policy.curve, {})[policy.step] = name
        return {curve: dict(sorted(points.items())) for curve, points in found.items()}

    def to_json(self) -> dict[str, Any]:
        """Plain data without what stands at its default; objects in memory as their text."""
        found: dict[str, Any] = plain_of(self)
        return found


def plain_of(value: Any) -> Any:
    """A part of a spec as plain data, without what stands at its default."""
    if isinstance(value, Contract):
        return value.to_json()
    if hasattr(value, "__dataclass_fields__"):
        usual = type(value)(**({"spec": None} if isinstance(value, EnvironmentSpec) else {}))
        return {
            each.name: plain_of(getattr(value, each.name))
            for each in fields(value)
            if each.compare and getattr(value, each.name) != getattr(usual, each.name)
        }
    if isinstance(value, Mapping):
        return {str(key): plain_of(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_of(item) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    named = value if hasattr(value, "__qualname__") else type(value)
    return f"<{named.__module__}.{named.__qualname__}>"
