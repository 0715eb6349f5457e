"""Recording: a live environment, or rollouts, into a run on disk or into memory."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown, to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.exception_text import said_by, traceback_text
from gamekeeper.episodes.layout import agent_name, role
from gamekeeper.episodes.outcome import Outcome, check_measured, plain_numbers
from gamekeeper.errors import EnvError, EvidenceError, GamekeeperError, SpecError
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices, JointPolicy, assign
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.openings import Openings, seed_each_reset
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.interface.policy import EVERYONE, check_words, resolve
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts.episode_loop import play
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.rollouts.rollout_plan import MOST_TURNS, RolloutPlan
from gamekeeper.runs.first_check import FirstCheck, unchecked
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import RunRecorder, no_watch, record_many, require_pillow
from gamekeeper.runs.ring.keep_rule import keep_rule
from gamekeeper.runs.ring.ring_check import RingCheck
from gamekeeper.runs.ring.ring_ledger import RingLedger, ring_ledger

# -- Environments whose frames are recorded: opened with a render mode, or refused in time

SMALL: Final = "actions"
UNCHECKED: Final = "gk.record does so with keep alone"
UNCLOSED: Final = "it was not closed"
PICTURES: Final = "rgb_array"
MODES: Final = (PICTURES, "ansi")
"""Render modes that give something to keep, the better first."""


def open_rendered(spec: object, env_kwargs: Mapping[str, Any]) -> Opened:
    """Opens an environment so that it renders; a mode that isn't given is chosen and recorded.

    The mode becomes one of the environment's arguments, so a replay opens it in the same way. An
    object is taken as it was made, and so is what doesn't list its modes.

    Raises:
        EvidenceError: it has none of the modes that give frames, or can't be made with one.
        SpecError: nothing can be opened under that name.
        DependencyError: it gives pictures, and nothing is installed to write them.
    """
    opened = open_env(spec, **env_kwargs)
    modes = opened.env.metadata.get("render_modes")
    mode = getattr(opened.env, "render_mode", None)
    if opened.make is None or mode is not None or "render_mode" in env_kwargs or modes is None:
        if mode == PICTURES:
            require_pillow()
        return opened
    opened.env.close()
    chosen = next((one for one in MODES if one in modes), None)
    if chosen == PICTURES:
        require_pillow()  # before the run begins: an unfinished one would be in the next one's way
    seen = f"render_modes {list(modes)}"
    if chosen is not None:
        try:
            return open_env(spec, **{**env_kwargs, "render_mode": chosen})
        except SpecError as error:
            seen = error.what
    raise EvidenceError(
        "no frames can be taken of the environment",
        where=opened.spec,
        expected=f"a render mode: {' or '.join(MODES)}",
        actual=seen,
        fix="record it without frames, or give its factory a render_mode",
    )


# -- The first episode that ends by itself: it must measure the figures that conditions name


class FirstEnding:
    """Follows a capture until an episode has ended by itself, and checks the conditions on it.

    An episode that is cut isn't enough: an environment may report at the end alone.
    """

    def __init__(self, capture: Any, contract: Contract | None) -> None:
        self._capture, self._contract = capture, contract or Contract()
        self._infos: dict[str, dict[str, float]] = {}
        self._seen: dict[str, int] = {}
        self._is_open = bool(self._contract.failure)

    def take_turn(self) -> None:
        """Keeps the last infos of agents; checks the conditions once the episode has ended.

        Raises:
            ContractError: a condition names a figure that the episode doesn't have.
        """
        if not self._is_open:
            return
        capture = self._capture
        infos = (
            capture.infos
            if isinstance(capture, ParallelCapture)
            else getattr(capture.env, "infos", {})
        )
        for agent, info in dict(infos).items():
            numbers = plain_numbers(info)
            if numbers:
                name = agent_name(agent)
                self._infos[name], self._seen[name] = numbers, capture.turn
        if not capture.to_move:
            self._is_open = False
            roster = map(agent_name, getattr(capture.env, "possible_agents", None) or ())
            agents = dict.fromkeys([*roster, *self._infos])
            has_terms = isinstance(getattr(capture.env, "terms", None), dict)
            outcome = Outcome(
                returns=dict.fromkeys(agents, 0.0),
                terms={agent: {} for agent in agents} if has_terms else {},
                infos=self._infos,
                seen=self._seen,
            )
            check_measured(outcome, self._contract.failure, self._contract)


# -- Recording: an environment of the user's, or rollouts of ours, into a run or into memory


def record(
    env: Any,
    path: str | PathLike[str],
    *,
    level: str = "full",
    keep: str | None = None,
    failed: str | None = None,
    seed_resets: bool = False,
    check: bool = True,
    contract: Contract | str | PathLike[str] | None = None,
    frames: bool = False,
    state: bool = True,
) -> Any:
    """The same environment, recorded: a learner that steps it sees no difference.

    Every reset starts an episode; one that is reset or closed in the middle is kept as *cut*.
    `close` finalizes the run, and so does the end of the process.

    Args:
        env: a ParallelEnv or AECEnv; or a vector environment of ours that wasn't reset yet, or an
            adapter to a trainer that steps one, as `sb3.vec_env`, which is recorded copy by copy
            into one run, its episodes in their order.
        path: a folder that doesn't exist yet, or is empty.
        level: "full"; "digest": digests of rows in place of observations; "actions": seeds,
            actions, rewards and flags, which `expand` plays again into full evidence.
        keep: episodes that stay, for a run that is always on: "failed", "last 1000", the size of
            its folder as "64 MB" (256 MiB where none is named), or some of them between commas. The
            longest, best and worst stay in any case, and failed ones as far as there is room. None:
            all.
        failed: condition under which an episode failed, as "return < 0.5"; None: the contract's.
        seed_resets: give each reset without a seed one that is derived from the last seed given
            (from a random one where none was), so that each episode can be played by itself. Else
            `keep` takes down the states of the generators that the environment holds.
        check: with `keep` at level "actions", replay two episodes by themselves in a worker
            meanwhile; where one comes out otherwise, that is said at once.
        contract: declares reward terms, noops and volatile infos; a path is read.
        frames: also render() once a turn, into `frames/`.
        state: also state() once a turn, where the environment has it and it draws no randomness.
    Raises:
        RunError: the folder can't be written, or something is in it.
        EvidenceError: `keep` is no rule, or frames are asked for with it.
        ContractError: `keep` asks for failed episodes, and nothing says when one failed; later: the
            first episode that ended doesn't measure what the condition asks for.
    """
    _check_keep(keep, failed, frames=frames)
    venv = _vector_of(env)
    if venv is not None:
        given = Contract.load(contract) if isinstance(contract, str | PathLike) else contract
        ring = _ring(keep, venv.seen.contract if given is None else given, failed)
        record_many(venv, path, level=level, contract=given, ring=ring)
        return env
    opened = open_env(env)
    declared = declared_contract(contract, opened)
    recorder = RunRecorder(
        path,
        environment=opened.identity,
        contract=declared,
        level=level,
        extra=_first_entry(level, UNCHECKED if keep is None or not check else UNCLOSED),
        ring=_ring(keep, declared, failed),
        **_declared(declared),
    )
    capture = capture_of(opened.env, sink=recorder, frames=frames, state=state)
    recorder.at_end = capture.end_episode
    if seed_resets:
        seed_each_reset(capture)
    if keep is None:
        return recorded_of(capture, on_close=recorder.close)
    capture.openings = Openings(capture.env)
    return recorded_of(capture, on_close=_closing(recorder, capture.openings, check=check))


def _vector_of(env: Any) -> Any:
    """The vector environment that `env` is, or that it steps as an adapter to a trainer; or None.

    Source: `slots` of the adapters to Stable-Baselines3 and Tianshou, `venv` of that to TorchRL.
    """
    slots = getattr(env, "slots", None)
    for found in (env, getattr(slots, "venv", None), getattr(env, "venv", None)):
        if hasattr(found, "num_envs") and hasattr(found, "seen"):
            return found
    return None


def _closing(recorder: RunRecorder, openings: Openings, *, check: bool) -> Callable[[], None]:
    """Function that finalizes a flight recorder's run, once its checks are done."""
    if not check or recorder.level != SMALL:
        return recorder.close
    checks = RingCheck(str(recorder.path), openings)
    recorder.after_flush = lambda buffered: checks.take(buffered.starts, buffered.ends)

    def close() -> None:
        recorder.after_flush = no_watch
        recorder.say_in_manifest(checked=checks.result())
        recorder.close()

    return close


