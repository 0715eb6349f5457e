"""Reproducers that play: functions that are printed in findings, and raise while a fault is there.

None of them may name anything of ours but one another. `make` builds an environment, `seed` and
`actions` are an episode; in an AEC environment an action is one agent's.
"""

import copy
import pickle
import sys
import tracemalloc
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


def begin(make: Callable[[], Any], seed: int) -> Any:
    """An environment after its reset."""
    env = make()
    env.reset(seed=seed)
    return env


def step(env: Any, action: Any) -> Any:
    """Makes a step; in an AEC environment its agent calls last() first."""
    if hasattr(env, "agent_iter"):
        env.last()
    return env.step(action)


def go(env: Any, actions: Sequence[Any]) -> list[Any]:
    """All that the steps of an environment give."""
    seen = []
    for action in copy.deepcopy(actions):
        if hasattr(env, "agent_iter"):
            seen.append((env.agent_selection, copy.deepcopy(env.last())))
        seen.append(copy.deepcopy(env.step(action)))
        seen.append((copy.deepcopy(getattr(env, "rewards", None)), state_of(env)))
    return seen


def alike(one: Sequence[str], other: Sequence[str]) -> None:
    """Raises at the first turn in which two episodes differ, with both from there on."""
    for turn, pair in enumerate(zip(one, other, strict=False)):
        if pair[0] != pair[1]:
            same = next((k for k, (a, b) in enumerate(zip(*pair, strict=False)) if a != b), 0)
            seen = [text[max(same - 60, 0) : same + 100] for text in pair]
            raise AssertionError(f"turn {turn} differs:\n  ...{seen[0]}\n  ...{seen[1]}")
    assert len(one) == len(other), f"one episode has {len(one)} turns, the other {len(other)}"


