"""Playing on from a recorded turn with one agent's action or policy changed.

On the recorded draws there is one future: a counterfactual, which can be recorded. On fresh draws
there are many; each is played twice from the same numbers, as it was and as changed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.diagnosis.open_setup import Setup, consent_to, evidence_to_play, setup_of
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError, GamekeeperError
from gamekeeper.interface.policy import shared_with
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs import own_runs
from gamekeeper.runs.consent import evidence_of
from gamekeeper.runs.expanding import OWN_RULES
from gamekeeper.runs.load_run import load
from gamekeeper.runs.standing import choices_in
from gamekeeper.runs.worker_errors import error_in
from gamekeeper.statistics.one_sample import one_sample
from gamekeeper.statistics.paired import paired_effect
from gamekeeper.statistics.significance import wilson

MOST_FUTURES: Final = 256
BUDGET: Final = 1_000_000
"""Env steps of a call; no future begins once they were taken."""
SILENCE_S: Final = 60.0
LIMIT_S: Final = 600.0
MOST_LISTED: Final = 200
"""Actions of a space that are offered by number."""
BUILT_IN: Final = ("random", "first-legal", "noop")
TASK: Final = "gamekeeper.diagnosis.play_on_tasks:play_on_task"

Progress = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchPoint:
    """A turn of a recorded episode, and the one thing that is done otherwise from there.

    Attributes:
        episode: its number.
        turn: env steps that are played as recorded.
        agent: whose action or policy is changed.
        action: its action at that turn, as plain data; None: the policy is changed.
        policy: its policy from that turn on; None: the action is changed.
    """

    episode: int
    turn: int
    agent: str
    action: Any = None
    policy: str | None = None

    def __post_init__(self) -> None:
        if (self.action is None) == (self.policy is None):
            raise EvidenceError(
                "exactly one thing can be changed: an action or a policy",
                where=f"episode {self.episode}, turn {self.turn}, {self.agent}",
                expected="an action, or the name of a policy",
                actual="neither" if self.action is None else "both",
                fix="name one of them",
            )

    def __str__(self) -> str:
        if self.policy is not None:
            return f"{self.agent} played by {self.policy} from turn {self.turn} on"
        return f"{self.agent} does {self.action} at turn {self.turn}"


@dataclass(frozen=True, slots=True)
class FutureArm:
    """Futures of one arm, in the order of their numbers.

    Attributes:
        numbers: from which each drew.
        returns: of each agent.
        turns: env steps of each.
        paths: sum of all returns, from the turn on, as [turn, value]; thinned out to 120 points.
        failed: by the contract; empty where it declares no failure, or lacks a figure.
        errors: exceptions that ended futures.
    """

    numbers: tuple[int, ...]
    returns: Mapping[str, tuple[float, ...]]
    turns: tuple[int, ...]
    paths: tuple[tuple[tuple[int, float], ...], ...]
    failed: tuple[bool, ...] = ()
    errors: tuple[str, ...] = ()

    @property
    def team(self) -> tuple[float, ...]:
        """Sum of all returns of each future."""
        return tuple(map(sum, zip(*self.returns.values(), strict=True)))


@dataclass(frozen=True, slots=True)
class Futures:
    """Outcomes of futures, as it was and as changed.

    Attributes:
        branch: the turn and the change.
        asked: number of futures that were asked for; fewer were played where the budget ended.
        steps: env steps that were taken.
        as_recorded: arm without the change.
        changed: arm with it.
    """

    branch: BranchPoint
    asked: int
    steps: int
    as_recorded: FutureArm
    changed: FutureArm

    def to_json(self) -> dict[str, Any]:
        """Plain data, with intervals of the sum of all returns, of each agent's, and of failures.

        An interval is null where there are too few futures for one, or where they don't differ.
        """
        arms = {"as_recorded": self.as_recorded, "changed": self.changed}
        agents = list(self.as_recorded.returns)
        return {
            "branch": asdict(self.branch),
            "text": str(self.branch),
            "asked": self.asked,
            "steps": self.steps,
            "arms": {name: {**asdict(arm), "team": arm.team} for name, arm in arms.items()},
            "team": self._compared([arm.team for arm in arms.values()]),
            "agents": {
                agent: self._compared([arm.returns.get(agent, ()) for arm in arms.values()])
                for agent in agents
            },
            "failed": {
                name: asdict(wilson(sum(arm.failed), len(arm.failed))) if arm.failed else None
                for name, arm in arms.items()
            },
        }

    @staticmethod
    def _compared(values: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Median of each arm, mean of the paired difference, with intervals where there are any."""
        rng, (base, changed) = np.random.default_rng(0), map(np.asarray, values)
        found: dict[str, Any] = {}
        for name, each in (("as_recorded", base), ("changed", changed)):
            found[name] = _interval(
                partial(one_sample, each, statistic="median", rng=rng), np.median, each
            )
        if len(base) == len(changed):
            found["difference"] = _interval(
                partial(paired_effect, base, changed, rng=rng, is_share=False),
                np.mean,
                changed - base,
            )
        return found


