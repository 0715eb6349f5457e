"""Rosters and identity: which agents there are, and what speaks of them."""

from __future__ import annotations

from typing import Any

from tests.faults import faulty
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


@faulty("GK101")
class NamedLate(Rovers):
    """possible_agents is empty until the first reset.

    Who may play is known once somebody does.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Spaces are there, names are not."""
        super().__init__(**kwargs)
        self.possible_agents = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Names the rovers."""
        self.possible_agents = [f"rover_{i}" for i in range(self.count)]
        return super().reset(seed, options)


@faulty("GK102")
class OneList(Rovers):
    """`agents` is the same list as possible_agents, which loses everybody who ends until a reset.

    What is removed from the one is gone from the other.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Names all rovers again."""
        self.possible_agents = [f"rover_{i}" for i in range(self.count)]
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the ended out of the one list there is."""
        roster = self.possible_agents
        out = super().step(actions)
        for agent in [a for a in roster if a in out[2] and a not in self.agents]:
            roster.remove(agent)
        self.agents = roster
        return out

    def observation(self, agent: str) -> Any:
        """Of the rovers that there were."""
        seen, self.possible_agents = self.possible_agents, list(self.cells)
        out = super().observation(agent)
        self.possible_agents = seen
        return out

    def state(self) -> Any:
        """Of the rovers that there were."""
        seen, self.possible_agents = self.possible_agents, list(self.cells)
        out = super().state()
        self.possible_agents = seen
        return out


# Who is gone from the list is missing in the next episode.
@faulty("GK102", also=("GK103", "GK604"))
class OneListForGood(OneList):
    """`agents` is the same list as possible_agents, and loses who ended for good.

    A reset takes the list that is there.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins with the agents that the list still has, or with all."""
        roster = self.possible_agents or [f"rover_{i}" for i in range(self.count)]
        out = super().reset(seed, options)
        self.agents = self.possible_agents = roster
        return tuple({agent: part[agent] for agent in roster} for part in out)


# The next episode isn't that of a fresh instance: somebody is missing in it.
@faulty("GK103", also=("GK526", "GK604"))
class NotRestored(Rovers):
    """A reset leaves out the rovers whose batteries ran empty in the last episode.

    The dead are dead for the next episode too.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Takes those who were left, and all of them where nobody was."""
        left = getattr(self, "left", [])
        out = super().reset(seed, options)
        self.agents = left or self.agents
        self.left: list[str] = []
        return tuple({a: part[a] for a in self.agents} for part in out)

    def step(self, actions: dict[str, Any]) -> Any:
        """Notes who was there when the first rover ended."""
        out = super().step(actions)
        self.left = self.left or (list(self.agents) if any(out[2].values()) else [])
        return out


@faulty("GK104")
class Twice(Rovers):
    """A rover stands twice in `agents` once another one has ended.

    The place of the dead is filled with a name that is there.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Fills up the roster."""
        out = super().step(actions)
        if self.agents and len(self.agents) < self.count:
            self.agents = [*dict.fromkeys(self.agents), self.agents[0]]
        return out


@faulty("GK105")
class Guest(Rovers):
    """A rover joins that possible_agents doesn't list.

    A guest arrives at the third tick.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Plays, and lets a guest look on."""
        acting = {a: action for a, action in actions.items() if a != "guest"}
        self.agents = [a for a in self.agents if a != "guest"]
        out = super().step(acting)
        if "guest" in actions or (self.time >= 3 and self.agents):
            first, is_over = next(iter(out[0])), not self.agents
            self.agents += [] if is_over else ["guest"]
            ending = 0.0, False, is_over
            for part, value in zip(out, (out[0][first].copy(), *ending, {}), strict=True):
                part["guest"] = value
        return out

    def render(self) -> Any:
        """The guest has no place on the field."""
        agents, self.agents = self.agents, [a for a in self.agents if a != "guest"]
        frame = super().render()
        self.agents = agents
        return frame

    def observation_space(self, agent: str) -> Any:
        """The guest sees what a rover sees."""
        return super().observation_space("rover_0" if agent == "guest" else agent)

    def action_space(self, agent: str) -> Any:
        """The guest may do what a rover may."""
        return super().action_space("rover_0" if agent == "guest" else agent)