def gives(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> list[Any]:
    """All that the steps of an episode give, but infos; an exception ends it."""
    env, seen = begin(make, seed), []
    for action in copy.deepcopy(actions):
        try:
            if hasattr(env, "agent_iter"):
                seen.append((env.agent_selection, copy.deepcopy(env.last()[:4])))
                env.step(action)
                seen.append(copy.deepcopy(env.rewards))
            else:
                seen.append(copy.deepcopy(env.step(action)[:4]))
        except Exception as error:
            return [*seen, repr(error)]
    return seen


def plays_repeat(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Plays twice, and compares what the steps gave."""
    np.testing.assert_equal(gives(make, seed, actions), gives(make, seed, actions))


def state_of(env: Any) -> Any:
    """Value of state(), if there is one."""
    try:
        return copy.deepcopy(env.state())
    except (NotImplementedError, AttributeError):
        return None


def copies_go_on(
    make: Callable[[], Any], seed: int, actions: Sequence[Any], at: int, way: str, who: str
) -> None:
    """Plays on in a copy, and then in its original; `apart`: once the original was reset."""
    env, other = begin(make, seed), begin(make, seed)
    go(other, actions[:at])
    expected = go(other, actions[at:])
    go(env, actions[:at])
    copied = copy.deepcopy(env) if way == "deepcopy" else pickle.loads(pickle.dumps(env))
    if who == "apart":
        env.reset(seed=seed + 1000)
    seen = go(copied, actions[at:])
    if who == "original":
        seen = go(env, actions[at:])
    np.testing.assert_equal(seen, expected)


def actions_stay(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Compares actions with what they were before their step."""
    env = begin(make, seed)
    for action in actions:
        before = copy.deepcopy(action)
        step(env, action)
        np.testing.assert_equal(action, before)


def overwrite(value: Any) -> None:
    """Writes into all arrays of a value but action masks."""
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value[...] = value == 0
    for key, item in value.items() if isinstance(value, dict) else ():
        if key != "action_mask":
            overwrite(item)
    for item in value if isinstance(value, (list, tuple)) else ():
        overwrite(item)


def overwrite_masks(value: Any) -> None:
    """Writes into all action masks of a value."""
    for key, item in value.items() if isinstance(value, dict) else ():
        (overwrite if key == "action_mask" else overwrite_masks)(item)


def story(make: Callable[[], Any], seed: int, actions: Sequence[Any], *, meddles: bool) -> Any:
    """All that an episode gives, with actions overwritten after their step or not."""
    env = make()
    told = [copy.deepcopy(env.reset(seed=seed))]
    for action in copy.deepcopy(actions):
        if hasattr(env, "agent_iter"):
            told.append((env.agent_selection, copy.deepcopy(env.last())))
        told.append(copy.deepcopy(env.step(action)))
        told.append(copy.deepcopy(getattr(env, "rewards", None)))
        if meddles:
            overwrite(action)
            if not hasattr(env, "agent_iter"):
                action.clear()
    if env.agents and hasattr(env, "agent_iter"):
        told.append(copy.deepcopy(env.last()))
    return told


def actions_are_read_at_once(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Compares an episode with one whose actions are overwritten after their step."""
    told = [story(make, seed, actions, meddles=meddles) for meddles in (True, False)]
    np.testing.assert_equal(*told)


def states_of(env: Any, seed: int, actions: Sequence[Any]) -> list[Any]:
    """Every state of an episode."""
    env.reset(seed=seed)
    states = [np.array(env.state())]
    for action in actions:
        step(env, action)
        states.append(np.array(env.state()))
    return states


def states_forget(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Compares the states of an episode with those of the same one again."""
    env = make()
    first, second = states_of(env, seed, actions), states_of(env, seed, actions)
    assert all(map(np.array_equal, first, second)), "the same episode again has other states"


def states_move(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks for a state that differs from the first."""
    first, *states = states_of(make(), seed, actions)
    assert any(not np.array_equal(first, state) for state in states), "it never changes"


def states_are_current(
    make: Callable[[], Any], seed: int, actions: Sequence[Any], turn: int, other: Any
) -> None:
    """Plays another action at one turn, and compares the states after the next."""
    one = states_of(make(), seed, actions[: turn + 2])
    two = states_of(make(), seed, [*actions[:turn], other, actions[turn + 1]])
    is_same = np.array_equal(one[turn + 1], two[turn + 1])
    assert not is_same, "the other action is shown later"


def frames_stay(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Compares every frame at the end with what it was at first."""
    env = begin(make, seed)
    frames = [env.render()]
    copies = [np.array(frames[0])]
    for action in actions:
        step(env, action)
        frames.append(env.render())
        copies.append(np.array(frames[-1]))
    assert all(map(np.array_equal, frames, copies)), "earlier frames changed"


def written_frames_are_gone(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Writes into a frame, and looks for it in the next one."""
    env = begin(make, seed)
    frame = env.render()
    for action in actions:
        step(env, action)
        frame = env.render()
    before = np.array(frame)
    marks = np.resize(np.arange(1, 98), before.shape).astype(before.dtype)
    frame[...] = np.where(before == marks, marks + 1, marks)
    written, after = np.array(frame), env.render()
    shown = (after != before) & (after == written)
    assert shown.sum() < 0.9 * max((after != before).sum(), 1), "what was written shows again"


def cycles_close(make: Callable[[], Any], seed: int) -> None:
    """Compares observations at the start of a cycle with those that agents act on."""
    env = begin(make, seed)
    for _ in range(200):
        seen = {agent: copy.deepcopy(env.observe(agent)) for agent in env.agents}
        for agent in list(seen):
            if not env.agents or agent != env.agent_selection:
                break
            observation, _, terminated, truncated, info = env.last()
            if terminated or truncated:
                env.step(None)
                continue
            np.testing.assert_equal(observation, seen[agent])
            env.step(choice(env, agent, observation, info))
        if not env.agents:
            break


def choice(env: Any, agent: Any, observation: Any, info: Any) -> Any:
    """A random action that the mask allows, if there is one."""
    for place in (observation, info):
        if isinstance(place, dict) and "action_mask" in place:
            mask = place["action_mask"]
            is_nested = isinstance(mask, (tuple, dict))  # one for each part of the space
            flags = mask if is_nested else np.asarray(mask).astype(np.int8)
            return env.action_space(agent).sample(flags)
    return env.action_space(agent).sample()


def becomes_parallel(make: Callable[[], Any], seed: int) -> None:
    """Plays episodes in PettingZoo's own conversion to the Parallel interface."""
    from pettingzoo.utils.conversions import aec_to_parallel

    env = aec_to_parallel(make())
    for draw in range(20):
        env.reset(seed=seed)
        for space in map(env.action_space, env.possible_agents):
            space.seed(draw)
        for _ in range(200):
            inner = env.aec_env
            if not env.agents:
                break
            env.step({a: choice(env, a, inner.observe(a), inner.infos.get(a)) for a in env.agents})


def agents_leave_by_ending(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks in an AEC environment for agents that left and never ended."""
    env, before = begin(make, seed), []
    ended: set[Any] = set()
    for action in actions:
        before = list(env.agents)
        step(env, action)
        flagged = {**env.terminations, **env.truncations}
        ended |= {a for a in flagged if env.terminations.get(a) or env.truncations.get(a)}
    silent = [a for a in before if a not in env.agents and a not in ended]
    assert not silent, silent


def flags_stay_up(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks in an AEC environment for agents that ended and go on."""
    env = begin(make, seed)
    ended: set[Any] = set()
    for action in actions:
        step(env, action)
        ended &= set(env.agents)
        back = [a for a in ended if not env.terminations[a] and not env.truncations[a]]
        assert not back, back
        ended |= {a for a in env.agents if env.terminations[a] or env.truncations[a]}


def rewards_add_up(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Adds rewards up in an AEC environment, and compares the sum with last() at every turn."""
    env = begin(make, seed)
    owed = dict.fromkeys(env.agents, 0.0)
    for turn in range(len(actions) + 1):
        if not env.agents:
            break
        agent, told = env.agent_selection, env.last()[1]
        sums = f"turn {turn}: last() of {agent} gives {told}, its rewards are {owed[agent]}"
        assert np.isclose(told, owed[agent], rtol=1e-5, atol=0), sums
        if turn < len(actions):
            owed[agent] = 0.0  # whoever acts has been told
            env.step(actions[turn])
            for name, reward in env.rewards.items():
                owed[name] = owed.get(name, 0.0) + reward


def dead_steps_pay_nobody(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks for rewards after the None step of a dead agent."""
    env, before = begin(make, seed), {}
    for action in actions:
        before = dict(env.rewards)
        step(env, action)
    again = {agent: reward for agent, reward in env.rewards.items() if reward}
    assert not again, ("after the None step of a dead agent", before, again)


def agent_iter_names_actors(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Compares the names of agent_iter with agent_selection."""
    env, names = begin(make, seed), []
    for agent, action in zip(env.agent_iter(len(actions)), actions, strict=False):
        assert agent == env.agent_selection, (agent, env.agent_selection)
        names.append(agent)
        step(env, action)
    assert len(names) == len(actions), names


def shows_order(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Raises with the order of turns: the finding says where it isn't as declared."""
    env, movers = begin(make, seed), []
    for action in actions:
        agent = env.agent_selection
        if not (env.terminations[agent] or env.truncations[agent]):
            movers.append(agent)
        step(env, action)
    raise AssertionError(f"the order was {movers}")


def dead_agents_wait(
    make: Callable[[], Any], seed: int, actions: Sequence[Any], agent: str, most: int
) -> None:
    """Counts turns that an ended agent waits for its last one."""
    env, waits = begin(make, seed), 0
    for action in actions:
        ended = [str(a) for a in env.agents if env.terminations[a] or env.truncations[a]]
        is_waiting = agent in ended and str(env.agent_selection) != agent
        waits = waits + 1 if is_waiting else 0
        step(env, action)
    assert waits < most, waits


def gives_dictionaries(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks at the form of what reset and step return."""
    env = make()
    out, count = env.reset(seed=seed), 2
    for action in actions:
        out, count = env.step(action), 5
    assert isinstance(out, tuple), out
    assert len(out) == count, out
    assert all(hasattr(part, "items") and hasattr(part, "keys") for part in out), out


def metadata_stays(
    make: Callable[[], Any], plain: Callable[[], Any], seed: int, actions: Sequence[Any], done: str
) -> None:
    """Compares metadata before and after use."""
    env = plain()
    before = copy.deepcopy(env.metadata)
    if done == "make":
        make()
    else:
        env.reset(seed=seed)
    if done == "render":
        env.render()
    for action in actions if done == "play" else ():
        step(env, action)
    assert env.metadata == before, (before, env.metadata)


def work(function: Callable[..., Any], *arguments: Any) -> Any:
    """Lines of Python that a call runs, and the bytes that it takes."""
    lines = 0

    def tracer(frame: Any, event: str, argument: Any) -> Any:
        nonlocal lines
        lines += event == "line"
        return tracer

    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    sys.settrace(tracer)
    try:
        function(*arguments)
    finally:
        sys.settrace(None)
    peak = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    return np.array([lines, peak])


def agents_fare_alike(
    make: Callable[[], Any], agents: Sequence[str], episodes: int, level: float
) -> None:
    """Permutes agents within each episode, and compares the sums of how they fared."""
    table = np.array([fares(make, agents, seed) for seed in range(episodes)])
    rounding = 1e-9 * np.nanmax(np.abs(table), axis=(0, 1)) + 1e-300
    table -= np.nanmean(table, axis=1, keepdims=True)
    table /= np.maximum(np.sqrt(np.nanmean(table**2, axis=(0, 1))), rounding)
    rng, hits = np.random.default_rng(0), 1
    seen = np.abs(np.nansum(table, axis=0)).max()
    for _ in range(999):
        again = np.array([mixed(rows, rng) for rows in table])
        hits += np.abs(np.nansum(again, axis=0)).max() >= seen - 1e-12
    assert hits / 1000 > level, np.nanmean(table, axis=0)


def mixed(rows: Any, rng: Any) -> Any:
    """The rows of agents that were there from the start, permuted."""
    rows, there = rows.copy(), ~np.isnan(rows[:, 0])
    rows[there] = rng.permutation(rows[there])
    return rows


def fares(make: Callable[[], Any], agents: Sequence[str], seed: int) -> Any:
    """Return and number of actions of each agent under random play."""
    env = make()
    out = env.reset(seed=seed)
    found = {a: [0.0, 0.0] for a in agents if a in env.agents}
    for place, agent in enumerate(env.agents):
        env.action_space(agent).seed(1000 * seed + place)
    if hasattr(env, "agent_iter"):
        for agent in env.agent_iter(1000):
            observation, _, terminated, truncated, info = env.last()
            ended = terminated or truncated
            env.step(None if ended else choice(env, agent, observation, info))
            for each in found:
                found[each][0] += env.rewards.get(each, 0.0)
            if agent in found and not ended:
                found[agent][1] += 1
    for _ in range(0 if hasattr(env, "agent_iter") else 200):
        if not env.agents:
            break
        actions = {a: choice(env, a, out[0].get(a), out[-1].get(a)) for a in env.agents}
        out = env.step(actions)
        for agent in found.keys() & actions.keys():
            found[agent][0] += out[1].get(agent, 0.0)
            found[agent][1] += 1
    return [found.get(a, [np.nan, np.nan]) for a in agents]


def frames_of(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> list[Any]:
    """The frames of an episode."""
    env = begin(make, seed)
    frames = [env.render()]
    for action in actions:
        step(env, action)
        frames.append(env.render())
    return frames


def is_frame(mode: str, frame: Any) -> bool:
    """A frame has the form of its render mode; one of the environment's own promises none."""
    if mode.endswith("_list"):
        inner = mode.removesuffix("_list")
        return isinstance(frame, list) and all(is_frame(inner, each) for each in frame)
    if mode == "ansi":
        return isinstance(frame, str)
    is_picture = isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.ndim == 3
    return mode != "rgb_array" or bool(is_picture and frame.shape[2] == 3 and frame.size)


def frames_have_their_form(
    make: Callable[[], Any], seed: int, actions: Sequence[Any], mode: str
) -> None:
    """Compares frames with what their render mode promises."""
    wrong = [frame for frame in frames_of(make, seed, actions) if not is_frame(mode, frame)]
    assert not wrong, repr(wrong[-1])[:200]


def frames_have_one_shape(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Counts the shapes of frames."""
    shapes = {np.shape(frame) for frame in frames_of(make, seed, actions)}
    assert len(shapes) == 1, shapes


def frames_move(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks for a frame that differs from the first."""
    first, *frames = frames_of(make, seed, actions)
    assert any(not np.array_equal(first, frame) for frame in frames), "nothing ever moves"


def state_has_shape(env: Any) -> None:
    """Compares the shape of a state with that of the space."""
    state, space = env.state(), env.state_space
    assert np.shape(state) == space.shape, (np.shape(state), space)


def state_keeps_shape(env: Any, seed: int, make: Callable[[], Any]) -> None:
    """Compares the shape of a state with that of the first."""
    shape, first = np.shape(env.state()), np.shape(begin(make, seed).state())
    assert shape == first, (shape, "and at the reset", first)


def state_has_dtype(env: Any) -> None:
    """Compares the dtype of a state with that of the space."""
    dtype, space = np.asarray(env.state()).dtype, env.state_space
    assert dtype == space.dtype, (dtype, space)


def state_keeps_dtype(env: Any, seed: int, make: Callable[[], Any]) -> None:
    """Compares the dtype of a state with that of the first."""
    dtype, first = env.state().dtype, begin(make, seed).state().dtype
    assert dtype == first, (dtype, first)


def names_stay(env: Any, make: Callable[[], Any]) -> None:
    """Compares possible agents with those of a new environment."""
    named, expected = list(env.possible_agents), list(make().possible_agents)
    assert named == expected, (named, expected)


def names_stay_after_reset(env: Any, seed: int, make: Callable[[], Any]) -> None:
    """Compares possible agents after a reset with those of a new environment."""
    env.reset(seed=seed)
    names_stay(env, make)


def reset_forgets(env: Any, seed: int, actions: Sequence[Any], make: Callable[[], Any]) -> None:
    """Compares what a reset in mid-episode gives with what a new environment gives."""
    if not env.agents:
        env.reset(seed=seed)
        env.step(actions[0])
    fresh = make()
    expected, seen = fresh.reset(seed=seed), env.reset(seed=seed)
    if hasattr(env, "agent_iter"):
        np.testing.assert_equal(env.last()[0], fresh.last()[0])
    else:
        np.testing.assert_equal(seen[0], expected[0])


def last_turn(env: Any, actions: Sequence[Any]) -> tuple[list[Any], Any, bool]:
    """Plays; the agents before the last turn, the agent of that turn, and its end."""
    before, actor, ended = [], None, False
    for action in actions:
        before, actor = list(env.agents), env.agent_selection
        ended = env.terminations[actor] or env.truncations[actor]
        step(env, action)
    return before, actor, ended


def dead_turns_are_taken(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks for agents that left without their last turn."""
    env = begin(make, seed)
    before, actor, ended = last_turn(env, actions)
    gone = set(before) - set(env.agents)
    assert gone <= ({actor} if ended else set()), (gone, "left with the step of", actor)


def dead_steps_remove(make: Callable[[], Any], seed: int, actions: Sequence[Any]) -> None:
    """Looks for an agent that stays after its last turn."""
    env = begin(make, seed)
    _, actor, ended = last_turn(env, actions)
    assert not (ended and actor in env.agents), (actor, env.agents)


def metadata_lists_modes(make: Callable[[], Any]) -> None:
    """Looks at the list of render modes."""
    modes = make().metadata.get("render_modes", [])
    assert isinstance(modes, (list, tuple)), modes
    assert all(isinstance(mode, str) for mode in modes), modes


def metadata_has_mode(make: Callable[[], Any]) -> None:
    """Looks for the render mode in the list of them."""
    env = make()
    modes = env.metadata.get("render_modes", ())
    assert env.render_mode in modes, (env.render_mode, modes)


def closes(make: Callable[[], Any], seed: int, resets: int, times: int) -> None:
    """Calls close() before or after a reset, once or twice."""
    env = make()
    for _ in range(resets):
        env.reset(seed=seed)
    for _ in range(times):
        env.close()


def endings_take_all(env: Any, terminations: Any, truncations: Any) -> None:
    """Looks for agents that go on where others have ended."""
    ended = [a for a in terminations if terminations[a] or truncations.get(a)]
    going_on = [a for a in env.agents if a not in ended]
    assert not (ended and going_on), (ended, going_on)


def no_truncation_alone(env: Any, terminations: Any, truncations: Any) -> None:
    """Looks for agents that are truncated and not terminated."""
    early = [a for a in truncations if truncations[a] and not terminations.get(a)]
    assert not early, early


def no_termination_alone(env: Any, terminations: Any, truncations: Any) -> None:
    """Looks for agents that are terminated and not truncated."""
    ended = [a for a in terminations if terminations[a] and not truncations.get(a)]
    assert not ended, "terminated by a time limit: " + ", ".join(map(str, ended))
