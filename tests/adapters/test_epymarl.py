"""EPyMARL's shape: sizes, available actions, ends, seeds, state; the same that evidence has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.adapters.epymarl import gymma, multi_agent_env
from gamekeeper.errors import ActionError, OrderError, SpecError

TIRED = {"pickers": 1, "carriers": 1, "battery": 12, "horizon": 40, "debug": True}
"""Robots that run empty one by one, each followed by a spare."""


def made(spec: object, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    return multi_agent_env(spec, check=None, **options)


def first_legal(env: Any) -> list[int]:
    """The first available action of each."""
    return [flags.index(1) for flags in env.get_avail_actions()]


def played(env: Any, **reset: Any) -> list[dict[str, Any]]:
    """An episode of first legal actions, step by step."""
    env.reset(**reset)
    told, over = [], False
    while not over:
        row = {"obs": env.get_obs(), "live": env.live.copy(), "state": env.get_state()}
        obs, reward, terminated, truncated, info = env.step(first_legal(env))
        over = terminated or truncated
        row |= {
            "after": obs,
            "reward": reward,
            "rewards": env.rewards.copy(),
            "info": info,
            "terminated": terminated,
            "truncated": truncated,
            "ends": (env.terminations.copy(), env.truncations.copy()),
        }
        told.append(row)
    return told


@pytest.mark.parametrize(
    ("spec", "kwargs", "limit"),
    [
        ("warehouse", TIRED, None),
        ("two_robot_line", {}, None),
        ("speaker_listener", {}, None),
        ("tictactoe", {}, 9),
        ("handover", {}, 1_000),
    ],
)
def test_trace_is_the_same_seen_through_it(spec: str, kwargs: Any, limit: int | None) -> None:
    """Observations of who acted, rewards of everybody, who ended how: turn by turn."""
    env = made(spec, env_kwargs=kwargs, time_limit=limit, seed=5, common_reward=None)
    told = played(env)
    evidence = gk.rollout(spec, policies="first-legal", episodes=1, seed=5, env_kwargs=kwargs)
    episode = evidence.episodes[0]
    turns = [t for t in episode.turns if any(a is not None for a in t.actions.values())]
    assert len(turns) == len(told)
    for turn, row in zip(turns, told, strict=True):
        for i, agent in enumerate(env.agents):
            if turn.actions.get(agent) is not None:
                assert row["live"][i]
                seen = np.ravel(bare(turn.observations[agent])).astype(np.float32)
                np.testing.assert_array_equal(seen, row["obs"][i][: len(seen)])
                assert not row["obs"][i][len(seen) :].any()
    for i, agent in enumerate(env.agents):
        paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in episode.turns)
        assert sum(row["rewards"][i] for row in told) == pytest.approx(paid)
    rows = episode.steps.to_pylist()
    for place, name in enumerate(("terminated", "truncated")):
        recorded = {row["agent"] for row in rows if row[name]}
        ended = np.any([row["ends"][place] for row in told], axis=0)
        assert recorded == {agent for agent, flag in zip(env.agents, ended, strict=True) if flag}
    env.close()


def bare(observation: Any) -> Any:
    """Without its mask."""
    return observation["observation"] if isinstance(observation, dict) else observation


def test_sizes_are_those_of_what_is_given() -> None:
    """`get_env_info` has all that EPyMARL's schemes ask for, and everything has those sizes."""
    env = made("warehouse", env_kwargs=TIRED)
    env.reset()
    told = env.get_env_info()
    assert told == {
        "state_shape": 221,
        "obs_shape": 83,
        "n_actions": 6,
        "n_agents": 4,
        "episode_limit": 200,
    }
    assert env.get_state().shape == (221,)
    assert env.get_state().dtype == np.float32
    assert [row.shape for row in env.get_obs()] == [(83,)] * 4
    assert np.shape(env.get_avail_actions()) == (4, 6)
    np.testing.assert_array_equal(env.get_obs_agent(1), env.get_obs()[1])
    assert env.get_avail_agent_actions(1) == env.get_avail_actions()[1]
    env.close()


def test_whoever_isnt_there_may_only_do_nothing() -> None:
    """Before a spare comes and after a robot ended: zeros, and the contract's noop."""
    env = made("warehouse", env_kwargs=TIRED, seed=1)
    env.reset()
    came = gone = 0
    over, before = False, env.live.copy()
    while not over:
        for i in np.flatnonzero(~env.live):
            assert env.get_avail_agent_actions(i) == [0, 0, 0, 0, 1, 0]
        _, _, terminated, truncated, _ = env.step(first_legal(env))
        came += int((env.live & ~before).sum())
        gone += int((before & ~env.live).sum())
        before, over = env.live.copy(), terminated or truncated
        ended = env.terminations | env.truncations
        for i in np.flatnonzero(~env.live & ~ended):
            assert not env.get_obs_agent(i).any()
    assert came > 0
    assert gone > came
    env.close()


