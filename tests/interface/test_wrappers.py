"""Wrappers: spaces, masks, infos, seeds, endings and rosters stay what they were."""

import itertools
from functools import partial

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo.test import api_test, parallel_api_test

import gamekeeper as gk
from gamekeeper.errors import ActionError, OrderError, PolicyError, SpecError
from gamekeeper.interface import wrappers
from gamekeeper.interface.wrappers.action_wrappers import RepeatedActions
from tests.adapters.ledger import LedgerTicks, LedgerTurns


def statistics():
    """Statistics that a few decisions of the ledger have made."""
    found = wrappers.Statistics()
    played(wrappers.normalize(LedgerTicks(ends="late"), found, learning=True), 0)
    return found


WRAPPED = {
    "agent_id": ("Box", wrappers.agent_id),
    "agent_id of pictures": ("image", wrappers.agent_id),
    "agent_id of Dict": ("nested Dict", wrappers.agent_id),
    "frame_stack": ("Box", partial(wrappers.frame_stack, frames=3)),
    "frame_stack of Dict": ("Dict", partial(wrappers.frame_stack, frames=3, padding="zeros")),
    "flatten": ("nested Dict", wrappers.flatten_observations),
    "pad_actions": ("Discrete", partial(wrappers.pad_actions, instead=0)),
    "clip_rewards": ("Box", wrappers.clip_rewards),
    "clip_actions": ("Box", wrappers.clip_actions),
    "sticky_actions": ("MultiDiscrete", partial(wrappers.sticky_actions, probability=0.5)),
    "normalize": ("Box", lambda env: wrappers.normalize(env, statistics())),
    "mask_to_observation": ("Discrete", wrappers.mask_to_observation),
    "mask_to_info": ("Dict", wrappers.mask_to_info),
    "time_limit": ("Box", partial(wrappers.time_limit, steps=3)),
}
RIGHT = np.ones(1, np.float32)
MASKED = {"Discrete", "MultiDiscrete", "Dict"}


def built(name, kind=LedgerTicks, ends="late"):
    """The ledger inside a wrapper."""
    form, wrap = WRAPPED[name]
    return wrap(kind(seen=form, mask=form in MASKED, ends=ends))


def legal(env, agent, seen, info, number):
    """An action that the mask allows, by a number."""
    mask = seen.get("action_mask") if isinstance(seen, dict) else None
    mask = info.get("action_mask") if mask is None else mask
    space = env.action_space(agent)
    if isinstance(space, spaces.Discrete):
        return int(np.flatnonzero(mask)[number % int(np.sum(mask))]) if mask is not None else 1
    if isinstance(space, spaces.MultiDiscrete):
        return np.array([number % 2 * 2, 1])
    return np.full(space.shape, number % 3 - 1, space.dtype)


def played(env, seed):
    """Everything that one episode hands out, by agents that act by their own number and time."""
    rows, numbers = [], itertools.count()
    if hasattr(env, "agent_selection") or isinstance(env.unwrapped, gk.TurnEnv):
        env.reset(seed=seed)
        for agent in env.agent_iter():
            seen, reward, terminated, truncated, info = env.last()
            rows.append((agent, seen, reward, terminated, truncated, info))
            assert env.observation_space(agent).contains(seen)
            done = terminated or truncated
            env.step(None if done else legal(env, agent, seen, info, next(numbers)))
        return rows
    seen, infos = env.reset(seed=seed)
    while env.agents:
        rows.append((seen, infos))
        assert all(env.observation_space(agent).contains(one) for agent, one in seen.items())
        actions = {a: legal(env, a, seen[a], infos[a], next(numbers)) for a in env.agents}
        seen, rewards, terminations, truncations, infos = env.step(actions)
        rows.append((rewards, terminations, truncations))
    return [*rows, (seen, infos)]


