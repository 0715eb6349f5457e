"""Audits and times wrappers: this library's beside SuperSuit's and PettingZoo's, in one run.

Each wrapper is put around environments in which agents end one by one or join late, with masks and
in both interfaces, and audited. Prints a JSON line for each: the checks that fail with it and not
without it. Then microseconds of processor time a step, of segments that take turns with each other.

    python benchmarks/wrappers.py audits --whose ours
    python benchmarks/wrappers.py audits --whose theirs     # where SuperSuit is installed
    python benchmarks/wrappers.py times                     # likewise
    python benchmarks/wrappers.py batches                   # over compiled batches
"""

import argparse
import json
import sys
import warnings
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent.parent))

import gymnasium.wrappers.vector
import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

import gamekeeper as gk
from gamekeeper.interface import wrappers as ours
from gamekeeper.vector import wrappers as batched
from tests.adapters.ledger import LedgerTicks, LedgerTurns

BUDGET: Final = 1_500  # steps of an audit
SEGMENT_S: Final = 0.05
ROUNDS: Final = 7
Wrap = Callable[[Any], Any]


def theirs() -> dict[str, tuple[str, Wrap]]:
    """Wrappers of other libraries, by what they do; with the form of observation for each."""
    from pettingzoo.utils import wrappers as pz

    try:
        import supersuit as ss
    except ImportError:
        print("SuperSuit isn't installed: left out", file=sys.stderr)
        return {"clip_actions (PettingZoo)": ("Box", pz.ClipOutOfBoundsWrapper)}

    return {
        "agent_id": ("Box", lambda env: ss.agent_indicator_v0(env)),
        "frame_stack": ("Box", lambda env: ss.frame_stack_v1(env, 3)),
        "flatten": ("image", lambda env: ss.flatten_v0(env)),
        "pad_observations": ("Box", lambda env: ss.pad_observations_v0(env)),
        "pad_actions": ("Discrete", lambda env: ss.pad_action_space_v0(env)),
        "clip_rewards": ("Box", lambda env: ss.clip_reward_v0(env, -1, 1)),
        "clip_actions": ("Box", lambda env: ss.clip_actions_v0(env)),
        "clip_actions of two roles": ("Box", lambda env: ss.clip_actions_v0(env)),
        "clip_actions (PettingZoo)": ("Box", pz.ClipOutOfBoundsWrapper),
        "sticky_actions": ("Discrete", lambda env: ss.sticky_actions_v0(env, 0.25)),
        "normalize": ("Box", lambda env: ss.normalize_obs_v0(env)),
    }


def own() -> dict[str, tuple[str, Wrap]]:
    """This library's, likewise."""
    return {
        "agent_id": ("Box", ours.agent_id),
        "frame_stack": ("Box", partial(ours.frame_stack, frames=3)),
        "flatten": ("image", ours.flatten_observations),
        "pad_actions": ("Discrete", partial(ours.pad_actions, instead=0)),
        "clip_rewards": ("Box", ours.clip_rewards),
        "clip_actions": ("Box", ours.clip_actions),
        "clip_actions of two roles": ("Box", ours.clip_actions),
        "sticky_actions": ("Discrete", ours.sticky_actions),
        "normalize": ("Box", lambda env: ours.normalize(env, learnt())),
        "mask_to_observation": ("Discrete", ours.mask_to_observation),
        "mask_to_info": ("Dict", ours.mask_to_info),
        "time_limit": ("Box", partial(ours.time_limit, steps=3)),
    }


def learnt() -> ours.Statistics:
    """Statistics of one episode of the ledger."""
    statistics = ours.Statistics()
    env = ours.normalize(LedgerTicks(ends="late"), statistics, learning=True)
    env.reset(seed=0)
    while env.agents:
        env.step({agent: env.action_space(agent).sample() for agent in env.agents})
    return statistics