def test_roles_with_fewer_actions_never_have_the_rest() -> None:
    """A speaker of 3 words and a listener of 5 moves; what one sees is padded to the longest."""
    env = made("speaker_listener")
    env.reset()
    assert env.agents == ["speaker_0", "listener_0"]
    assert env.get_avail_actions() == [[1, 1, 1, 0, 0], [1, 1, 1, 1, 1]]
    assert not env.get_obs_agent(0)[3:].any()
    with pytest.raises(ActionError, match="isn't available"):
        env.step([4, 0])
    env.close()


def test_turns_leave_the_others_one_action() -> None:
    """In tic-tac-toe a step is a turn: who waits has action 0 alone, which is passed over."""
    env = made("tictactoe", time_limit=9)
    env.reset()
    assert env.get_avail_actions() == [[1] * 9, [1] + [0] * 8]
    env.step([4, 0])
    assert env.get_avail_actions() == [[1] + [0] * 8, [1] * 4 + [0] + [1] * 4]
    env.close()


def test_truncation_stays_apart_from_termination() -> None:
    """A horizon truncates, a rule terminates, and `time_limit` cuts whoever is there."""
    cut = played(made("speaker_listener"))[-1]
    assert (cut["terminated"], cut["truncated"], cut["info"]) == (
        False,
        True,
        {"episode_limit": True},
    )
    met = played(made("tictactoe", time_limit=9))[-1]
    assert (met["terminated"], met["truncated"]) == (True, False)
    short = played(made("speaker_listener", time_limit=4))
    assert len(short) == 4
    assert short[-1]["truncated"]
    assert short[-1]["ends"][1].all()


class EnvStep(gk.TickEnv):
    """Whoever is there at first ends in the second tick, in which another comes."""

    metadata = {"name": "env_step_v0"}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["early_0", "late_0", "stays_0"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(2))
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(2))

    def starting_agents(self) -> list[str]:
        return ["early_0", "stays_0"]

    def start(self, rng: Any, options: Any) -> None:
        self.clock = 0

    def tick(self, actions: Any) -> None:
        self.clock += 1
        if self.clock == 2:
            self.terminate("early_0", "done")
            self.join("late_0")

    def observe(self, agent: Any) -> Any:
        return 0


def test_time_limit_truncates_who_is_there_as_it_cuts() -> None:
    """Not who was terminated in that very step, but who came in it."""
    env = made(EnvStep, time_limit=2)
    last = played(env)[-1]
    assert [flags.tolist() for flags in last["ends"]] == [[True, False, False], [False, True, True]]
    assert (last["terminated"], last["truncated"]) == (False, True)
    env.close()


def test_common_reward_is_the_sum_or_the_mean() -> None:
    """Over all agents, whoever is there; else a reward for each."""
    one, two = (
        played(made("warehouse", env_kwargs=TIRED, **o)) for o in ({}, {"common_reward": "mean"})
    )
    each = played(made("warehouse", env_kwargs=TIRED, common_reward=None))
    for summed, mean, row in zip(one, two, each, strict=True):
        assert summed["reward"] == pytest.approx(sum(row["reward"]))
        assert mean["reward"] == pytest.approx(sum(row["reward"]) / 4)


def test_seeds_are_the_runs() -> None:
    """Reset k plays episode k of the run; a seed of its own is the environment's; `seed` begins."""
    env, again = made("speaker_listener", seed=3), made("speaker_listener")
    first, second = played(env), played(env)
    assert not np.array_equal(first[0]["state"], second[0]["state"])
    again.seed(3)
    np.testing.assert_array_equal(first[0]["state"], played(again)[0]["state"])
    assert again.episode == 0
    one, two = played(again, seed=11), played(env, seed=11)
    np.testing.assert_array_equal(one[0]["state"], two[0]["state"])
    assert again.episode == -1


def test_seed_of_an_episode_is_the_others_too() -> None:
    """Their draws differ from seed to seed, and are the same for the same one."""

    def answers(seed: int) -> list[list[float]]:
        env = made("tictactoe", role="player_2", others="random", time_limit=9, seed=4)
        told = [row["obs"][0].tolist() for row in played(env, seed=seed)]
        env.close()
        return told

    found = [answers(seed) for seed in range(6)]
    assert len({str(one) for one in found}) > 3  # a board has no draws of its own
    assert answers(3) == found[3]


def test_refused_environment_is_closed() -> None:
    """What was opened for a wish that can't be met doesn't stay open."""
    closed: list[str] = []

    class Noted(EnvStep):
        def close(self) -> None:
            closed.append("noted")
            super().close()

    with pytest.raises(SpecError, match="with the role"):
        made(Noted, time_limit=2, role="pilot")
    assert closed == ["noted"]


