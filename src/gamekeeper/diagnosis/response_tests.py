"""Response tests: a policy as a black box, fed with recorded observations, one field changed.

Nothing is declared and no environment steps: what an agent was given is given to its policy again,
with one field changed at one decision, and the first and the last action that differ are noted.
"""

import copy
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.diagnosis.open_setup import OpenSetup, consent_to, evidence_to_play, setup_of
from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.episodes import canonical
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.row_tables import html_text
from gamekeeper.errors import ActionError, EvidenceError, PolicyError
from gamekeeper.randomness.seeds import policy_rng
from gamekeeper.rollouts.interventions.fields import NumberField, observed_fields
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space
from gamekeeper.rollouts.interventions.value_parts import WIDEST, numbers_of, parts_of

Feed: TypeAlias = Sequence[tuple[Any, Any]]
"""Observation and info of each decision of an agent in an episode."""
FreshPlayer: TypeAlias = Callable[[int], Callable[[Any, Any], Any]]
"""From the number of a random stream to the policy as at the beginning of an episode."""

DECISIONS: Final = 50
"""Decisions of an episode that are fed at most."""
CHANGES: Final = 60
"""Feeds with one field changed, at least; more where there are many fields."""
EACH: Final = 4
"""Changes of each field."""
MOST_CHANGES: Final = 240
LASTING: Final = 24
"""Further feeds in which a change stays."""
COMMON: Final = 0.1
"""A part of the reactions that a lag has to make up, to be called one."""


@dataclass(frozen=True, slots=True)
class ResponseTest(PlainData):
    """Reactions of one agent's policy to recorded observations with one field changed.

    Attributes:
        changes: feeds with one field changed at one decision, through which the policy came.
        failures: others, at which it raised or chose no legal action; they count for nothing else.
        reactions: those of them after which some action differed.
        is_repeatable: the same feed with the same random stream gives the same actions; where it
            doesn't, nothing but `randomness` is measured.
        randomness: part of the actions that another random stream changes; 0: it draws nothing.
            Where it isn't repeatable: that differ with the same stream.
        lags: number of reactions by lag of the first action that differed, in the agent's own
            decisions.
        memory: most decisions between a change and the last action that differed.
        deaf: fields whose changes were never followed by another action.
        sensitivity: by field, the part of its changes that were.
        saturation: part of the Box numbers of its actions that stand at a bound; None: no Box.
        lasting: the same as `lags`, of changes that stay: a policy may wait until it has seen one
            for a while.
        left_over: shows that its reset leaves memory, so that feeds aren't independent; empty: no
            sign of it. Nothing that feeds were compared for is told then.
    """

    changes: int
    reactions: int
    is_repeatable: bool
    randomness: float
    lags: Mapping[int, int]
    memory: int
    deaf: tuple[str, ...]
    sensitivity: Mapping[str, float]
    saturation: float | None
    failures: int = 0
    lasting: Mapping[int, int] = field(default_factory=dict)
    left_over: str = ""

    @property
    def lag(self) -> int | None:
        """Lag that most reactions have; None where there was no reaction."""
        return max(self.lags, key=lambda lag: (self.lags[lag], -lag)) if self.lags else None

    @property
    def common_lags(self) -> tuple[int, ...]:
        """The lags that a tenth of the reactions or more have, in order."""
        total = sum(self.lags.values())
        return tuple(lag for lag, count in sorted(self.lags.items()) if count >= COMMON * total)

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**PlainData.to_json(self), "lag": self.lag, "text": str(self)}

    def _repr_html_(self) -> str:
        return html_text(str(self))

    def __str__(self) -> str:
        if self.left_over:
            return f"can't be tested: {self.left_over}"
        if not self.is_repeatable:
            return (
                "can't be tested, as it has randomness of its own: the same observations and "
                f"draws give other actions at {self.randomness:.0%} of its decisions"
            )
        if self.failures and not self.changes:
            return "chooses no legal action after any change of its observations"
        if not self.reactions and self.lasting:
            least = min(self.lasting)
            late = f", {least} decision{'s' * (least > 1)} late or more" if least else ""
            return f"reacts only to changes that stay{late}"
        if not self.reactions:
            seen = f"reacted to none of {self.changes} changes of its observations"
            return (
                f"{seen}; draws {self.randomness:.0%} of its actions" if self.randomness else seen
            )
        late = f"{self.lag} decision{'' if self.lag == 1 else 's'} late"
        lag = late if self.lag else "at once"
        said = [f"reacts {lag}"]
        if len(self.common_lags) > 1:
            said[0] += f" (from {self.common_lags[0]} to {self.common_lags[-1]})"
        if self.memory > (self.lag or 0):
            said.append(f"a change lasts for up to {self.memory} decisions")
        if self.randomness:
            said.append(f"draws {self.randomness:.0%} of its actions")
        if self.deaf:
            names = ", ".join(name.removeprefix("field ") for name in self.deaf)
            said.append(f"deaf to field{'s' * (len(self.deaf) > 1)} {names}")
        if self.failures:
            count = self.changes + self.failures
            said.append(f"chooses no legal action after {self.failures} of {count} changes")
        if self.saturation:
            said.append(f"{self.saturation:.0%} of its action's numbers stand at a bound")
        return "; ".join(said)


