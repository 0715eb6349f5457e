from typing import Any

import pytest

from gamekeeper.episodes.divergence import compare
from gamekeeper.rollouts.episode_loop import EpisodePlan, FailedCall, perform
from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.reruns import shrink
from gamekeeper.runs.recording import joint_policy_of
from tests.faults.hidden_draws import EachLookDraws
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


@pytest.mark.parametrize("make", [Rovers, Traders, EachLookDraws])
def test_scripted_play_repeats_the_play(make: Any) -> None:
    """What policies chose can be played again from script, to the same rows: each looks once."""
    env = make()
    first = perform(EpisodePlan(seed=4), env, joint_policy=joint_policy_of("random", env, None))
    again = perform(first.play, make())

    assert first.is_over
    assert compare(first.episode, again.episode).is_exact
    assert again.play == first.play


def test_play_is_cut_at_its_length() -> None:
    """No more turns than asked for."""
    env = Rovers()
    played = perform(
        EpisodePlan(seed=4, most_turns=3), env, joint_policy=joint_policy_of("random", env, None)
    )

    assert len(played.play.actions or ()) == 3
    assert not played.is_over


@pytest.mark.parametrize("make", [Rovers, Traders])
def test_hooks_change_what_is_done(make: Any) -> None:
    """A change sees every turn, and what it answers is what is done."""

    class Stay(Intervention):
        def start(self, rng: Any) -> Hooks:
            return Staying()

    class Staying(Hooks):
        def acts(self, turn: int, actions: dict[Any, Any]) -> dict[Any, Any]:
            return {agent: a if a is None else 0 for agent, a in actions.items()}

    env = make()
    base = perform(EpisodePlan(seed=4), env, joint_policy=joint_policy_of("random", env, None))
    counterfactual = perform(base.play, make(), change=Stay())

    divergence = compare(base.episode, counterfactual.episode).divergence
    assert divergence is not None
    assert divergence.field == "action"
    assert counterfactual.episode.change == {"change": "Stay"}


def test_play_tells_what_raised() -> None:
    """An exception of the environment is data: which call, after how many steps."""
    env = Rovers()
    env.drive = lambda agent, action: 1 / 0
    played = perform(EpisodePlan(seed=4), env, joint_policy=joint_policy_of("random", env, None))

    assert played.failed is not None
    assert (played.failed.call, played.failed.turn) == ("step", 1)
    assert "ZeroDivisionError" in played.failed.kind


def test_shrink_keeps_only_what_is_needed() -> None:
    """Of twenty turns the two that matter are left, their actions plain but for one."""
    play = EpisodePlan(actions=tuple({"a": n} for n in range(20)))

    def still(shorter: EpisodePlan) -> bool:
        done = [each["a"] for each in shorter.actions or ()]
        return 7 in done and len(done) >= 2

    shorter = shrink(play, still, turns=12, plain={"a": 0})

    assert sorted(each["a"] for each in shorter.actions or ()) == [0, 7]


def test_shrink_leaves_what_nothing_shorter_shows() -> None:
    """An episode that can't be shortened stays."""
    play = EpisodePlan(actions=tuple({"a": n} for n in range(5)), most_turns=5)

    assert shrink(play, lambda shorter: shorter.actions == play.actions).actions == play.actions


def test_a_shrunk_play_leaves_no_live_agent_out() -> None:
    """A turn of fewer agents, moved to an earlier place, has the actions of those alive there."""
    env = Rovers()
    first, every = env.possible_agents[0], dict.fromkeys(env.possible_agents, 1)
    play = EpisodePlan(seed=1, actions=(every, every, {first: 0}))
    seen: list[tuple[Any, ...]] = []

    def still(shorter: EpisodePlan) -> bool:
        done = perform(shorter, env).play
        assert done.stand_ins is None
        seen.append(done.actions or ())
        return bool(done.actions) and done.actions[-1][first] == 0

    shrink(play, still)

    assert len(seen) > 2
    assert all(turn.keys() == every.keys() for each in seen for turn in each)


def test_exception_without_a_text_ends_in_its_kind() -> None:
    """A bare assertion has nothing to say after a colon."""
    assert FailedCall("step", 1, "AssertionError", "", "").said == "AssertionError"
    assert FailedCall("step", 1, "KeyError", "'a'", "").said == "KeyError: 'a'"
