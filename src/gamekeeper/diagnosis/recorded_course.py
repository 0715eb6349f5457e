"""A recorded episode in an opened set-up, ready to be played on, once it replays."""

from __future__ import annotations

from gamekeeper.diagnosis.played_setup import OpenSetup
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.env_source import Opened
from gamekeeper.rollouts.continuations import RecordedCourse
from gamekeeper.rollouts.reruns import play_of
from gamekeeper.runs.replay_runner import ReplayRunner
from gamekeeper.runs.standing import choices_in


def course_of(evidence: Evidence, stage: OpenSetup, number: int) -> RecordedCourse:
    """The episode's course, once it has been replayed and is as it was recorded.

    Args:
        evidence: full evidence of the run.
        stage: its set-up, or one with other policies.
    Raises:
        EvidenceError: played by itself, the episode doesn't come out as it was recorded.
    """
    _check_alone(evidence, stage.opened, number)
    trace, header = evidence.episode(number), evidence.header(number)
    return RecordedCourse(
        play_of(trace, stage.env, evidence.manifest.get("action_types")),
        stage.env,
        stage.cast,
        evidence.manifest.get("seed") or 0,
        stage.contract,
        stage.setup.most_turns,
        dict(stage.setup.policies) == choices_in(header["policies"]),
    )


def check_last(evidence: Evidence, opened: Opened) -> None:
    """Checks that the last episode with a seed comes out by itself as it was recorded.

    Raises:
        EvidenceError: it doesn't, as where it depends on those before it.
    """
    rows = evidence.episode_table.select(["episode", "seed"]).to_pylist()
    seeded = [row["episode"] for row in rows if row["seed"] is not None]
    if seeded:
        _check_alone(evidence, opened, seeded[-1])


def _check_alone(evidence: Evidence, opened: Opened, number: int) -> None:
    header, again = evidence.header(number), None
    if header["seed"] is not None:
        again = ReplayRunner(evidence, opened).play(header)
    if again is None or again["fingerprint"] != header["fingerprint"]:
        raise EvidenceError(
            "the episode doesn't come out the same when it is played again by itself",
            where=f"episode {number}",
            actual="it was reset without a seed" if again is None else "another fingerprint",
            fix="gamekeeper replay RUN: where it verifies, the episode depends on those before it "
            "(gamekeeper audit ENV --select GK604); else it looks for the cause",
        )