def feed_of(episode: Episode, agent: str, *, most: int = DECISIONS) -> list[tuple[Any, Any]]:
    """Observations and infos of an agent's decisions in a recorded episode, the first ones."""
    found: list[tuple[Any, Any]] = []
    for turn in episode.turns:
        if len(found) == most:
            break
        if agent in turn.order and agent not in turn.ended and turn.has_observation(agent):
            found.append((turn.observations[agent], turn.infos.get(agent) or {}))
    return found


def response_test(
    fresh: FreshPlayer,
    feeds: Sequence[Feed],
    *,
    fields: Sequence[NumberField],
    space: Space[Any] | None = None,
    rng: Generator,
) -> ResponseTest:
    """Feeds a policy with recorded observations, and again with one field changed at a time.

    Args:
        fresh: makes the policy new for each feed; equal streams draw the same.
        feeds: what the agent was given, an episode each.
        fields: numbers of its observation that may be changed.
        rng: draws the decisions at which a field is changed, and the values.
    """
    feeds = [feed for feed in feeds if feed]
    bases = [_fed(fresh, feed, 0) for feed in feeds]
    again = [_fed(fresh, feed, 0) for feed in feeds]
    others = [_fed(fresh, feed, 1) for feed in feeds]
    lags: Counter[int] = Counter()
    tried: Counter[str] = Counter()
    reacted: Counter[str] = Counter()
    memory, failures, is_repeatable = 0, 0, _keys(bases) == _keys(again)
    for one, number, at, changed in _changes(feeds, fields, rng) if is_repeatable else ():
        base = bases[number]
        try:
            differing = _differing(base, _fed(fresh, changed, 0))
        except (ActionError, PolicyError):  # no observation of the environment's, so no fault
            failures += 1
            continue
        if differing and differing[0] < at:  # before the change, so by what earlier feeds left
            left_over = (
                f"its reset leaves memory: decision {differing[0]} came out otherwise in a feed "
                f"that differs from decision {at} on"
            )
            return ResponseTest(0, 0, False, 0.0, {}, 0, (), {}, None, left_over=left_over)
        tried[str(one)] += 1
        if differing:
            lags[differing[0] - at] += 1
            memory = max(memory, differing[-1] - at)
            reacted[str(one)] += 1
    pairs = list(zip(bases, others if is_repeatable else again, strict=True))
    decisions = max(sum(len(base) for base in bases), 1)
    return ResponseTest(
        changes=tried.total(),
        reactions=reacted.total(),
        is_repeatable=is_repeatable,
        randomness=sum(len(_differing(*pair)) for pair in pairs) / decisions,
        lags=dict(sorted(lags.items())),
        memory=memory,
        deaf=tuple(name for name in tried if not reacted[name]),
        sensitivity={name: reacted[name] / count for name, count in tried.items()},
        saturation=_saturation([action for base in bases for action in base], space),
        failures=failures,
        lasting=_lasting(fresh, feeds, bases, fields, rng) if is_repeatable else {},
    )