def failed(build: Callable[[], Any]) -> set[str]:
    """Checks that fail in an audit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {verdict.id for verdict in gk.audit(build, budget=BUDGET).failed}


def audits(whose: str) -> None:
    """Prints what each wrapper breaks."""
    bare: dict[Any, set[str]] = {}
    table = own() if whose == "ours" else theirs()
    for (what, (form, wrap)), kind, ends in product(
        table.items(), (LedgerTicks, LedgerTurns), ("one by one", "late")
    ):
        roles = (
            2 if what.startswith("pad") or "two roles" in what else 1
        )  # two roles differ in their spaces
        make = partial(kind, seen=form, mask=form != "Box", ends=ends, roles=roles)
        key = kind, form, ends, roles
        line = {"wrapper": what, "whose": whose, "api": kind.__name__, "ends": ends}
        try:
            if key not in bare:
                bare[key] = failed(make)
            line["breaks"] = sorted(failed(lambda m=make, w=wrap: w(m())) - bare[key])
        except gk.errors.GamekeeperError as error:
            line["refuses"] = error.what
        print(json.dumps(line), flush=True)


class Ticks(ParallelEnv):
    """Four agents that see a vector or a picture, all at once, and go on for ever."""

    metadata = {"name": "ticks_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    render_mode = None

    def __init__(self, form: str) -> None:
        """Spaces of the form that a wrapper takes."""
        self.possible_agents = [f"dog_{i}" for i in range(4)]
        seen: Any = spaces.Box(0, 255, (36, 36, 3), np.uint8)
        if form != "image":
            seen = spaces.Box(0, 16, (8,), np.float32)
        done: Any = spaces.Box(-1, 1, (2,), np.float32)
        if form == "Discrete":
            done = spaces.Discrete(3)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, done)
        self._seen = {agent: np.ones(seen.shape, seen.dtype) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """Space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Everybody is there."""
        self.agents = self.possible_agents[:]
        return dict(self._seen), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Pays 2.0 to everybody."""
        flags = dict.fromkeys(self.agents, False)
        infos: Any = {agent: {} for agent in self.agents}
        return dict(self._seen), dict.fromkeys(self.agents, 2.0), flags, dict(flags), infos


