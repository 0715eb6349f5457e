"""Recording: an environment of the user's, or rollouts of ours, into a bundle or into memory."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.canon import to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.layout import agent_name, role
from gamekeeper.errors import EnvError, EvidenceError, GamekeeperError
from gamekeeper.game.casting.cast import Cast, Choices, assign
from gamekeeper.game.contract_file import load_contract
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.faces import face_of, game_of
from gamekeeper.game.open import Opened, open_env
from gamekeeper.game.policy import EVERYONE, resolve
from gamekeeper.record.bundle import load
from gamekeeper.record.many import record_many
from gamekeeper.record.recorder import Recorder
from gamekeeper.record.rendered import open_rendered
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.play import play

MOST_TURNS: Final = (
    100_000  # of an episode, unless told; some environments never end under some play
)


def record(
    env: Any,
    path: str | PathLike[str],
    *,
    level: str = "full",
    contract: Contract | str | PathLike[str] | None = None,
    frames: bool = False,
    state: bool = True,
) -> Any:
    """The same environment, recorded: whoever steps it can't tell.

    Every reset starts an episode; one that is reset or closed in the middle is kept as *cut*.
    `close` seals the bundle, and so does the end of the process.

    Args:
        env: a ParallelEnv or AECEnv; or a vector environment of ours that wasn't reset yet, which
            is recorded copy by copy into one bundle, its episodes in their order.
        path: a folder that doesn't exist yet, or is empty.
        level: "full", or "digest": digests of rows in place of observations, the same fingerprint.
        contract: declares reward terms, noops and volatile infos; a path is read.
        frames: also render() once a turn, into `frames/`.
        state: also state() once a turn, where the environment has it and it draws no randomness.
    Raises:
        BundleError: the folder can't be written, or something is in it.
    """
    if hasattr(env, "num_envs") and hasattr(env, "seen"):
        given = load_contract(contract) if isinstance(contract, str | PathLike) else contract
        record_many(env, path, level=level, contract=given)
        return env
    opened = open_env(env)
    declared = declared_contract(contract, opened)
    recorder = Recorder(
        path, environment=opened.identity, contract=declared, level=level, **_declared(declared)
    )
    game = game_of(opened.env, sink=recorder, frames=frames, state=state)
    recorder.at_end = game.end_episode
    return face_of(game, on_close=recorder.close)


def rollout(
    spec: object,
    *,
    policies: Choices = "random",
    episodes: int = 20,
    first: int = 0,
    seed: int = 0,
    out: str | PathLike[str] | None = None,
    level: str = "full",
    contract: Contract | str | PathLike[str] | None = None,
    options: Mapping[str, Any] | None = None,
    most_turns: int | None = None,
    frames: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
    workers: int | None = None,
    after_turn: Callable[[], None] | None = None,
    after_episode: Callable[[int], None] | None = None,
    while_sealing: Callable[[], AbstractContextManager[object]] = nullcontext,
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
        out: the folder of a bundle; None keeps the evidence in memory.
        frames: also render() once a turn, into `frames/`; `render_mode` is chosen where it isn't
            among `env_kwargs`.
        most_turns: longer episodes are cut; None: 100,000.
        workers: processes that play ranges of the episodes, each in a fresh environment; the
            evidence is the same for any number. Needs `out`, and names where objects could be
            given. None: this process plays.
        after_turn: called after every turn; not by workers.
        after_episode: called after every episode with how many have been played.
        while_sealing: a context entered while the bundle is sealed and its seal is checked, which
            takes a while after a long run.
    Raises:
        EnvError: the environment raised, or called sys.exit(); what was recorded until then is
            sealed as *failed*.
        BundleError: the bundle can't be written.
        PolicyError: a policy can't be found, or gave no action.
        EvidenceError: there is no episode to play, or an object can't go to workers.
    """
    if episodes < 1 or first < 0:
        raise EvidenceError(
            "nothing is to be played", where="episodes, first",
            expected="at least 1 episode, from 0 on", seen=f"{episodes}, {first}",
        )  # fmt: skip
    if workers is not None:
        from gamekeeper.record.parts.rollout import rollout_apart  # it plays by this function

        return rollout_apart(
            spec, out, workers=workers, policies=policies, episodes=episodes, first=first,
            seed=seed, level=level, contract=contract, options=options, most_turns=most_turns,
            frames=frames, env_kwargs=env_kwargs, after_episode=after_episode,
        )  # fmt: skip
    return played(
        spec, policies=policies, episodes=episodes, first=first, seed=seed, out=out, level=level,
        contract=contract, options=options, most_turns=most_turns, frames=frames,
        env_kwargs=env_kwargs, after_turn=after_turn, after_episode=after_episode,
        while_sealing=while_sealing,
    )  # fmt: skip