def test_others_follow_their_policies() -> None:
    """Pickers learn, carriers follow; those are nobody's agents here, the state is whole."""
    env = made("warehouse", role="picker", others={"carrier": "reference"}, env_kwargs=TIRED)
    assert env.agents == [f"picker_{i}" for i in range(2)]
    told = played(env)
    assert len(told[0]["state"]) == 221
    assert told[-1]["truncated"]
    env.close()


def test_others_turns_are_played_inside() -> None:
    """Of two players one is ours: a step is its turn and the answer to it."""
    env = made("tictactoe", role="player_2", others="first-legal", time_limit=9)
    told = played(env)
    assert 3 <= len(told) <= 5
    assert told[0]["live"].all()
    env.close()


def test_state_can_be_everybodys_observations() -> None:
    """Also where the environment has none of its own."""
    env = made("speaker_listener", state="observations")
    env.reset()
    np.testing.assert_array_equal(env.get_state(), np.concatenate(env.get_obs()))
    assert env.get_state_size() == 22
    env.close()


def test_registry_calls_it_as_it_calls_gymma(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what EPyMARL's configuration holds, the rest for the environment."""
    monkeypatch.setattr("gamekeeper.adapters.epymarl.checked", lambda *_, **__: None)
    env = gymma(
        key="warehouse",
        time_limit=7,
        pretrained_wrapper=None,
        seed=2,
        common_reward=True,
        reward_scalarisation="sum",
        pickers=1,
        carriers=1,
        debug=True,
    )
    assert env.get_env_info()["episode_limit"] == 7
    assert len(played(env)) == 7
    with pytest.raises(SpecError, match="EPyMARL's own"):
        gymma("two_robot_line", pretrained_wrapper="PretrainedTag")  # type: ignore[arg-type]  # refused on purpose


class Shifted:
    """A factory of environments whose actions aren't counted from 0, or aren't counted at all."""

    def __init__(self, action: spaces.Space[Any]) -> None:
        self.action = action

    def __call__(self) -> gk.TickEnv:
        return shifted(self.action)


def shifted(action: spaces.Space[Any]) -> gk.TickEnv:
    """An environment that notes what was done."""

    class Line(gk.TickEnv):
        metadata = {"name": "line_v0"}  # noqa: RUF012  # PettingZoo declares it so

        def __init__(self) -> None:
            super().__init__()
            self.possible_agents = ["a_0", "a_1"]
            seen = spaces.Discrete(3, start=1)
            self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
            self.action_spaces = dict.fromkeys(self.possible_agents, action)
            self.done: list[Any] = []

        def start(self, rng: Any, options: Any) -> None:
            self.done = []

        def tick(self, actions: Any) -> None:
            self.done.append(dict(actions))

        def observe(self, agent: Any) -> Any:
            return 2

    return Line()


def test_actions_are_counted_from_0() -> None:
    """The environment gets its own numbers; a Discrete observation is one-hot."""
    env = made(Shifted(spaces.Discrete(3, start=5)), time_limit=2)
    env.reset()
    env.step([0, 2])
    assert env.env.unwrapped.done == [{"a_0": 5, "a_1": 7}]
    assert env.get_obs_agent(0).tolist() == [0.0, 1.0, 0.0]
    env.close()


def test_what_cant_be_is_refused() -> None:
    """Each says where, and how to fix it."""
    with pytest.raises(SpecError, match="numbered actions"):
        made(Shifted(spaces.Box(0, 1, (2,), np.float32)), time_limit=3)
    with pytest.raises(SpecError, match="number of steps"):
        made(Shifted(spaces.Discrete(3)))
    with pytest.raises(SpecError, match="no policy"):
        made("warehouse", role="picker")
    with pytest.raises(SpecError, match="all agents learn"):
        made("warehouse", others="random")
    with pytest.raises(SpecError, match="with the role"):
        made("warehouse", role="pilot")
    with pytest.raises(SpecError, match="no such state"):
        made("two_robot_line", state="all")
    with pytest.raises(SpecError, match="state_space"):
        made(Shifted(spaces.Discrete(3)), time_limit=3, state="state")
    env = made("two_robot_line")
    with pytest.raises(OrderError, match="reset"):
        env.step([0, 0])
    env.reset()
    with pytest.raises(ActionError, match="one action for each"):
        env.step([0])
    with pytest.raises(SpecError, match="aren't saved"):
        env.save_replay()


def test_environment_is_audited_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it is made with too; `check=None` lets it pass."""
    asked: list[Any] = []
    monkeypatch.setattr(
        "gamekeeper.adapters.epymarl.checked",
        lambda spec, check, *, env_kwargs: asked.append((spec, check, env_kwargs)),
    )
    multi_agent_env("two_robot_line", env_kwargs={"n": 4}).close()
    assert asked == [("two_robot_line", "quick", {"n": 4})]
