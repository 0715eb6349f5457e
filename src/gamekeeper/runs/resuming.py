"""A recorded episode resumed: its environment and policies, live, at one of its turns."""

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.actions_level import EVERY
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.runs.consent import consented, evidence_of
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.runs.replay_runner import ReplayRunner, opened_again
from gamekeeper.runs.reset_chain import chain_of
from gamekeeper.runs.standing import choices_in


@dataclass(frozen=True, slots=True)
class Resumed:
    """An episode that stands at one of its turns; `env, policies = resumed` takes it apart.

    Attributes:
        env: the environment, live: a ParallelEnv or AECEnv that was stepped to this turn.
        policies: the recorded ones, which have seen what they saw in the recording: `act(agent,
            observation, info)` gives an action; None where the run names none.
        observations: of the live agents, as the last step of a ParallelEnv returned them; empty
            for an AECEnv, whose `last()` gives its agent's.
        infos: the same of the infos.
        episode: number of the episode.
        turn: env steps that were taken since its reset.
        compared: the parts of the recording that were compared on the way, in a sentence.
    """

    env: Any
    policies: JointPolicy | None
    observations: Mapping[Any, Any]
    infos: Mapping[Any, Any]
    episode: int
    turn: int
    compared: str

    def __iter__(self) -> Iterator[Any]:
        """Yields the environment and the policies."""
        return iter((self.env, self.policies))


def resume(
    run: Evidence | str | PathLike[str],
    *,
    episode: int = 0,
    turn: int = 0,
    env: str | None = None,
    allow_import: bool = False,
) -> Resumed:
    """Opens the environment of a run and plays one of its episodes again up to a turn.

    Every turn on the way is compared with the recorded one. A run of level `actions` keeps no
    observations between witnesses: of it, rewards, flags and witnesses are compared, and the
    episode is first played to its end once, as the rows in which agents end are witnesses. An
    environment that keeps something over a reset may stand elsewhere nevertheless; `compared` says
    what was compared. Policies that the run names choose again, so that what they remember is as
    it was; else the recorded actions are played.

    Args:
        run: the folder of a run, or evidence.
        episode: number of the episode.
        turn: env steps that were taken then: 0 stands after the reset.
        env: its name, opened in place of what the evidence names, with the recorded arguments.
        allow_import: run code that the evidence names.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: there is no such episode or turn, or what is played now isn't what was
            recorded.
        RunError: there is no run, or it is damaged.
        SpecError: the environment can't be opened.
    """
    evidence = evidence_of(run)
    header = _header(evidence, episode, turn)
    names = choices_in(header.get("policies"))
    with consented(
        evidence,
        doing="resuming this run",
        env=env,
        policies=names.values(),
        allow_import=allow_import,
    ):
        if evidence.manifest.get("level") == "actions":
            _check_to_the_end(evidence, header, env)
        opened = opened_again(evidence, env)
        try:
            chooser = joint_policy_of(names, opened.env, evidence.contract) if names else None
            runner = ReplayRunner(evidence, opened)
            known = frozenset(evidence.episode_table["episode"].to_pylist())
            for number in chain_of(header, known):
                earlier, _ = runner.compared(evidence.header(number), chooser=chooser)
                if earlier.divergence is not None:
                    raise _otherwise(number, str(earlier.divergence))
            played = runner.play_until(header, turn, chooser=chooser)
            both = (_cut(each, turn) for each in (evidence.episode_of(header), played))
            compared = compare(
                *both,
                volatile=evidence.contract.volatile_infos(),
                is_kept=evidence.manifest.get("level") == "actions",
            )
            if compared.divergence is not None:
                raise _otherwise(episode, str(compared.divergence))
        except BaseException:
            opened.env.close()
            raise
    text = _compared(evidence, turn)
    return Resumed(opened.env, chooser, *runner.returned(), episode, turn, text)


def _check_to_the_end(evidence: Evidence, header: Mapping[str, Any], env: str | None) -> None:
    """Raises where the whole episode, played by its actions, comes out otherwise."""
    known = frozenset(evidence.episode_table["episode"].to_pylist())
    with closing(ReplayRunner(evidence, opened_again(evidence, env))) as runner:
        for number in chain_of(header, known):
            runner.play(evidence.header(number))
        both, _ = runner.compared(header)
    if both.divergence is not None:
        raise _otherwise(header["episode"], str(both.divergence))


def _compared(evidence: Evidence, turn: int) -> str:
    """The parts of the turns before `turn` that were compared, and those that weren't."""
    turns = f"turns 0 to {turn - 1}" if turn > 1 else "turn 0"
    if evidence.manifest.get("level") != "actions":
        are = "are" if turn > 1 else "is"
        return f"{turns} {are} as recorded" if turn else "no turn was played, so none was compared"
    count = -(-turn // EVERY)
    witnesses = f"{count} witness{'es' if count != 1 else ''}"
    before = f"rewards and flags of {turns} and {witnesses}, and " if turn else ""
    return (
        f"{before}rewards, flags and witnesses of the whole episode, which was played to its end "
        "first, are as recorded; observations between witnesses aren't kept and weren't compared"
    )


def _otherwise(episode: int, actual: str) -> EvidenceError:
    return EvidenceError(
        "what is played now isn't what was recorded",
        where=f"episode {episode}",
        actual=actual,
        fix="gamekeeper replay RUN looks for the cause",
    )


def _header(evidence: Evidence, episode: int, turn: int) -> Mapping[str, Any]:
    """The row of an episode that has such a turn."""
    header = evidence.header(episode)
    steps = evidence.turns_of(header)
    if not 0 <= turn <= steps:
        raise EvidenceError(
            f"episode {episode} has no turn {turn}",
            where="turn",
            expected=f"a number from 0, after the reset, to {steps}, its end",
            actual=str(turn),
            fix="choose one of these",
        )
    return header


def _cut(episode: Episode, steps: int) -> Episode:
    """The first turns of an episode, none of which ends it."""

    def before(table: pa.Table) -> pa.Table:
        return table.filter(pc.less(table["turn"], steps))

    states = None if episode.states is None else before(episode.states)
    header = {**episode.header, "endings": None, "turns": steps}
    return replace(episode, steps=before(episode.steps), states=states, header=header, _cache={})