def played(
    spec: object,
    *,
    policies: Choices,
    episodes: int,
    first: int,
    seed: int,
    out: str | PathLike[str] | None,
    level: str,
    contract: Contract | str | PathLike[str] | None,
    options: Mapping[str, Any] | None,
    most_turns: int | None,
    frames: bool,
    env_kwargs: Mapping[str, Any] | None,
    after_turn: Callable[[], None] | None,
    after_episode: Callable[[int], None] | None,
    while_sealing: Callable[[], AbstractContextManager[object]],
    durable: bool = True,
) -> Evidence:
    """Plays episodes in this process; see `rollout`.

    Args:
        durable: a bundle survives a power cut once it is sealed; False where it is played again
            then, as a part of a run is.
    Raises:
        GamekeeperError: as `rollout`.
    """
    given = dict(env_kwargs or {})
    opened = open_rendered(spec, given) if frames else open_env(spec, **given)
    try:
        declared = declared_contract(contract, opened)
        cast = cast_of(policies, opened.env, declared)  # may refuse: no folder yet
        sink = _sink(
            opened, out, level=level, contract=declared, run_seed=seed, durable=durable
        )  # fmt: skip
    except BaseException:
        opened.env.close()
        raise
    game = game_of(opened.env, sink=sink, frames=frames)
    game.policies = to_json(cast.described(list(getattr(opened.env, "possible_agents", ()))))
    game.episode = first - 1
    try:
        _play(
            game, sink, cast, range(first, first + episodes), seed=seed, options=options,
            most_turns=MOST_TURNS if most_turns is None else most_turns, after_turn=after_turn,
            after_episode=after_episode, while_sealing=while_sealing,
        )  # fmt: skip
    except (GamekeeperError, KeyboardInterrupt):
        raise
    except BaseException as error:  # an environment is nobody to end this process
        raise _broken(error, game) from error
    if isinstance(sink, Recorder):
        with while_sealing():
            return replace(load(sink.path), path=Path(str(out)))
    return sink.evidence(opened.identity, contract=declared, run_seed=seed)


def _play(
    game: Any,
    sink: Recorder | MemorySink,
    *players: Any,
    while_sealing: Callable[[], AbstractContextManager[object]],
    **options: Any,
) -> None:
    """Plays, seals the bundle and closes the environment, whatever happens.

    In this order: an environment whose closing hangs, or ends the process, loses nothing.
    """
    try:
        try:
            play(game, *players, **options)
        except (GamekeeperError, KeyboardInterrupt):
            raise
        except BaseException:  # also where it was no step that raised: last(), state(), render()
            game.fail_at_last(traceback.format_exc())
            raise
        finally:
            game.end_episode()
    finally:
        try:
            if isinstance(sink, Recorder):
                with while_sealing():
                    sink.close()
        finally:
            game.close()


def _sink(
    opened: Opened,
    out: str | PathLike[str] | None,
    *,
    level: str,
    contract: Contract | None,
    run_seed: int,
    durable: bool,
) -> Recorder | MemorySink:
    if out is None:
        return MemorySink(**_declared(contract))
    return Recorder(
        out, environment=opened.identity, contract=contract, level=level, run_seed=run_seed,
        durable=durable, **_declared(contract),
    )  # fmt: skip


def _declared(contract: Contract | None) -> dict[str, Any]:
    if contract is None:
        return {}
    return {"terms": tuple(contract.rewards), "volatile": contract.volatile_infos()}


def cast_of(policies: Choices, env: Any, contract: Contract | None) -> Cast:
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
    whole: dict[str, Any] = (
        dict(policies) if isinstance(policies, Mapping) else {EVERYONE: policies}
    )
    found = {
        whom: replace(resolve(own[choice]), name=choice)
        for whom, choice in whole.items()
        if isinstance(choice, str) and choice in own
    }
    return {**whole, **found} if found else policies


def _broken(error: BaseException, game: Any) -> EnvError:
    raised = f"raised {type(error).__name__}: {error}"
    if isinstance(error, SystemExit):
        raised = f"called sys.exit({error.code!r})"
    return EnvError(
        f"the environment {raised}",
        where=f"episode {game.episode}, turn {game.turn}",
        mend="the traceback stands above and in the bundle; the rows up to there were kept",
    )