@pytest.mark.filterwarnings("ignore::UserWarning:pettingzoo.test.*")  # zeros, and Dict spaces
@pytest.mark.parametrize("name", WRAPPED)
def test_wrapped_environments_pass_pettingzoos_tests(name, capsys) -> None:
    """Agents that end one by one and late joiners, in both interfaces."""
    api_test(built(name, LedgerTurns), num_cycles=20)
    if WRAPPED[name][0] not in MASKED:  # its samples for Parallel read no masks in infos
        parallel_api_test(built(name), num_cycles=20)


@pytest.mark.parametrize("kind", [LedgerTicks, LedgerTurns])
@pytest.mark.parametrize("name", WRAPPED)
def test_a_seed_gives_the_same_episode(name, kind) -> None:
    """A second instance, and a used one, play the same; observing more often changes nothing."""
    env, other = built(name, kind), built(name, kind)
    first, second, third = (played(one, 5) for one in (env, other, env))
    np.testing.assert_equal(second, first)
    np.testing.assert_equal(third, first)


@pytest.mark.parametrize("ends", ["together", "one by one", "late"])
def test_frames_are_those_that_were_decided_by(ends) -> None:
    """The stack is the hand-made one, whoever is there, and whatever is written into it."""
    env, bare = wrappers.frame_stack(LedgerTicks(ends=ends), 3), LedgerTicks(ends=ends)
    for seed in (1, 2):
        (shown, _), (plain, _) = env.reset(seed=seed), bare.reset(seed=seed)
        frames = {agent: [plain[agent]] * 3 for agent in plain}
        while env.agents:
            assert shown.keys() == plain.keys()
            for agent in shown:
                np.testing.assert_array_equal(shown[agent], np.concatenate(frames[agent]))
                shown[agent][:] = 0
            actions = dict.fromkeys(env.agents, RIGHT)
            shown, plain = env.step(actions)[0], bare.step(actions)[0]
            frames = {a: [*frames.get(a, [plain[a]] * 3)[1:], plain[a]] for a in plain}


def test_frames_of_turns_are_those_that_were_decided_by() -> None:
    """Observing adds no frame."""
    turns = wrappers.frame_stack(LedgerTurns(), 2, padding="zeros")
    turns.reset(seed=1)
    agent = turns.agent_selection
    own = turns.env.observe(agent)
    for _ in range(3):
        np.testing.assert_array_equal(turns.observe(agent), np.concatenate([own * 0, own]))
    turns.step(RIGHT)
    later = turns.env.observe(agent)
    np.testing.assert_array_equal(turns.observe(agent), np.concatenate([own, later]))


def test_agents_are_told_apart() -> None:
    """A vector gets a one-hot number, a picture channels, a Dict a key."""
    for form in ("Box", "image", "Dict"):
        env = wrappers.agent_id(LedgerTicks(seen=form))
        seen, _ = env.reset(seed=0)
        for place, agent in enumerate(seen):
            number = seen[agent]["agent_id"] if form == "Dict" else seen[agent][..., -3:]
            expected = np.eye(3)[place] * (255 if form == "image" else 1)
            np.testing.assert_array_equal(number, np.broadcast_to(expected, number.shape))


def test_a_time_limit_truncates_the_live_alone() -> None:
    """In both interfaces; those that a rule ended in the last step are terminated and no more."""
    env = wrappers.time_limit(LedgerTicks(ends="one by one"), 3)
    env.reset(seed=0)  # dog_0 ends after two ticks, dog_1 after three, dog_2 would after five
    for _ in range(3):
        _, _, terminations, truncations, _ = env.step(dict.fromkeys(env.agents, RIGHT))
    assert (terminations, truncations["dog_2"]) == ({"dog_1": False, "dog_2": False}, True)
    assert env.agents == []
    with pytest.raises(OrderError, match="left"):
        env.step({})

    turns = wrappers.time_limit(LedgerTurns(), 4)
    turns.reset(seed=0)
    for _ in range(4):
        turns.step(RIGHT)
    assert turns.truncations == dict.fromkeys(turns.possible_agents, True)
    assert not any(turns.terminations.values())
    for agent in turns.agent_iter():
        assert turns.last()[0] is not None, agent
        turns.step(None)
    assert turns.agents == []
    turns.reset(seed=0)
    assert not any(turns.truncations.values())