def _interval(
    estimate: Callable[[], Any], plain: Callable[[Any], Any], values: Any
) -> dict[str, Any]:
    """An estimate with its interval; the plain figure, and the reason, where there is none."""
    n = len(values)
    try:
        found = estimate()
    except EvidenceError as error:
        value = float(plain(values)) if n else None
        return {"value": value, "low": None, "high": None, "n": n, "why": error.what}
    return {"value": found.value, "low": found.low, "high": found.high, "n": n, "why": ""}


@dataclass(frozen=True, slots=True)
class Offered:
    """Possible changes of one agent.

    Attributes:
        policies: names of those that may play it.
        actions: all of a small Discrete space; empty: an action is written as JSON.
        space: its action space, as text.
    """

    policies: tuple[str, ...]
    actions: tuple[int, ...]
    space: str


@dataclass(frozen=True, slots=True)
class PlayOnOptions:
    """Consent and limits of playing on.

    Attributes:
        allow_import: run code that the evidence names.
        tried: policies that the user named, which may be chosen beside the run's and the built-in.
        policies: that go on in place of the recorded ones, by agent, role or under `*`.
        budget: env steps of a call.
        silence_s: longest time without a step.
        limit_s: longest time of a call.
        stop: once set, ends the call.
    """

    allow_import: bool = False
    tried: tuple[str, ...] = ()
    policies: Mapping[str, str] = field(default_factory=dict)
    budget: int = BUDGET
    silence_s: float = SILENCE_S
    limit_s: float = LIMIT_S
    stop: Event | None = None


def futures(
    run: str | PathLike[str] | Evidence,
    branch: BranchPoint,
    *,
    count: int = 64,
    seed: int = 0,
    options: PlayOnOptions | None = None,
    on_message: Progress | None = None,
) -> Futures:
    """Plays futures of a recorded turn on fresh draws, as it was and with one thing changed.

    Both arms draw from the same numbers. Where an action is changed, the other agents do at that
    turn what they did; from the next turn on every policy chooses. The environment runs in a
    process of its own.

    Args:
        run: the folder of a run, or evidence that was loaded from one.
        branch: the turn and the change.
        count: futures of each arm, at most `MOST_FUTURES`.
        seed: of the draws.
        on_message: called with `{"played", "of"}`.
    Raises:
        TrustError: the run names code that nobody allowed to run.
        EvidenceError: there is no such episode, turn or agent, or the episode doesn't replay.
        ActionError: the action isn't legal there.
        EnvError: the environment hangs, or ended its process.
    """
    if not 1 <= count <= MOST_FUTURES:
        raise EvidenceError(
            "so many futures can't be played at once",
            where="futures",
            expected=f"from 1 to {MOST_FUTURES}",
            actual=str(count),
            fix="ask for fewer",
        )
    draws = np.random.default_rng([29, seed]).choice(1 << 31, size=count, replace=False)
    known = options or PlayOnOptions()
    extra = {"numbers": draws.tolist(), "budget": known.budget}
    answer, _ = _in_worker("futures", run, branch, known, extra, on_message)
    arms = {name: FutureArm(**frozen(answer[name])) for name in ("as_recorded", "changed")}
    return Futures(branch, count, answer["steps"], **arms)


def record_future(
    run: str | PathLike[str] | Evidence,
    branch: BranchPoint,
    out: str | PathLike[str],
    *,
    number: int | None = None,
    options: PlayOnOptions | None = None,
) -> bool:
    """Records one future as a run of one episode, and tells if it replays.

    Args:
        run, branch: as of `futures`.
        out: the folder of the new run.
        number: of a future on fresh draws; None: everything goes on drawing as in the recording.
    Raises:
        GamekeeperError: as `futures`.
        RunError: `out` can't be written.
    """
    extra = {"number": number, "out": str(Path(out).absolute())}
    answer, rule = _in_worker("record", run, branch, options or PlayOnOptions(), extra, None)
    if rule not in OWN_RULES:
        own_runs.forget(load(out).root)
    return bool(answer["replays"])


