"""An episode that is only counted comes to what the recorded one came to."""

from typing import Any

import pytest

from gamekeeper.episodes.outcome import Outcome, outcome_of
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import open_env
from gamekeeper.rollouts.episode_loop import EpisodePlan, EvidenceOptions, perform
from gamekeeper.rollouts.interventions.action_substitutes import ReplacedAction
from gamekeeper.rollouts.tally import tally
from gamekeeper.runs.recording import joint_policy_of


def _rounded(outcome: Outcome) -> dict[str, Any]:
    """Sums that were added up in another order differ in their last digits."""
    data = outcome.to_json()
    data["returns"] = {agent: round(value, 9) for agent, value in data["returns"].items()}
    data["terms"] = {
        agent: paid
        for agent, terms in data["terms"].items()
        if (paid := {name: round(value, 9) for name, value in terms.items() if value})
    }
    return data


@pytest.mark.parametrize("most_turns", [100_000, 7])
@pytest.mark.parametrize(
    "spec", ["two_robot_line", "handover", "warehouse", "warehouse_turns", "connect_four"]
)
def test_tally_counts_what_the_record_says(spec: str, most_turns: int) -> None:
    """Returns, terms, endings, infos and length are those of the episode."""
    opened = open_env(spec)
    contract = declared_contract(None, opened)
    joint_policy = joint_policy_of("random", opened.env, contract)
    for seed in range(2):
        play = EpisodePlan(seed=seed, stream=seed, most_turns=most_turns)
        options: dict[str, Any] = {"joint_policy": joint_policy, "contract": contract}
        played = perform(play, opened.env, keep=EvidenceOptions(state=False), **options)
        counted = tally(play, opened.env, **options)
        assert _rounded(counted) == _rounded(outcome_of(played.episode))


def test_tally_plays_a_change() -> None:
    """A change is played as a rerun plays it."""
    opened = open_env("two_robot_line")
    contract = declared_contract(None, opened)
    joint_policy = joint_policy_of("reference", opened.env, contract)
    play, change = (
        EpisodePlan(seed=3, most_turns=1),
        ReplacedAction(turn=0, agent="picker", action=1),
    )
    played = perform(
        play,
        opened.env,
        joint_policy=joint_policy,
        change=change,
        contract=contract,
        keep=EvidenceOptions(state=False),
    )
    counted = tally(play, opened.env, joint_policy=joint_policy, change=change, contract=contract)
    assert _rounded(counted) == _rounded(outcome_of(played.episode))


def test_tally_keeps_what_broke_an_episode_off() -> None:
    """A policy that raises is told as the episode's error."""

    def broken(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        raise RuntimeError("no idea")

    opened = open_env("two_robot_line")
    joint_policy = joint_policy_of(broken, opened.env, None)
    outcome = tally(EpisodePlan(seed=0), opened.env, joint_policy=joint_policy)
    assert outcome.error is not None
    assert "no idea" in outcome.error
    assert not outcome.is_over


@pytest.mark.parametrize("spec", ["two_robot_line", "connect_four"])
def test_tally_says_at_which_turn_a_policy_raised(spec: str) -> None:
    """As the record says it: a capture that records nothing counts no turns."""
    opened = open_env(spec)
    turns = []

    class Tired:
        def begin(self, seed: int, stream: int) -> None:
            self.left = 4

        def act(self, agent: Any, observation: Any, info: Any) -> Any:
            self.left -= 1
            if not self.left:
                raise RuntimeError("tired")
            return 1

    for count in (tally, lambda *given, **options: outcome_of(perform(*given, **options).episode)):
        outcome = count(EpisodePlan(seed=0), opened.env, joint_policy=Tired())
        turns.append(outcome.turns)
    assert turns[0] == turns[1] > 0
