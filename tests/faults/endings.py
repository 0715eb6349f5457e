"""Endings: terminated, truncated, and what is left."""

from __future__ import annotations

from typing import Any

from tests.faults import clean, faulty
from tests.faults.rovers import LongRovers, Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


@faulty(
    "GK500",
    contract={
        "endings": {
            "battery": {"kind": "termination", "owner": "all"},
            "horizon": {"kind": "truncation", "owner": "all"},
        }
    },
)
class GoesOnAlone(Rovers):
    """An ending that is declared to be everybody's ends only the rover that it befalls.

    An empty battery is declared to be the end for all.
    """

    endings: dict[str, str]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing has ended."""
        self.endings = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Names the reasons."""
        out = super().step(actions)
        self.endings.update((a, "battery") for a in out[2] if out[2][a])
        self.endings.update((a, "horizon") for a in out[3] if out[3][a])
        return out


@faulty("GK501")
class SilentLeave(Rovers):
    """A rover with an empty battery is taken out of `agents`, and neither flag says so.

    Empty batteries end nobody.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the terminations back."""
        out = super().step(actions)
        return out[0], out[1], dict.fromkeys(out[2], False), out[3], out[4]


@faulty("GK502")
class OneEndsAll(Rovers):
    """When one rover ends the roster is emptied, and the others' flags stay down.

    The first empty battery is the end for all.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Sends everybody away with the first who ends."""
        out = super().step(actions)
        if any(out[2].values()):
            self.agents = []
        return out


@faulty("GK503")
class NotEmptied(Rovers):
    """`agents` isn't emptied when the horizon has truncated everybody.

    The last ones stay in the roster.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Keeps those whom the horizon ended."""
        out = super().step(actions)
        if any(out[3].values()):
            self.agents = [a for a in out[3] if out[3][a]]
        return out


class FarRovers(LongRovers):
    """Rovers that drive for longer than any rollout."""

    def __init__(self, max_steps: int = 5000, render_mode: str | None = None) -> None:
        super().__init__(2, max_steps, render_mode)


@faulty("GK503")
class FarRoster(FarRovers):
    """`agents` isn't emptied at a limit that no rollout meets.

    The last ones stay in the roster after 5,000 steps.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Keeps those whom the limit ended."""
        out = super().step(actions)
        if any(out[3].values()):
            self.agents = list(out[3])
        return out


@faulty("GK504")
class Numbers(Rovers):
    """Truncations are 0 and 1.

    Flags are numbers.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Counts truncations."""
        out = super().step(actions)
        return *out[:3], {a: int(flag) for a, flag in out[3].items()}, out[4]


@faulty("GK505")
class TakenBack(Tokens):
    """When a pair has won both players terminate, and then the one who is left doesn't any more.

    Flags are worked out anew while the dead wait for their turn.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Nobody was left alone yet."""
        super().reset(seed, options)
        self.was_alone = False

    def step(self, action: Any) -> None:
        """Who is left alone may take one more cell, if there is one."""
        if self.was_alone and not self.terminations[self.agent_selection]:
            self._cumulative_rewards[self.agent_selection] = 0.0
            self._clear_rewards()
            self.terminations[self.agent_selection] = True
            return
        super().step(action)
        if len(self.agents) == 1 and not self.was_alone and self.legal().any():
            self.was_alone = True
            self.terminations[self.agents[0]] = False


# An episode that begins with one agent ended isn't that of a fresh instance.
@faulty("GK506", also=("GK523", "GK604"))
class FlagsStayUp(Traders):
    """After an episode in which a trader went bankrupt the next one begins with it terminated.

    Who was bankrupt once is so in the next episode.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Leaves one flag as it was."""
        bankrupt = getattr(self, "bankrupt", None)
        super().reset(seed, options)
        if bankrupt is not None:
            self.terminations[bankrupt] = True
        self.bankrupt: str | None = None

    def settle(self) -> None:
        """Notes a bankrupt trader."""
        super().settle()
        self.bankrupt = next((a for a in self.agents if self.terminations[a]), self.bankrupt)


@faulty("GK507", contract={"schedule": {"horizon": 20}})
class HorizonTerminates(Rovers):
    """The declared horizon terminates the rovers that are left; it should truncate them.

    A time limit is told as a rule of the game.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Tells every end as a termination."""
        out = super().step(actions)
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return *out[:2], ended, dict.fromkeys(ended, False), out[4]


@faulty("GK508")
class LimitTerminates(Rovers):
    """A time limit that nobody has declared is told as a termination.

    Whoever is left at the horizon terminates.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Tells every end as a termination."""
        out = super().step(actions)
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return *out[:2], ended, dict.fromkeys(ended, False), out[4]


@faulty("GK508")
class FarLimitTerminates(FarRovers):
    """A time limit that no rollout meets is told as a termination.

    Whoever is left after 5,000 steps terminates.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Tells the end as a termination."""
        out = super().step(actions)
        return *out[:2], out[3], dict.fromkeys(out[3], False), out[4]


@faulty(
    "GK509",
    contract={
        "endings": {
            "battery": {"kind": "truncation", "owner": "agent"},
            "horizon": {"kind": "truncation", "owner": "all"},
        }
    },
)
class WrongKind(Rovers):
    """An empty battery terminates, though it is declared a truncation.

    Batteries are declared a limit from outside.
    """

    endings: dict[str, str]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing has ended."""
        self.endings = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Names the reasons."""
        out = super().step(actions)
        self.endings.update((a, "battery") for a in out[2] if out[2][a])
        self.endings.update((a, "horizon") for a in out[3] if out[3][a])
        return out


@faulty(
    "GK511", contract={"api": "parallel", "roles": {"rover": {"symmetric": True}}}, budget=2_000
)
class FirstRoverTires(Rovers):
    """Rovers are declared interchangeable, but the first one's battery drains twice as fast.

    One of them isn't like the others.
    """

    def drive(self, agent: str, action: int) -> None:
        """The first rover's move costs twice as much."""
        super().drive(agent, action)
        if agent == self.possible_agents[0]:
            self.battery[agent] -= 1


@clean(
    contract={
        "schedule": {"horizon": 20},
        "endings": {
            "battery": {"kind": "termination", "owner": "agent"},
            "horizon": {"kind": "truncation", "owner": "all"},
        },
    }
)
class Endings(Rovers):
    """A clean environment that declares its endings and its horizon: no check is broken on it.

    Rovers whose ends have reasons, as they are declared.
    """

    endings: dict[str, str]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing has ended."""
        self.endings = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Names the reasons."""
        out = super().step(actions)
        self.endings.update((a, "battery") for a in out[2] if out[2][a])
        self.endings.update((a, "horizon") for a in out[3] if out[3][a])
        return out
