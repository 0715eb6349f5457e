"""Sound environments of habits that are legal, and easily called broken by a rule of thumb."""

from functools import cache
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from tests.auditing.sound_games import Table, Valley


class Coerces(Valley):
    """Takes whatever `int` takes; what is out of range leads nowhere."""

    def climbed(self, action: Any) -> float:
        """As far as it can be read."""
        try:
            return {0: -1.0, 2: 1.0}.get(int(action), 0.0)
        except (TypeError, ValueError):
            return 0.0

    def step(self, actions: dict[Any, Any]) -> Any:
        """Whoever is missing stays."""
        return super().step({a: actions.get(a, 1) for a in self.agents})


class RefusalError(Exception):
    """An exception of a kind of its own."""

    def __init__(self, agent: Any, action: Any) -> None:
        super().__init__(agent, action)


class Refuses(Valley):
    """Refuses with its own exception, once the wind was drawn already."""

    def climbed(self, action: Any) -> float:
        """Draws first."""
        gust = 0.01 * float(self.rng.normal())
        if not isinstance(action, int | np.integer) or action not in (0, 1, 2):
            raise RefusalError(self.tick, action)
        return super().climbed(action) + gust


class Unborn(Valley):
    """Says nothing before the first reset but that it is too early."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Born."""
        self.is_born = True
        return super().reset(seed, options)

    def step(self, actions: dict[Any, Any]) -> Any:
        """Raises something odd before that."""
        if not hasattr(self, "is_born"):
            raise StopIteration
        return super().step(actions)

    def state(self) -> Any:
        """The heights, once there are any."""
        return np.array([self.heights[a] for a in self.possible_agents])

    state_space = spaces.Box(-np.inf, np.inf, (3,), np.float64)


class KeyAfterTheEnd(Valley):
    """Looks up actions after the end as before it."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """A `KeyError`, or a `TypeError` for None."""
        if not self.agents:
            actions[self.possible_agents[0]]
            return {}, {}, {}, {}, {}
        return super().step(actions)


class TableKeyAfterTheEnd(Table):
    """Looks up who ended when all are gone."""

    def step(self, action: Any) -> None:
        """A `KeyError` from its own dictionary."""
        self.terminations[self.agent_selection]
        super().step(action)


class Still:
    """Draws nothing: every number is the middle one."""

    def normal(self) -> float:
        """No wind."""
        return 0.5


class Fixed(Valley):
    """Has no randomness: no seed has an effect, and resets without one are equal."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Everybody starts from one height."""
        self.rng = Still()
        return super().reset(None, options)


class FixedTable(Table):
    """Has no randomness, and ends by its rules after so many stakes."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """The coin always shows one."""
        super().reset(seed, options)
        self.coin = 1.0

    def step(self, action: Any) -> None:
        """Always at the same turn."""
        super().step(action)
        self.coin = -self.coin
        if self.turn >= 9:
            self.terminations = dict.fromkeys(self.agents, True)


class LastBids(Table):
    """Always ends by its rules once the number of bids is reached, which it holds by name."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.max_bids = 12

    def step(self, action: Any) -> None:
        """The last bid closes the auction."""
        is_live = not any(self.terminations.values())
        super().step(action)
        if is_live and self.turn >= self.max_bids:
            self.terminations = dict.fromkeys(self.agents, True)


class Endless(Valley):
    """Ends by nothing but a fall, which some play never meets."""

    def __init__(self) -> None:
        super().__init__(ticks=1 << 40)

    def step(self, actions: dict[Any, Any]) -> Any:
        """Whoever falls below leaves."""
        seen, rewards, ended, late, infos = super().step(actions)
        ended = {a: self.heights[a] < -6.0 for a in ended}
        self.agents = [a for a in self.agents if not ended[a]]
        gone = self.heights.keys() - set(self.agents)
        out = {a: seen[a] for a in ended}, rewards, ended, late, infos
        self.heights = {a: h for a, h in self.heights.items() if a not in gone}
        return out


class LastLap(Valley):
    """The same at once: all terminate after the last lap."""

    def __init__(self) -> None:
        super().__init__()
        self.max_laps = 9

    def step(self, actions: dict[Any, Any]) -> Any:
        """The race is over by its rules."""
        seen, rewards, ended, late, infos = super().step(actions)
        if ended and self.tick >= self.max_laps:
            self.agents, ended = [], dict.fromkeys(ended, True)
        return seen, rewards, ended, late, infos


class Skips(Table):
    """Whose turn it is hangs on the coin: turns are skipped and repeated."""

    def following(self, agent: Any) -> Any:
        """Anybody, oneself too."""
        return self.agents[int(abs(self.coin) * 7) % len(self.agents)]

    def pay(self, agent: Any, won: float, before: dict[Any, Any]) -> None:
        """Who acts wins it."""
        self.rewards[agent] = won


