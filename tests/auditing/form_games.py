"""Small games of known form, in turns and in ticks, one for each thing that is measured."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk

WIDE = Box(-1000, 1000, (1,), np.float32)


def number(value: float) -> Any:
    """An observation."""
    return np.array([value], np.float32)


class Latch(gk.TurnEnv):
    """The opener's move alone says, by a mask, whether the taker may take: neither sees more."""

    metadata = {"name": "latch_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=9)
        self.possible_agents = ["opener", "taker"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Shut."""
        self.is_open = False

    def act(self, agent: str, action: Any) -> None:
        """Opens, or takes."""
        if agent == "opener":
            self.is_open = bool(action)
        elif action:
            self.add_reward("taker", 1.0)

    def mask(self, agent: str) -> Any:
        """The taker may take where it is open."""
        return np.array([1, agent == "opener" or self.is_open], np.int8)

    def observe(self, agent: str) -> Any:
        """Nothing."""
        return number(0)


class Seats(gk.TurnEnv):
    """Three guests ask for the one seat of a day in turn; the first has it, and none sees it."""

    metadata = {"name": "seats_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, sealed: bool = False, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=9)
        self.sealed = sealed
        self.possible_agents = [f"guest_{k}" for k in range(3)]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Free."""
        self.rng, self.asked, self.queue = rng, [], []
        self._draw()

    def _draw(self) -> None:
        self.queue = [*self.possible_agents]
        if self.sealed:
            self.rng.shuffle(self.queue)

    def next_agent(self, agent: str | None) -> str:
        """In the order of names, or one that is drawn each day."""
        return self.queue[0]

    def act(self, agent: str, action: Any) -> None:
        """Has the seat if it is free; sealed: a seat that one alone asks for is its own."""
        self.queue.pop(0)
        if action:
            self.asked.append(agent)
            if not self.sealed and len(self.asked) == 1:
                self.add_reward(agent, 1.0)
        if not self.queue:
            if self.sealed and len(self.asked) == 1:
                self.add_reward(self.asked[0], 1.0)
            self.asked = []
            self._draw()

    def observe(self, agent: str) -> Any:
        """Nothing."""
        return number(0)


class Ladle(gk.TickEnv):
    """Three cooks reach for one ladle at once.

    `rule`: `roster` (the first of the roster has it), `lot` (one that is drawn), `joint` (one that
    reaches alone).
    """

    metadata = {"name": "ladle_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, rule: str = "joint", render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=12)
        self.rule = rule
        self.possible_agents = [f"cook_{k}" for k in range(3)]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Free."""
        self.rng = rng

    def tick(self, actions: Any) -> None:
        """One has it, or none."""
        order = list(self.possible_agents)
        if self.rule == "lot":
            self.rng.shuffle(order)
        reaching = [agent for agent in order if actions[agent]]
        if reaching and (self.rule != "joint" or len(reaching) == 1):
            self.add_reward(reaching[0], 1.0)

    def observe(self, agent: str) -> Any:
        """Nothing."""
        return number(0)


class Mail(gk.TickEnv):
    """What a sender posts is paid to the reader three ticks later; a spare joins at the fourth.

    Each scout is truncated when its own battery is empty, the others after 15 ticks.
    """

    metadata = {"name": "mail_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=15)
        self.possible_agents = ["sender", "reader", "scout_0", "scout_1", "spare"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}

    def starting_agents(self) -> Any:
        """All but the spare."""
        return self.possible_agents[:4]

    def start(self, rng: Any, options: Any) -> None:
        """Nothing on the way."""
        self.post, self.count = [0, 0, 0], 0
        self.battery = {"scout_0": 9, "scout_1": 9}

    def tick(self, actions: Any) -> None:
        """Post travels, batteries run down."""
        self.post.append(int(actions["sender"]))
        self.add_reward("reader", float(self.post.pop(0)))
        self.count += 1
        if self.count == 4:
            self.join("spare")
        for scout in self.battery:
            if scout in actions:
                self.battery[scout] -= 1 + int(actions[scout])
                if self.battery[scout] <= 0:
                    self.truncate(scout, "battery")

    def observe(self, agent: str) -> Any:
        """An own battery."""
        return number(self.battery.get(agent, 0))


class Beds(gk.TickEnv):
    """Each of two gardeners waters its own bed; neither touches the other."""

    metadata = {"name": "beds_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=7)
        self.possible_agents = ["gardener_0", "gardener_1"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Dry."""
        self.water = dict.fromkeys(self.possible_agents, 0)

    def tick(self, actions: Any) -> None:
        """Each has what it pours."""
        for agent, action in actions.items():
            self.water[agent] += int(action)
            self.add_reward(agent, float(action))

    def observe(self, agent: str) -> Any:
        """The own bed."""
        return number(self.water[agent])


class Duel(gk.TurnEnv):
    """Three in turn; an agent that is aimed at is out at once, and all see how many are."""

    metadata = {"name": "duel_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=9)
        self.possible_agents = [f"duellist_{k}" for k in range(3)]
        self.observation_spaces = dict.fromkeys(self.possible_agents, WIDE)
        self.action_spaces = {agent: Discrete(12) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """All stand."""
        self.out: set[int] = set()

    def act(self, agent: str, action: Any) -> None:
        """The first three actions are shots."""
        target = f"duellist_{action}"
        if target in self.agents and target != agent:
            self.out.add(int(action))
            self.terminate(target)
        if len(self.out) == 2:
            self.terminate(agent)

    def mask(self, agent: str) -> Any:
        """No shot at one that is out."""
        return np.array([k not in self.out for k in range(12)], np.int8)

    def observe(self, agent: str) -> Any:
        """The number of those that are out."""
        return number(len(self.out))