def _check_keep(keep: str | None, condition: str | None, *, frames: bool) -> None:
    """Raises where options don't go together."""
    fault = None
    if keep is None and condition is not None:
        fault = "a condition of failure, and no rule that retains episodes by it", "keep='failed'"
    elif keep is not None and frames:
        fault = "frames, which a run that drops episodes doesn't have", "frames=False"
    if fault is not None:
        raise EvidenceError(
            "these options don't go together",
            where="gk.record",
            expected=fault[1],
            actual=fault[0],
            fix="give `failed` together with `keep`, and `frames` without it",
        )


def _ring(keep: str | None, contract: Contract | None, condition: str | None) -> RingLedger | None:
    """Ledger of a run that retains some episodes."""
    return None if keep is None else ring_ledger(keep_rule(keep), contract, condition)


def rollout(
    spec: object,
    *,
    policies: Choices = "random",
    episodes: int = 20,
    first: int = 0,
    seed: int = 0,
    out: str | PathLike[str] | None = None,
    level: str = "full",
    check: bool = True,
    contract: Contract | str | PathLike[str] | None = None,
    options: Mapping[str, Any] | None = None,
    most_turns: int | None = None,
    frames: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
    workers: int | None = None,
    after_turn: Callable[[], None] | None = None,
    after_episode: Callable[[int], None] | None = None,
    while_finalizing: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> Evidence:
    """Plays episodes with policies and returns them as evidence.

    Episode k is reset with `episode_seed(seed, k)`, whatever else is played.

    Args:
        spec: where the environment comes from; an object is closed at the end.
        policies: one for all (`random`, `first-legal`, `noop`, `module:callable`, a callable), or a
            dictionary by agent or role.
        episodes: how many.
        first: number of the first one, where they are a part of a run.
        seed: of the run.
        out: the folder of a run; None keeps the evidence in memory, in full.
        level: "full", "digest" or "actions", as in `record`.
        check: at level "actions", replay the first finished episode in a worker meanwhile; where
            it doesn't come out again, that is said at once, and the manifest says it.
        frames: also render() once a turn, into `frames/`; `render_mode` is chosen where it isn't
            among `env_kwargs`.
        most_turns: longer episodes are cut; None: 100,000.
        workers: processes that play ranges of the episodes, each in a fresh environment; the
            evidence is the same for any number. Needs `out`, and names where objects could be
            given. None: this process plays.
        after_turn: called after every turn; not by workers.
        after_episode: called after every episode with how many have been played.
        while_finalizing: a context entered while the run is finalized and its checksums are
            checked, which takes a while after a long run.
    Raises:
        EnvError: the environment raised, or called sys.exit(); what was recorded until then is
            finalized as *failed*.
        RunError: the run can't be written.
        PolicyError: a policy can't be found, or gave no action.
        ContractError: the first episode that ended doesn't measure what [failure] asks for.
        EvidenceError: there is no episode to play, or an object can't go to workers.
    """
    plan = RolloutPlan(
        spec=spec,
        policies=policies,
        episodes=episodes,
        first=first,
        seed=seed,
        level=level,
        check=check,
        contract=contract,
        options=options,
        most_turns=most_turns,
        frames=frames,
        env_kwargs=dict(env_kwargs or {}),
    )
    if workers is not None:
        from gamekeeper.runs.parts.fan_out import rollout_apart  # it plays by this function

        return rollout_apart(plan, out, workers=workers, after_episode=after_episode)
    return record_rollout(
        plan, out, progress=RolloutProgress(after_turn, after_episode, while_finalizing)
    )


@dataclass(frozen=True, slots=True)
class RolloutProgress:
    """Calls on the way of a rollout, as of `rollout`."""

    after_turn: Callable[[], None] | None = None
    after_episode: Callable[[int], None] | None = None
    while_finalizing: Callable[[], AbstractContextManager[object]] = nullcontext


def record_rollout(
    plan: RolloutPlan,
    out: str | PathLike[str] | None = None,
    *,
    progress: RolloutProgress,
    durable: bool = True,
) -> Evidence:
    """Plays the episodes of a plan in this process; see `rollout`.

    Args:
        out: the folder of a run; None keeps the evidence in memory.
        durable: a run survives a power cut once it is finalized; False where it is played again
            then, as a part of a run is.
    Raises:
        GamekeeperError: as `rollout`.
    """
    folder = None if out is None else Path(out).absolute()  # an environment may leave the place
    contract = plan.contract
    if isinstance(contract, str | PathLike):
        contract = Path(contract).absolute()
    opened = (
        open_rendered(plan.spec, plan.env_kwargs)
        if plan.frames
        else open_env(plan.spec, **plan.env_kwargs)
    )
    try:
        declared = declared_contract(contract, opened)
        policies = joint_policy_of(plan.policies, opened.env, declared)  # may refuse: no folder yet
        sink: RunRecorder | MemorySink = MemorySink(**_declared(declared))
        if folder is not None:
            sink = RunRecorder(
                folder,
                environment=opened.identity,
                contract=declared,
                level=plan.level,
                run_seed=plan.seed,
                durable=durable,
                extra={**_first_entry(plan.level, "no episode ended by itself"), **_limit(plan)},
                **_declared(declared),
            )
    except BaseException:
        opened.env.close()
        raise
    capture = capture_of(opened.env, sink=sink, frames=plan.frames)
    capture.episode = plan.first - 1
    capture.policies = to_json(policies.described(list(getattr(opened.env, "possible_agents", ()))))
    try:
        _play(plan, capture, policies, sink, FirstEnding(capture, declared), progress)
    except (GamekeeperError, KeyboardInterrupt):
        raise
    except BaseException as error:  # an environment must not end this process
        raise _broken(error, capture) from error
    if isinstance(sink, RunRecorder):
        with progress.while_finalizing():
            return replace(load(sink.path), path=Path(str(out)))
    found = sink.evidence(opened.identity, contract=declared, run_seed=plan.seed)
    return replace(found, manifest={**found.manifest, **_limit(plan)})


def _play(
    plan: RolloutPlan,
    capture: Any,
    policies: JointPolicy,
    sink: RunRecorder | MemorySink,
    ending: FirstEnding,
    progress: RolloutProgress,
) -> None:
    """Plays, finalizes the run and closes the environment, whatever happens.

    In this order: if closing the environment hangs, or ends the process, no row is lost.
    """
    checks: list[FirstCheck] = []
    small = sink if isinstance(sink, RunRecorder) and sink.level == SMALL else None

    def take_episode(done: int) -> None:
        is_first = not (plan.first or checks or capture.to_move)
        if small is not None and plan.check and is_first:
            checks.append(FirstCheck(str(small.path), capture.episode))
        if progress.after_episode is not None:
            progress.after_episode(done)

    def take_turn() -> None:
        ending.take_turn()
        if progress.after_turn is not None:
            progress.after_turn()

    try:
        try:
            play(
                capture,
                policies,
                range(plan.first, plan.first + plan.episodes),
                seed=plan.seed,
                options=plan.options,
                most_turns=MOST_TURNS if plan.most_turns is None else plan.most_turns,
                after_turn=take_turn,
                after_episode=take_episode,
            )
        except (GamekeeperError, KeyboardInterrupt) as error:
            if isinstance(sink, RunRecorder):
                sink.say_in_manifest(stopped=_stopped(error, capture, plan))
            raise
        except BaseException as error:  # also where no step raised: last(), state(), render()
            capture.fail_at_last(traceback_text(error))
            raise
        finally:
            capture.end_episode()
    finally:
        try:
            if small is not None and checks:
                small.say_in_manifest(checked=checks[0].result())
            if isinstance(sink, RunRecorder):
                with progress.while_finalizing():
                    sink.close()
        finally:
            capture.close()


def _stopped(error: BaseException, capture: Any, plan: RolloutPlan) -> str:
    """Entry of the manifest: what ended the rollout before its last episode, and where."""
    why = error.what if isinstance(error, GamekeeperError) else "it was interrupted"
    begun = capture.episode + 1 - plan.first
    place = f"episode {capture.episode}, turn {capture.turn}" if begun else "the first reset"
    return f"{why} ({place}); {begun} of {plan.episodes} episodes were begun"


def _first_entry(level: str, why: str) -> dict[str, Any]:
    """Entry of the manifest of a small run until an episode of it has been checked."""
    return {"checked": unchecked(why)} if level == SMALL else {}


def _limit(plan: RolloutPlan) -> dict[str, Any]:
    """Entry of the manifest: the turns at which episodes are cut, where that was asked for."""
    return {} if plan.most_turns is None else {"most_turns": plan.most_turns}


def _declared(contract: Contract | None) -> dict[str, Any]:
    if contract is None:
        return {}
    return {"terms": tuple(contract.rewards), "volatile": contract.volatile_infos()}


def joint_policy_of(policies: Choices, env: Any, contract: Contract | None) -> JointPolicy:
    """The policies that play `env`, by declared roles, noops and masks, else by agents' names."""
    declared = contract or Contract()
    return assign(
        _with_own(policies, env),
        possible_agents=list(getattr(env, "possible_agents", ())),
        roles=lambda agent: declared.role_of(agent) or role(agent_name(agent)),
        role_names=tuple(declared.roles),
        action_space=env.action_space,
        noop=declared.noop_of,
        mask_at=declared.mask_of,
    )


def _with_own(policies: Choices, env: Any) -> Choices:
    """`policies`, words that name the environment's own resolved (`reference`)."""
    own = getattr(env.unwrapped, "policies", None)
    if not isinstance(own, Mapping):
        return policies
    whole: Mapping[str, Any] = policies if isinstance(policies, Mapping) else {EVERYONE: policies}
    check_words([choice for choice in whole.values() if isinstance(choice, str)], map(str, own))
    found = {
        place: replace(resolve(own[choice]), name=choice)
        for place, choice in whole.items()
        if isinstance(choice, str) and choice in own
    }
    return {**whole, **found} if found else policies


def _broken(error: BaseException, capture: Any) -> EnvError:
    raised = f"raised {said_by(error)}"
    if issubclass(type(error), SystemExit):
        raised = f"called sys.exit({shown(vars(SystemExit)['code'].__get__(error))})"
    turn = capture.turn if capture.failed_at is None else capture.failed_at
    return EnvError(
        f"the environment {raised}",
        where=f"episode {capture.episode}, turn {turn}",
        fix="see the traceback above, which is also in the run; the turns before it are recorded",
    )