def test_cumulative_rewards_are_sums_of_clipped_ones() -> None:
    """Each turn's reward is clipped, and what an agent is given at its turn is their sum."""
    env, bare = wrappers.clip_rewards(LedgerTurns(), -1, 1), LedgerTurns()
    env.reset(seed=0)
    bare.reset(seed=0)
    sums = dict.fromkeys(env.agents, 0.0)
    while env.agents:
        agent, ends = env.agent_selection, any(env.last()[2:4])
        assert env.last()[1] == sums[agent]
        action = None if ends else RIGHT
        env.step(action)
        bare.step(action)
        if not ends:
            sums[agent] = 0.0
            for other, paid in bare.rewards.items():
                assert env.rewards[other] == min(paid, 1)
                sums[other] += min(paid, 1)


def test_masks_go_into_observations_and_back() -> None:
    """There and back again is the same episode, but for the form of the mask."""
    for kind in (LedgerTicks, LedgerTurns):
        there = wrappers.mask_to_observation(kind(mask=True))
        back = wrappers.mask_to_info(there)
        assert back.observation_space("dog_0") == kind().observation_space("dog_0")
        np.testing.assert_equal(played(back, 3), played(kind(mask=True), 3))


def test_added_actions_are_masked_and_refused() -> None:
    """An agent with three actions of five has a mask of five; what it doesn't have is refused."""
    env = wrappers.pad_actions(LedgerTicks(seen="Discrete", roles=2))
    _, infos = env.reset(seed=0)
    assert {env.action_space(agent).n for agent in env.agents} == {5}
    assert infos["dog_0"]["action_mask"].tolist() == [1, 1, 1, 0, 0]
    assert "action_mask" not in infos["cat_0"]
    with pytest.raises(ActionError, match="doesn't have this action"):
        env.step({"dog_0": 4, "dog_1": 0, "cat_0": 4})
    env.step({"dog_0": 2, "dog_1": 0, "cat_0": 4})
    stands_in = wrappers.pad_actions(LedgerTicks(seen="Discrete", roles=2), instead=0)
    stands_in.reset(seed=0)
    stands_in.step({"dog_0": 4, "dog_1": 0, "cat_0": 4})


def test_repeated_actions_are_legal_ones() -> None:
    """With a high probability most are repeated, never one that the mask forbids."""
    env = wrappers.sticky_actions(LedgerTicks(seen="Discrete", mask=True), 0.99)
    repeats = 0
    for seed in range(4):
        seen, infos = env.reset(seed=seed)
        last = {}
        while env.agents:
            actions = {a: legal(env, a, seen[a], infos[a], seed + 1) for a in env.agents}
            flags = {a: infos[a]["action_mask"] for a in env.agents}
            seen, *_, infos = env.step(actions)
            done = {a: env.unwrapped.did[env.possible_agents.index(a)] - 1 for a in actions}
            assert all(flags[a][done[a]] for a in actions)
            repeats += sum(done[a] == last.get(a) != actions[a] for a in actions)
            last = done
    assert repeats


def test_repeated_actions_are_legal_ones_of_spaces_that_begin_elsewhere() -> None:
    """A mask's places count from the first action of a MultiDiscrete space."""
    env = LedgerTicks(seen="MultiDiscrete", mask=True)
    acts = spaces.MultiDiscrete([3, 2], start=[7, 4])
    env.action_space = lambda agent: acts
    sticky = RepeatedActions(0.99)
    sticky.bind(env)
    sticky.begin(0)
    last, other = np.array([9, 4]), np.array([7, 5])
    sticky.keep("dog_0", last)
    for flags, is_repeated in (([0, 0, 1, 1, 0], True), ([1, 1, 0, 1, 1], False)):
        sticky.given("dog_0", None, {"action_mask": np.array(flags, np.int8)})
        done = [sticky.action("dog_0", other) for _ in range(20)]
        assert any(np.array_equal(each, last) for each in done) is is_repeated


