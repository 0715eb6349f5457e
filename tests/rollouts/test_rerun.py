from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.episodes.arrow import TERM
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.episode import Episode
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import EvidenceOptions, perform, play
from gamekeeper.rollouts.interventions.tick_order import ActionOrder
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.rollouts.reruns import play_of, replayed_episode
from gamekeeper.runs.recording import joint_policy_of, rollout
from tests.runs.walks import Turns, Walk


def rerun(episode: Episode, env: Any, **options: Any) -> Episode:
    """What an episode comes to, played again in an environment."""
    sink = MemorySink()
    capture = capture_of(env, sink=sink)
    capture.episode = episode.episode - 1
    agents = {str(agent): agent for agent in env.possible_agents}
    replayed_episode(episode, capture, agents=agents, **options)
    return sink.evidence({"name": "x", "api": capture.api, "kwargs": {}}).episodes[0]


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_rerun_plays_the_same_again(kind: type) -> None:
    """Recorded actions from a recorded seed come to the same rows."""
    for episode in rollout(kind(), episodes=3, seed=2).episodes:
        assert compare(episode, rerun(episode, kind())).is_exact


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_rerun_closes_the_loop(kind: type) -> None:
    """Policies that choose anew from the recorded seed choose the same."""
    evidence = rollout(kind(), episodes=2, seed=2, policies={"a": "random", "b": "first-legal"})
    for episode in evidence.episodes:
        env = kind()
        joint_policy = joint_policy_of({"a": "random", "b": "first-legal"}, env, None)

        assert compare(episode, rerun(episode, env, joint_policy=joint_policy, run_seed=2)).is_exact


def test_rerun_reports_every_turn() -> None:
    """Each step is a sign of life."""
    episode = rollout(Walk(), episodes=1).episodes[0]
    turns: list[int] = []

    rerun(episode, Walk(), after_turn=lambda: turns.append(1))

    assert len(turns) == 5


def test_rerun_stops_where_the_environment_raises() -> None:
    """An environment that raises where none raised before ends the episode as failed."""

    class Breaks(Walk):
        def step(self, actions: Any) -> Any:
            if self.turn == 2:
                raise ZeroDivisionError
            return super().step(actions)

    again = rerun(rollout(Walk(), episodes=1).episodes[0], Breaks())

    assert (again.header["end"], again.header["turns"]) == ("failed", 3)


def test_rerun_stops_where_everybody_has_left() -> None:
    """Actions that were recorded beyond the end of the episode aren't handed over."""
    again = rerun(rollout(Walk(), episodes=1).episodes[0], Walk(turns=2))

    assert (again.header["end"], again.header["turns"]) == ("ended", 2)


@pytest.mark.parametrize("names", [[0, 1], [("row", 1), ("row", 2)], ["a", 1]])
def test_rerun_knows_agents_whatever_they_are(names: list[Any]) -> None:
    """Agents that are no texts get their actions again, by what they are."""

    class Named(Walk):
        def __init__(self) -> None:
            super().__init__()
            self.possible_agents = names
            self.observation_spaces = {n: spaces.Box(-99, 99, (3,), np.float64) for n in names}
            self.action_spaces = {n: spaces.Discrete(3) for n in names}

        def step(self, actions: Any) -> Any:
            assert set(actions) <= set(names)
            return super().step(actions)

    episode = rollout(Named(), episodes=1).episodes[0]

    assert compare(episode, rerun(episode, Named())).is_exact


def test_rerun_of_nothing_resets_once() -> None:
    """An episode without turns is a reset without turns."""
    env, sink = Walk(), MemorySink()
    capture = capture_of(env, sink=sink)
    play(capture, joint_policy_of("random", env, None), range(1), seed=0, most_turns=0)
    episode = sink.evidence({"name": "x", "api": "parallel", "kwargs": {}}).episodes[0]

    assert compare(episode, rerun(episode, Walk())).is_exact


@pytest.mark.parametrize("spec", ["warehouse", "warehouse_turns", "two_robot_line"])
def test_rerun_without_a_change_is_the_unchanged_rerun(spec: str) -> None:
    """An episode from evidence, played again from script or by its policies, comes out the same."""
    for episode in rollout(spec, episodes=2, seed=3, most_turns=60).episodes:
        env = gk.make(spec)
        planned, names = play_of(episode, env), episode.steps.schema.names
        terms = tuple(name.removeprefix(TERM) for name in names if name.startswith(TERM))
        keep = EvidenceOptions(terms=terms, number=episode.episode)
        open_loop = perform(planned, env, keep=keep)
        chosen_anew = replace(planned, actions=None, most_turns=60)
        joint_policy = joint_policy_of("random", env, None)
        closed = perform(chosen_anew, env, joint_policy=joint_policy, policy_seed=3, keep=keep)

        assert compare(episode, open_loop.episode).divergence is None
        assert compare(episode, closed.episode).divergence is None


def test_rerun_names_its_change() -> None:
    """The counterfactual says what was done differently."""
    episode = rollout("two_robot_line", episodes=1).episodes[0]

    env = gk.make("two_robot_line")
    counterfactual = perform(play_of(episode, env), env, change=ActionOrder("reversed"))

    assert counterfactual.episode.change is not None
    assert counterfactual.episode.change["change"] == "ActionOrder"