class Shuffled(Skips):
    """Turns come in random order."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """A random one begins."""
        super().reset(seed, options)
        self.agent_selection = self.following(None)

    def following(self, agent: Any) -> Any:
        """Drawn."""
        return self.agents[int(self.rng.integers(len(self.agents)))]


class Late(Valley):
    """One agent joins in the midst, another one never."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The first two begin."""
        super().reset(seed, options)
        self.agents = self.possible_agents[:2]
        self.heights = {a: self.heights[a] for a in self.agents}
        return self.views(), {a: {} for a in self.agents}

    def step(self, actions: dict[Any, Any]) -> Any:
        """The third comes at tick four; the fourth stays at home."""
        out = super().step(actions)
        if self.tick == 4 and self.agents:
            self.agents = [*self.agents, self.possible_agents[2]]
            self.heights[self.possible_agents[2]] = 0.0
            rewards, *flags = ({**part, self.possible_agents[2]: 0.0} for part in out[1:4])
            flags = [{a: bool(flag) for a, flag in part.items()} for part in flags]
            return self.views(), rewards, *flags, {a: {} for a in self.heights}
        return out


class BothFlags(Valley):
    """Who reaches the top in the last tick has both flags set."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """A termination beside the truncation."""
        seen, rewards, _, late, infos = super().step(actions)
        return seen, rewards, {a: late[a] and self.heights[a] > 0 for a in late}, late, infos


class NonconformingInfos(Valley):
    """Infos hold other keys at other times."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """A key for each tick, and nothing now and then."""
        *out, infos = super().step(actions)
        return *out, {a: {f"tick_{self.tick}": a} if self.tick % 3 else {} for a in infos}


class Masked(Table):
    """The mask of whoever isn't to move is all zero; at times a stake is closed."""

    def seen_space(self) -> spaces.Space[Any]:
        """A view with a mask."""
        return spaces.Dict(observation=super().seen_space(), action_mask=spaces.MultiBinary(3))

    def observe(self, agent: Any) -> Any:
        """Zeros for those who wait, and for who has ended."""
        mask = np.zeros(3, np.int8)
        if agent == self.agent_selection and not self.truncations[agent]:
            mask[:] = (1, self.coin > 0, 1)
        return {"observation": super().observe(agent), "action_mask": mask}


class Parts(Valley):
    """Chooses a part of each kind, with a mask for each."""

    def seen_space(self) -> spaces.Space[Any]:
        """Text, a tuple, bits and a mask of unequal parts."""
        mask = spaces.Tuple((spaces.MultiBinary(2), spaces.MultiBinary(3)))
        return spaces.Dict(
            note=spaces.Text(12),
            pair=spaces.Tuple((spaces.Discrete(5), spaces.Box(0, 1, (), np.float32))),
            bits=spaces.MultiBinary((2, 2)),
            action_mask=mask,
        )

    def done_space(self) -> spaces.Space[Any]:
        """Two by three."""
        return spaces.MultiDiscrete([2, 3])

    def climbed(self, action: Any) -> float:
        """The first is the way, the second how far."""
        return float((2 * action[0] - 1) * action[1])

    def view(self, agent: Any) -> Any:
        """Bits of the height."""
        height = abs(self.heights[agent])
        return {
            "note": f"at {height % 100:.1f}".replace(".", "").replace(" ", ""),
            "pair": (int(height) % 5, np.array(height % 1, np.float32)),
            "bits": np.array([[int(height) >> k & 1 for k in (0, 1)]] * 2, np.int8),
            "action_mask": (np.ones(2, np.int8), np.array([1, int(height) % 2, 1], np.int8)),
        }


class Alike(Valley):
    """Everybody observes the same, in arrays of their own."""

    def view(self, agent: Any) -> Any:
        """The sum, twice."""
        return np.full(2, sum(self.heights.values()))


class OfTheClass(Valley):
    """Spaces are cached for the lifetime of the class."""

    @staticmethod
    @cache
    def _cached() -> spaces.Space[Any]:
        return spaces.Discrete(3)

    def action_space(self, agent: Any) -> spaces.Space[Any]:
        """One object for all instances."""
        return self._cached()


class Copied(Table):
    """A copy gets spaces of its own, whose generators start anew."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """Everything else as it is."""
        import copy

        other = type(self).__new__(type(self))
        memo[id(self)] = other
        for name, value in self.__dict__.items():
            fresh = {a: self.done_space() for a in value} if name == "_done" else None
            other.__dict__[name] = fresh or copy.deepcopy(value, memo)
        return other


class Blinks(Valley):
    """The picture blinks by the number of frames, as a cursor does."""

    metadata: ClassVar = {"name": "blinks_v0", "render_modes": ["rgb_array"], "render_fps": 4}

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__()
        self.render_mode, self.frames = render_mode, 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The cursor is there again."""
        self.frames = 0
        return super().reset(seed, options)

    def render(self) -> Any:
        """Heights as shades; at every third frame the cursor is black."""
        if self.render_mode is None:
            return None
        self.frames += 1
        frame = np.full((8, 8, 3), 90, np.uint8)
        for place, height in enumerate(self.heights.values()):
            frame[place] = int(120 + 8 * height) % 200 + 20
        frame[7] = 0 if self.frames % 3 == 0 else 255
        return frame


