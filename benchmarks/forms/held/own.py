"""Own bookkeeping and conversions (held back)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import AgentSelector
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Choir(Ticks):
    """Three singers choose (pitch, volume) at once, as AEC by PettingZoo's wrapper.

    Singers that agree on a pitch are paid by the number that agree, all by the loudest volume.
    """

    def __init__(self) -> None:
        super().__init__(names("singer", 3), box(3, -1, 4), MultiDiscrete([4, 3]), 12)

    def _start(self, rng: Any) -> None:
        self.pitch, self.score = dict.fromkeys(self.agents, -1), int(rng.integers(1, 4))

    def _tick(self, actions: Any) -> None:
        self.pitch = {agent: int(actions[agent][0]) for agent in self.agents}
        loudest = max(int(actions[agent][1]) for agent in self.agents)
        for agent, pitch in self.pitch.items():
            self._pay(agent, list(self.pitch.values()).count(pitch) * self.score - loudest)

    def _look(self, agent: str) -> Any:
        others = sorted(p for name, p in self.pitch.items() if name != agent)
        return vector(self.pitch[agent], *others)


def choir_in_turns() -> Any:
    """The choir as AEC: the wrapper gathers a tick's notes and plays them at its end."""
    return parallel_to_aec(Choir())


CHOIR = Form(
    name="choir_in_turns",
    api="aec",
    stages=(("singer",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "chord": Part("singer", "earner", "individual"),
        "noise": Part("singer", "all", "shared"),
    },
    endings={"time": TIME},
    symmetric={"singer": True},
    horizon=12,
    influence=links("singer singer reward 0", "singer singer observation 1"),
    order_sensitive=None,
    advice="parallel",
)


class Sealed(Turns):
    """Four neighbors put 0 to 3 coins into a hat in turn; it is emptied when the round is over.

    The sum is multiplied by a drawn factor, shown at the start, and divided among all.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "hat_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self) -> None:
        super().__init__(names("neighbor", 4), box(2, 0, 40), Discrete(4), 14)

    def _start(self, rng: Any) -> None:
        self.factor, self.hat, self.before = float(rng.uniform(1, 3)), 0, 0

    def _act(self, agent: str, action: Any) -> None:
        self.hat += int(action)
        self._pay(agent, -int(action))

    def _close(self) -> None:
        for agent in self._live():
            self._pay(agent, self.hat * self.factor / 4)
        self.before, self.hat, self.factor = self.hat, 0, float(self.rng.uniform(1, 3))

    def _look(self, agent: str) -> Any:
        return vector(self.factor, self.before)


def hat_at_once() -> Any:
    """The hat as Parallel by PettingZoo's wrapper: its order has no effect."""
    return aec_to_parallel(Sealed())


HAT = Form(
    name="hat_at_once",
    api="parallel",
    stages=(("neighbor",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "coins": Part("neighbor", "earner", "individual"),
        "hat": Part("neighbor", "all", "shared"),
    },
    endings={"time": TIME},
    symmetric={"neighbor": True},
    horizon=14,
    influence=links("neighbor neighbor reward 0", "neighbor neighbor observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Convoy(ParallelEnv):
    """A leader and two followers on a road choose speeds 0 to 3 at once.

    A follower is paid minus its distance from the leader; a distance over 6 is a separation: the
    follower's own termination. The leader is paid its speed. Twenty ticks are a trip.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "convoy_v0", "render_modes": []}
    render_mode = None

    def __init__(self) -> None:
        self.possible_agents = ["leader_0", "follower_0", "follower_1"]
        self.observation_spaces = {a: Box(-99, 99, (1,), np.float32) for a in self.possible_agents}
        self.action_spaces = {agent: Discrete(4) for agent in self.possible_agents}
        self.rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The distance from the leader; the leader sees its own last speed."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The speed."""
        return self.action_spaces[agent]

    def _see(self, agent: str) -> Any:
        seen = self.speed if agent == "leader_0" else self.at["leader_0"] - self.at[agent]
        return np.array([seen], np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts a trip."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.t, self.speed = self.possible_agents[:], 0, 0
        self.at = dict.fromkeys(self.agents, 0)
        self.at["leader_0"] = int(self.rng.integers(1, 4))
        return {a: self._see(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: Any) -> Any:
        """Plays one tick."""
        self.t += 1
        there = self.agents
        for agent in there:
            self.at[agent] += int(actions[agent])
        self.speed = int(actions["leader_0"])
        gaps = {agent: abs(self.at["leader_0"] - self.at[agent]) for agent in there}
        rewards = {a: float(self.speed if a == "leader_0" else -gaps[a]) for a in there}
        ends = {agent: gaps[agent] > 6 for agent in there}
        cuts = {agent: self.t >= 20 and not ends[agent] for agent in there}
        self.agents = [agent for agent in there if not (ends[agent] or cuts[agent])]
        return {a: self._see(a) for a in there}, rewards, ends, cuts, {a: {} for a in there}


CONVOY = Form(
    name="convoy",
    api="parallel",
    stages=(("leader", "follower"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "speed": Part("leader", "earner", "individual"),
        "gap": Part("all", "follower", "individual"),
    },
    endings={"separation": Ending("termination", "agent"), "time": TIME},
    symmetric={"leader": None, "follower": True},
    horizon=20,
    influence=links(
        "leader follower observation 1", "leader follower reward 0", "leader follower ending 0"
    ),
    order_sensitive="none",
    advice="parallel",
)


class Bridge(AECEnv):
    """Two engineers build in turn: each adds a beam of 1 to 3 to a bridge of drawn length.

    The one whose beam reaches it exactly is paid 5; beyond it, the bridge breaks and pays it -5.
    Either way both end. The missing length is seen by both. Which one begins is drawn.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "bridge_v0", "render_modes": []}
    render_mode = None

    def __init__(self) -> None:
        self.possible_agents = ["engineer_0", "engineer_1"]
        self.spaces = {agent: Box(-9, 40, (1,), np.float32) for agent in self.possible_agents}
        self.acts = {agent: Discrete(3) for agent in self.possible_agents}
        self.rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The missing length."""
        return self.spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The beam's length minus 1."""
        return self.acts[agent]

    def observe(self, agent: str) -> Any:
        """The missing length."""
        return np.array([self.missing], np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts a bridge."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.missing, self.turns = int(self.rng.integers(9, 20)), 0
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        first = int(self.rng.integers(2))
        self.selector = AgentSelector(self.agents[first:] + self.agents[:first])
        self.agent_selection = self.selector.next()

    @property
    def t(self) -> int:
        """Rounds that are over."""
        return self.turns // 2

    def step(self, action: Any) -> None:
        """Plays one turn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.missing -= 1 + int(action)
        self.turns += 1
        if self.missing <= 0:
            self.rewards[agent] = 5.0 if self.missing == 0 else -5.0
            self.terminations = dict.fromkeys(self.agents, True)
        self.agent_selection = self.selector.next()
        self._accumulate_rewards()


BRIDGE = Form(
    name="bridge",
    api="aec",
    stages=(("engineer",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"beam": Part("engineer", "earner", "individual")},
    endings={"over": Ending("termination", "all")},
    symmetric={"engineer": True},
    horizon=None,
    influence=links(
        "engineer engineer observation 0",
        "engineer engineer reward 0",
        "engineer engineer ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
    doubtful=("order",),
)

FORMS = ((choir_in_turns, CHOIR), (hat_at_once, HAT), (Convoy, CONVOY), (Bridge, BRIDGE))