def _lasting(
    fresh: FreshPlayer,
    feeds: Sequence[Feed],
    bases: Sequence[Sequence[Any]],
    fields: Sequence[NumberField],
    rng: Generator,
) -> dict[int, int]:
    """Lags of the first reactions to changes that stay."""
    lags: Counter[int] = Counter()
    for one, number, at, changed in _changes(feeds, fields, rng)[:LASTING]:
        value = one.read(changed[at][0])
        rest = [(seen if value is None else one.write(seen, value), i) for seen, i in changed[at:]]
        try:
            differing = _differing(bases[number], _fed(fresh, [*changed[:at], *rest], 0))
        except (ActionError, PolicyError):
            continue
        if differing and differing[0] >= at:
            lags[differing[0] - at] += 1
    return dict(sorted(lags.items()))


def _fed(fresh: FreshPlayer, feed: Feed, stream: int) -> list[Any]:
    """Actions that the policy chooses when it is given a feed."""
    player = fresh(stream)
    return [player(observation, info) for observation, info in feed]


def _changes(
    feeds: Sequence[Feed], fields: Sequence[NumberField], rng: Generator
) -> list[tuple[NumberField, int, int, Feed]]:
    """Feeds with one field changed at one decision, the fields in turn."""
    if not fields or not feeds:
        return []
    count = min(max(CHANGES, EACH * len(fields)), MOST_CHANGES)
    if len(fields) > count:
        fields = [fields[int(place)] for place in rng.choice(len(fields), count, replace=False)]
    pool = {field: _values(feeds, field) for field in fields}
    found: list[tuple[NumberField, int, int, Feed]] = []
    for place in range(count):
        field, number = fields[place % len(fields)], int(rng.integers(len(feeds)))
        feed = list(feeds[number])
        at = int(rng.integers(len(feed)))  # late changes see less of a lag; early ones make up
        observation, info = feed[at]
        value = field.read(observation)
        other = None if value is None else _other(pool[field], value, field, rng)
        if other is not None:
            feed[at] = (field.write(observation, other), info)
            found.append((field, number, at, feed))
    return found


def _values(feeds: Sequence[Feed], field: NumberField) -> NDArray[np.float64]:
    read = [field.read(observation) for feed in feeds for observation, _ in feed]
    return np.unique([value for value in read if value is not None])


def _other(
    pool: NDArray[np.float64], value: float, field: NumberField, rng: Generator
) -> float | None:
    """Another value: at every other time one that was recorded, else any between the bounds.

    Runs that fail may hold one value for ever. Without bounds: a span more on both sides.
    """
    others = pool[pool != value]
    if others.size and rng.random() < 0.5:
        return float(others[int(rng.integers(others.size))])
    low, high = field.low, field.high
    if not (np.isfinite([low, high]).all() and high - low <= WIDEST):
        span = max(float(pool[-1] - pool[0]), 1.0)
        low, high = max(low, float(pool[0]) - span), min(high, float(pool[-1]) + span)
    if field.is_whole:
        whole = int(rng.integers(int(low), int(high) + 1))
        return float(whole) if whole != value else None
    return float(rng.uniform(low, high))


def _differing(one: Sequence[Any], two: Sequence[Any]) -> list[int]:
    """Decisions at which the actions differ."""
    pairs = zip(map(_key, one), map(_key, two), strict=True)
    return [at for at, (a, b) in enumerate(pairs) if a != b]