def offers(
    run: str | PathLike[str] | Evidence, episode: int, options: PlayOnOptions | None = None
) -> dict[str, Offered]:
    """Returns what may be changed of each agent: actions and policies, by name.

    Policies are the built-in ones, those that the environment brings, the run's and the user's.

    Raises:
        GamekeeperError: as `futures`.
    """
    known = options or PlayOnOptions()
    evidence = evidence_of(run)
    branch = BranchPoint(episode=episode, turn=0, agent="", policy=BUILT_IN[0])
    answer, _ = _in_worker("offers", run, branch, known, {}, None)
    setup = _setup(evidence, branch, known)
    named = sorted(name for name in policies_in(setup) if shared_with(name) is None)
    every = list(dict.fromkeys([*BUILT_IN[:2], *answer["ways"], *named, *known.tried]))
    found = {}
    for agent, spaces in evidence.spaces.items():
        has_noop = evidence.contract.noop_of(agent) is not None
        names = [*every, *(each for each in BUILT_IN[2:] if has_noop and each not in every)]
        space = None if spaces.action is None else spaces.action.space
        actions: list[int] = []
        if isinstance(space, Discrete) and space.n <= MOST_LISTED:
            actions = [int(space.start) + k for k in range(int(space.n))]
        found[str(agent)] = Offered(tuple(names), tuple(actions), str(space)[:200])
    return found


def _in_worker(
    kind: str,
    run: str | PathLike[str] | Evidence,
    branch: BranchPoint,
    options: PlayOnOptions,
    extra: Mapping[str, Any],
    on_message: Progress | None,
) -> tuple[dict[str, Any], str]:
    """Runs a task under consent; its answer, and the rule by which code of the run was run."""
    evidence = evidence_to_play(run, allow_import=options.allow_import)
    setup = _setup(evidence, branch, options)
    chosen = [name for name in options.tried if name == branch.policy or kind == "offers"]
    allowed = {*BUILT_IN, *options.tried, *policies_in(setup)}
    if branch.policy is not None and ":" in branch.policy and branch.policy not in allowed:
        raise EvidenceError(
            "only policies that were named before may play on",
            where="policy",
            expected=", ".join(sorted(allowed)),
            actual=branch.policy,
            fix=f"start with --try {branch.policy}",
        )
    allow, named = options.allow_import, options.policies
    consent = consent_to(evidence, setup, policies=named, allow_import=allow, tried=chosen)
    arguments = {
        "kind": kind,
        "run": str(evidence.path),
        "setup": setup.to_json(),
        "contract": evidence.contract.to_json(),
        "branch": asdict(branch),
        **extra,
    }
    with consent as given:
        outcome = run_task(
            TASK,
            arguments,
            silence_s=options.silence_s,
            limit_s=options.limit_s,
            on_message=on_message,
            stop=options.stop,
        )
    if outcome.status == "interrupted" and options.stop is not None and options.stop.is_set():
        raise GamekeeperError("playing on was stopped", where=str(branch), fix="ask again")
    error = error_in(outcome)
    if error is not None:
        raise error
    assert isinstance(outcome.value, dict)
    return outcome.value, given.rule


def check_consent(run: str | PathLike[str] | Evidence, options: PlayOnOptions) -> None:
    """Checks that playing on may run the code of a run.

    Raises:
        TrustError: it names code that nobody allowed to run.
    """
    evidence, named, allow = evidence_of(run), options.policies, options.allow_import
    try:
        setup = setup_of(evidence, policies=named)
    except GamekeeperError:  # it can't be played on: said where that is asked for
        return
    with consent_to(evidence, setup, policies=named, allow_import=allow, tried=options.tried):
        return


def _setup(evidence: Evidence, branch: BranchPoint, options: PlayOnOptions) -> Setup:
    """The set-up of the episode: its own policies, where the user named none."""
    header = evidence.header(branch.episode)
    steps = evidence.turns_of(header)
    if not 0 <= branch.turn < steps:
        raise EvidenceError(
            f"nothing is done at turn {branch.turn} of episode {branch.episode}",
            where="turn",
            expected=f"a number from 0 to {steps - 1}",
            actual=str(branch.turn),
            fix="choose a turn at which agents act",
        )
    setup = setup_of(evidence, policies=options.policies)
    return setup if options.policies else replace(setup, policies=choices_in(header["policies"]))


def policies_in(setup: Setup) -> set[str]:
    """Names of the policies of a set-up."""
    return {name for name in setup.policies.values() if isinstance(name, str)}