@faulty("GK106")
class AllAccounts(Rovers):
    """The dead stand in rewards, terminations and truncations until the episode is over.

    Accounts are kept of everybody.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Adds those who have left."""
        out = super().step(actions)
        for agent in self.possible_agents if out[1] else ():
            out[1].setdefault(agent, 0.0)
            out[2].setdefault(agent, True)
            out[3].setdefault(agent, False)
        return out


@faulty("GK106", also=("GK402", "GK520"))
class AllPaid(Rovers):
    """Every step pays all rovers that there ever were, also the step after the end.

    Rewards are made for everybody.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays those who have left."""
        observations, rewards, *rest = super().step(actions)
        known = self.possible_agents if hasattr(self, "cells") else ()
        return observations, dict.fromkeys(known, 0.5) | rewards, *rest


@faulty("GK107")
class WaitingNotExercised(Rovers):
    """A rover that waited is given no observation.

    Only who moved is shown something.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Leaves out who waited and goes on."""
        out = super().step(actions)
        for agent in self.agents:
            if int(actions[agent]) == 0:
                del out[0][agent]
        return out


@faulty("GK108")
class EndedUnpaid(Rovers):
    """A rover that ends has no entry in rewards in that step.

    Only who goes on is paid.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays the living."""
        out = super().step(actions)
        return out[0], {a: out[1][a] for a in self.agents}, *out[2:]


@faulty("GK109")
class NoInfosAtReset(Rovers):
    """A reset returns no infos.

    Infos come with the first step.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Has nothing to say."""
        return super().reset(seed, options)[0], {}


# What last() reads is gone, so that the loop over agents ends in a KeyError.
@faulty("GK109", also=("GK527",))
class InfosOfOneTrader(Traders):
    """Infos are made anew by each settlement, with the entry of one trader.

    Written for the one that is to act.
    """

    def settle(self) -> None:
        """Forgets the infos of all others."""
        super().settle()
        self.infos = {self.agent_selection: {}}


# Without two flags by agent nobody is told to have ended.
@faulty("GK110", also=("GK501",))
class FourValues(Rovers):
    """A step after which nobody is left returns four values, as it did before truncations.

    The last step is told in the old form.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Mixes both flags at the end."""
        out = super().step(actions)
        if self.agents or not out[0]:
            return out
        return out[0], out[1], {a: out[2][a] or out[3][a] for a in out[2]}, out[4]


@faulty("GK111")
class FixedCount(Rovers):
    """num_agents doesn't notice that rovers end.

    As many as there were.
    """

    @property
    def num_agents(self) -> int:
        """What the constructor was told."""
        return self.count


@faulty("GK112")
class Revived(Rovers):
    """A rover that has ended comes back under its name three ticks later.

    A new battery brings it back.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Revives who has been out for long."""
        out = super().step(actions)
        if not self.agents:
            return out
        for agent in self.possible_agents:
            if agent not in out[2]:
                self.out[agent] = self.out.get(agent, 0) + 1
                if self.out[agent] == 3:
                    self.agents.append(agent)
                    self.battery[agent] = 9
                    new = self.observation(agent), 0.0, False, False, self.info(agent)
                    for part, value in zip(out, new, strict=True):
                        part[agent] = value
        return out

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has been out."""
        self.out: dict[str, int] = {}
        return super().reset(seed, options)


@faulty("GK113")
class Ghosts(Rovers):
    """The dead are given observations and infos until the episode is over.

    Everybody is shown everything.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Adds those who have left."""
        out = super().step(actions)
        for agent in self.possible_agents if out[0] else ():
            out[0].setdefault(agent, self.observation(agent))
            out[4].setdefault(agent, self.info(agent))
        return out


@faulty("GK114")
class View(Rovers):
    """`agents` is a view of the keys of a dictionary.

    The roster is whoever has a place in a dictionary.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """A step over a list, a view in its place."""
        self.agents = list(self.agents)
        out = super().step(actions)
        self.agents = dict.fromkeys(self.agents).keys()  # type: ignore[assignment]
        return out

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Likewise."""
        out = super().reset(seed, options)
        self.agents = dict.fromkeys(self.agents).keys()  # type: ignore[assignment]
        return out