def _keys(actions: Sequence[Sequence[Any]]) -> list[list[Any]]:
    return [[_key(action) for action in each] for each in actions]


def _key(action: Any) -> Any:
    """Equal for equal actions, whatever holds their numbers."""
    if isinstance(action, int | np.integer):
        return int(action)
    if isinstance(action, np.ndarray | float | np.floating):
        return np.asarray(action, np.float64).tobytes()
    return json.dumps(canonical.to_json(action))


def _saturation(actions: Sequence[Any], space: Space[Any] | None) -> float | None:
    """Part of the Box numbers that stand at a declared bound."""
    parts = [] if space is None else [p for p in parts_of(space) if isinstance(p.space, Box)]
    numbers = [each for each in numbers_of(parts) if each.is_bounded.all()]
    read = [(each, each.read(action)) for each in numbers for action in actions]
    at_bound = [
        (found <= each.low) | (found >= each.high) for each, found in read if found is not None
    ]
    return float(np.concatenate(at_bound).mean()) if at_bound else None


FEEDS: Final = 3
"""Episodes that are fed."""


def responses(
    run: str | PathLike[str] | Evidence,
    *,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    seed: int = 0,
    allow_import: bool = False,
) -> dict[str, ResponseTest]:
    """Response tests of the policies of a run: lag, own randomness, memory, deaf fields.

    Each policy is fed with the observations that its agent was given in the first recorded
    episodes, and again with one field changed at one decision. The environment is opened for its
    spaces; it takes no step.

    Args:
        run: the folder of a run of level `full`, or evidence.
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        seed: of the changes and of the policies' draws.
        allow_import: run code that the evidence names.
    Returns:
        By agent; without those that no observations were recorded of.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies, or holds no observations.
        RunError: there is no run.
        PolicyError: a policy can't be found, or raised.
    """
    evidence = evidence_to_play(run, env=env, allow_import=allow_import)
    setup = setup_of(evidence, env=env, policies=policies)
    episodes = [episode for _, episode in zip(range(FEEDS), evidence.episodes, strict=False)]
    consent = consent_to(evidence, setup, env=env, policies=policies, allow_import=allow_import)
    with consent, OpenSetup(setup, evidence.contract) as open_setup:
        agents = [agent_name(agent) for agent in evidence.manifest.get("agents") or ()]
        found = responses_of(open_setup, episodes, agents, seed=seed)
    if not found:
        raise EvidenceError(
            "no observation of a decision was recorded",
            where=evidence.name,
            expected="a run of level full",
            fix="play it again into one: gamekeeper expand RUN OUT",
        )
    return found


def responses_of(
    open_setup: OpenSetup, episodes: Sequence[Episode], agents: Iterable[str], *, seed: int
) -> dict[str, ResponseTest]:
    """Response tests of the policies of an opened set-up, by agent."""
    found: dict[str, ResponseTest] = {}
    for name in agents:
        feeds = [feed for episode in episodes if (feed := feed_of(episode, name))]
        space = observation_space(open_setup.env, name)
        if feeds and space is not None:
            found[name] = response_test(
                _fresh(open_setup, name, seed),
                feeds,
                fields=observed_fields(open_setup.contract, name, space),
                space=action_space(open_setup.env, name),
                rng=np.random.default_rng([13, seed]),
            )
    return found


def actions_fed(open_setup: OpenSetup, agent: str, feeds: Iterable[Feed]) -> list[list[Any]]:
    """Actions that an agent's policy chooses when it is given feeds; equal for equal actions."""
    player = open_setup.joint_policy.apart
    rng = policy_rng(0, 0, "feeds")  # the same for each agent
    return _keys(
        [_fed(lambda stream: player(agent, copy.deepcopy(rng)), feed, 0) for feed in feeds]
    )


def _fresh(open_setup: OpenSetup, agent: str, seed: int) -> FreshPlayer:
    return lambda stream: open_setup.joint_policy.apart(agent, policy_rng(seed, stream, agent))