class Turns(AECEnv):
    """The same, one after the other, by PettingZoo's own bookkeeping."""

    metadata = Ticks.metadata
    render_mode = None
    observation_space = Ticks.observation_space
    action_space = Ticks.action_space

    def __init__(self, form: str) -> None:
        """Spaces of the form that a wrapper takes."""
        Ticks.__init__(self, form)  # type: ignore[arg-type]  # no subclass, but the same attributes

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Everybody is there."""
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.at, self.agent_selection = 0, self.agents[0]

    def observe(self, agent: str) -> Any:
        """The same array at every turn."""
        return self._seen[agent]

    def step(self, action: Any) -> None:
        """Pays 2.0 to the actor."""
        self._cumulative_rewards[self.agent_selection] = 0.0
        self._clear_rewards()
        self.rewards[self.agent_selection] = 2.0
        self._accumulate_rewards()
        self.at = (self.at + 1) % 4
        self.agent_selection = self.agents[self.at]


def stepper(env: Any, is_aec: bool) -> Callable[[], None]:
    """One tick, or a round of four turns."""
    env.reset(seed=0)
    first = env.possible_agents[0]
    space = env.action_space(first)
    action = np.int64(1) if isinstance(space, spaces.Discrete) else np.full(2, 0.5, np.float32)
    if not is_aec:
        actions = dict.fromkeys(env.possible_agents, action)
        return lambda: env.step(actions) and None

    def turns() -> None:
        for _ in range(4):
            env.last()
            env.step(action)

    return turns


def timed(step: Callable[[], None]) -> float:
    """Microseconds of a step, over one segment."""
    began, count = process_time(), 0
    while process_time() - began < SEGMENT_S:
        for _ in range(50):
            step()
        count += 50
    return (process_time() - began) / count * 1e6


def times() -> None:
    """Prints microseconds of a tick of four agents, ours and theirs, and the ratio."""
    mine, other = own(), theirs()
    for what, (form, wrap) in other.items():
        name = what.partition(" ")[0]
        if what not in (name, f"{name} (PettingZoo)") or name not in mine or name == "normalize":
            continue
        for kind in (Ticks, Turns):
            is_aec = kind is Turns
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    theirs_ = stepper(wrap(kind(form)), is_aec)
                    ours_ = stepper(mine[name][1](kind(form)), is_aec)
                    pairs = [(timed(ours_), timed(theirs_)) for _ in range(ROUNDS)]
            except Exception as error:
                said = f"{type(error).__name__}: {str(error).splitlines()[:1]}"
                print(json.dumps({"wrapper": what, "api": kind.__name__, "refuses": said}))
                continue
            line = {
                "wrapper": what,
                "api": kind.__name__,
                "ours_us": round(median(one for one, _ in pairs), 2),
                "theirs_us": round(median(two for _, two in pairs), 2),
                "ratio": round(median(one / two for one, two in pairs), 3),
            }
            print(json.dumps(line), flush=True)


def batches() -> None:
    """Prints microseconds of a step of a compiled batch, bare and wrapped, and the ratio."""
    statistics = ours.Statistics()
    with batched.normalize(
        gk.vector.make("spread", 8, engine="kernel"), statistics, learning=True
    ) as env:
        env.reset()
        for _ in range(25):
            env.step(np.ones((8, 3), np.int64))
    wraps: dict[str, Wrap] = {
        "agent_id": batched.agent_id,
        "frame_stack of 4": partial(batched.frame_stack, frames=4),
        "flatten_observations": batched.flatten_observations,
        "normalize": lambda env: batched.normalize(env, statistics),
        "clip_rewards": batched.clip_rewards,
        "as_gymnasium": lambda env: env.as_gymnasium(),
    }
    for envs, (what, wrap) in product((64, 1024), wraps.items()):
        actions = np.ones((envs, 3), np.int64)
        steps = []
        for around in (lambda env: env, wrap):
            env = around(gk.vector.make("spread", envs, engine="kernel", copy=False))
            env.reset()
            shaped = actions.reshape(env.action_space.shape)
            steps.append(lambda env=env, shaped=shaped: env.step(shaped))
        gymnasiums = around_gymnasium(what, envs)
        rounds = [(timed(steps[0]), timed(steps[1]), gymnasiums()) for _ in range(ROUNDS)]
        pairs = [(one, two) for one, two, _ in rounds]
        line = {
            "wrapper": what,
            "sub_environments": envs,
            "bare_us": round(median(one for one, _ in pairs), 1),
            "wrapped_us": round(median(two for _, two in pairs), 1),
            "ratio": round(median(two / one for one, two in pairs), 3),
        }
        if rounds[0][2] is not None:
            line["to_gymnasium"] = round(median(two / three for _, two, three in rounds), 3)
        print(json.dumps(line), flush=True)


def around_gymnasium(what: str, envs: int) -> Callable[[], Any]:
    """A segment of Gymnasium's own vector wrapper around such a batch; None where it has none.

    Its wrappers refuse some batches that reset in the step that ends: this one resets in the next.
    """
    name = {
        "normalize": "NormalizeObservation",
        "clip_rewards": "ClipReward",
        "flatten_observations": "FlattenObservation",
    }.get(what)
    if name is None:
        return lambda: None
    venv = gk.vector.make(
        "spread", envs, engine="kernel", copy=False, autoreset="next_step"
    ).as_gymnasium()
    limits = (-1, 1) if what == "clip_rewards" else ()
    env = getattr(gymnasium.wrappers.vector, name)(venv, *limits)
    if what == "normalize":
        env.update_running_mean = False
    env.reset()
    actions = np.ones(env.action_space.shape, np.int64)
    return lambda: timed(lambda: env.step(actions))


def main() -> int:
    """Runs what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("audits", "times", "batches"))
    parser.add_argument("--whose", choices=("ours", "theirs"), default="theirs")
    given = parser.parse_args()
    if given.what == "audits":
        audits(given.whose)
    elif given.what == "times":
        times()
    else:
        batches()
    return 0


if __name__ == "__main__":
    sys.exit(main())