def test_statistics_are_those_of_the_decisions(tmp_path) -> None:
    """Mean and variance are NumPy's; a file of them gives the same; a policy brings them along."""
    found, rows = wrappers.Statistics(), []
    env = wrappers.normalize(LedgerTicks(), found, learning=True)
    for seed in range(3):
        env.reset(seed=seed)
        while env.agents:
            rows += [env._seen[agent].copy() for agent in env.agents]
            env.step(dict.fromkeys(env.agents, RIGHT))
    mean, variance, count = found.of("dog_0").parts[""]
    np.testing.assert_allclose(mean, np.mean(rows, 0), atol=1e-4)
    np.testing.assert_allclose(variance, np.var(rows, 0), rtol=1e-3, atol=1e-3)
    assert round(count) == len(rows)

    kept = wrappers.Statistics.load(found.save(tmp_path / "statistics.json"))
    frozen, bare = wrappers.normalize(LedgerTicks(), kept), LedgerTicks()
    shown, plain = frozen.reset(seed=9)[0], bare.reset(seed=9)[0]
    np.testing.assert_array_equal(shown["dog_1"], found.of("dog_1")(plain["dog_1"]))
    policy = kept.policy(lambda observation, agent, info, rng: observation)
    np.testing.assert_array_equal(policy(plain["dog_1"], "dog_1", {}, None), shown["dog_1"])
    before = policy.version
    assert kept.policy(policy).version != before
    with pytest.raises(PolicyError, match="no statistics of the role 'cat'"):
        kept.of("cat_0")


class Terms(gk.TickEnv):
    """Pays in two terms."""

    metadata = {"name": "terms_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        super().__init__(horizon=3)
        self.possible_agents = ["a"]
        self.observation_spaces = self.action_spaces = {"a": spaces.Discrete(3)}

    def start(self, rng, options) -> None:
        """Nothing to begin."""

    def tick(self, actions) -> None:
        self.add_reward("a", 1.0 + self.turns, term="goal")
        self.add_reward("a", -1.0, term="time")

    def observe(self, agent):
        return np.int64(0)


def test_weighed_rewards_are_one_number() -> None:
    """By term, and by part of a vector."""
    env = wrappers.weigh_rewards(Terms(), {"goal": 2.0})
    env.reset(seed=0)
    assert [env.step({"a": 0})[1] for _ in range(3)] == [{"a": 4.0}, {"a": 6.0}, {"a": 8.0}]
    weighed = wrappers.weigh_rewards(env, [1.0, 3.0]).transform
    assert weighed.reward("a", np.array([2, 1])) == 5.0
    with pytest.raises(SpecError, match="no reward terms"):
        wrappers.weigh_rewards(wrappers.clip_rewards(Terms()), {"goal": 1.0})


def test_what_a_wrapper_cannot_take_is_refused() -> None:
    """Each error names the agent and a fix."""
    with pytest.raises(SpecError, match="normalize can't take the space of 'dog_0'"):
        wrappers.normalize(LedgerTicks(seen="image"), wrappers.Statistics())
    with pytest.raises(SpecError, match="pad_actions can't take"):
        wrappers.pad_actions(LedgerTicks(seen="Box"))
    with pytest.raises(SpecError, match="can't be clipped"):
        wrappers.clip_rewards(LedgerTicks(), 1, 2)
    with pytest.raises(SpecError, match="only a PettingZoo environment"):
        wrappers.agent_id(object())
    with pytest.raises(SpecError, match="no such time limit"):
        wrappers.time_limit(LedgerTicks(), 0)