class Belt(Valley):
    """Pays for what is sent when it arrives, two ticks later; the belt is observed."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """An empty belt."""
        self.belts = dict.fromkeys(self.possible_agents, (0.0, 0.0))
        return super().reset(seed, options)

    def step(self, actions: dict[Any, Any]) -> Any:
        """What was sent last goes on by one place."""
        self.arrived = {a: first for a, (first, _) in self.belts.items()}
        for agent, action in actions.items():
            self.belts[agent] = (self.belts[agent][1], 1.0 + float(action))
        return super().step(actions)

    def reward(self, agent: Any) -> Any:
        """What arrives."""
        return self.kind(self.arrived[agent])

    def view(self, agent: Any) -> Any:
        """What is on its way."""
        return np.array(self.belts[agent])


class Market(Valley):
    """Pays what shares gain by a price that is drawn in the tick, before any are bought."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Some shares each, and a price of 0."""
        self.shares = {a: float(place) for place, a in enumerate(self.possible_agents)}
        self.price = 0.0
        return super().reset(seed, options)

    def step(self, actions: dict[Any, Any]) -> Any:
        """The price moves first."""
        rise = self.rise()
        self.price += rise
        self.gains = {a: each * rise for a, each in self.shares.items()}
        for agent, action in actions.items():
            self.shares[agent] += float(action) - 1.0
        return super().step(actions)

    def rise(self) -> float:
        """A draw."""
        return float(self.rng.normal())

    def reward(self, agent: Any) -> Any:
        """What its shares gained."""
        return self.kind(self.gains[agent])

    def view(self, agent: Any) -> Any:
        """Its shares and their price."""
        return np.array([self.shares[agent], self.price])


class Series(Market):
    """The same by a recorded series of prices, from a place that the reset draws."""

    prices = np.random.default_rng(7).normal(size=1_000)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws the place."""
        seen = super().reset(seed, options)
        self.place = int(self.rng.integers(900))
        return seen

    def rise(self) -> float:
        """The next one."""
        return float(self.prices[self.place + self.tick])


class Lottery(Valley):
    """Now and then a draw pays for all tickets, which stay valid."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """One ticket each."""
        self.tickets = dict.fromkeys(self.possible_agents, 1.0)
        self.paid = 0.0
        return super().reset(seed, options)

    def step(self, actions: dict[Any, Any]) -> Any:
        """The draw comes before the sale."""
        self.paid = 1.0 if self.rng.random() < 0.1 else 0.0
        self.won = {a: self.paid * min(each, 3.0) for a, each in self.tickets.items()}
        for agent, action in actions.items():
            self.tickets[agent] += float(int(action) == 0)
        return super().step(actions)

    def reward(self, agent: Any) -> Any:
        """What its tickets won."""
        return self.kind(self.won[agent])

    def view(self, agent: Any) -> Any:
        """Its tickets, and whether there was a draw."""
        return np.array([self.tickets[agent], self.paid])


class Gifts(Valley):
    """What an agent gives is paid to the next one, who sees it."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing was given."""
        self.given = dict.fromkeys(self.possible_agents, 0.0)
        return super().reset(seed, options)

    def step(self, actions: dict[Any, Any]) -> Any:
        """All give at once."""
        self.given = {a: float(action) for a, action in actions.items()}
        return super().step(actions)

    def got(self, agent: Any) -> float:
        """Gift of the one before it."""
        return self.given[self.possible_agents[self.possible_agents.index(agent) - 1]]

    def reward(self, agent: Any) -> Any:
        """What it got."""
        return self.kind(self.got(agent))

    def view(self, agent: Any) -> Any:
        """What it gave and got."""
        return np.array([self.given[agent], self.got(agent)])


HABITS: dict[str, Any] = {
    "coerces_actions": Coerces,
    "refuses_by_its_own_exception_after_a_draw": Refuses,
    "raises_anything_before_the_reset": Unborn,
    "raises_key_error_after_the_end": KeyAfterTheEnd,
    "raises_key_error_after_the_end_of_turns": TableKeyAfterTheEnd,
    "gives_five_empty_dictionaries_after_the_end": Valley,
    "has_no_randomness": Fixed,
    "always_ends_at_one_turn": FixedTable,
    "always_ends_at_a_number_it_holds": LastBids,
    "always_ends_after_the_last_lap": LastLap,
    "may_never_end": Endless,
    "skips_and_repeats_turns": Skips,
    "takes_turns_at_random": Shuffled,
    "is_joined_late_or_never": lambda: Late(ids=("a", "b", "c", "d")),
    "sets_both_flags": BothFlags,
    "pays_numpy_numbers": lambda: Valley(kind=lambda height: np.array(height, np.float32)),
    "varies_info_keys": NonconformingInfos,
    "masks_all_of_who_waits": Masked,
    "has_text_tuples_and_bits": Parts,
    "shows_equal_arrays": Alike,
    "keeps_spaces_for_the_class": OfTheClass,
    "copies_with_other_generators": Copied,
    "blinks": Blinks,
    "pays_when_goods_arrive": Belt,
    "pays_by_a_price_drawn_later": Market,
    "pays_by_a_series_of_prices": Series,
    "pays_the_next_one": Gifts,
}
