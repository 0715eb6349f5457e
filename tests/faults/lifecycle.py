"""The life cycle: reset, steps of ended agents, close."""

from __future__ import annotations

from typing import Any

from tests.faults import faulty
from tests.faults.rovers import MOVES, SIZE, Rovers
from tests.faults.traders import FarTraders, Traders


@faulty("GK520")
class GoesOn(Rovers):
    """A step after the end silently goes on.

    Once all rovers have ended they rove on.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Goes on with all rovers where none is left."""
        if self.agents or not actions:
            return super().step(actions)
        rovers = list(actions)
        observations = {a: self.observation(a) for a in rovers}
        flags = dict.fromkeys(rovers, False)
        infos: dict[str, Any] = {a: {} for a in rovers}
        return observations, {a: self.reward(a) for a in rovers}, flags, dict(flags), infos


@faulty("GK521")
class StepsUnborn(Rovers):
    """A step before any reset plays, from a state that nobody has seeded.

    Resets itself at its first step.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Begins an episode where none was."""
        if self.rng is None:
            self.reset()
        return super().step(actions)


@faulty("GK522")
class DeadMayBid(Traders):
    """A dead trader's bid is accepted.

    Whatever a dead trader does is taken for None.
    """

    def _was_dead_step(self, action: Any) -> None:
        """Doesn't look at the action."""
        super()._was_dead_step(None)


# Where a reset is ignored, so is its seed; the second episode isn't a fresh one's, and an agent
# that had left stays away.
@faulty("GK523", also=("GK103", "GK604", "GK606"))
class ResetIgnored(Rovers):
    """A reset in the midst of an episode is ignored.

    Resets only what is over.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Gives what is there, while there is somebody."""
        if not self.agents:
            return super().reset(seed, options)
        observations = {a: self.observation(a) for a in self.agents}
        return observations, {a: self.info(a) for a in self.agents}


@faulty("GK524")
class NoOptions(Rovers):
    """`reset` knows no options.

    Its reset takes a seed alone.
    """

    def reset(self, seed: int | None = None) -> Any:  # type: ignore[override]  # that is the fault
        """Has no `options`."""
        return super().reset(seed)


@faulty("GK525")
class ClosesOnce(Rovers):
    """`close` raises where there is nothing to close, or nothing any more.

    Closes a window that it may not have.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Opens a window."""
        self.window: Any = object()
        return super().reset(seed, options)

    def close(self) -> None:
        """Closes it, whether or not it is there."""
        del self.window


@faulty("GK526")
class EndedStillDrive(Rovers):
    """A rover that has ended still drives where somebody acts for it.

    Moves whoever is named in the actions.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Drives those who have ended, too."""
        for agent in actions.keys() - set(self.agents):
            self.cells[agent] = (self.cells[agent] + MOVES[int(actions[agent])]) % SIZE
        return super().step(actions)


@faulty("GK527")
class NoneIsNoBid(Traders):
    """The None of a trader that has ended is read as a bid, which raises.

    Every action is a number here.
    """

    def _was_dead_step(self, action: Any) -> None:
        """Notes the bid of one that is out."""
        super()._was_dead_step(int(action))


@faulty("GK527")
class FarNone(NoneIsNoBid, FarTraders):
    """The same at the end of an episode that no rollout plays to its end."""
