"""Environments whose knobs disturb what reaches the rules and what leaves them.

The rules know of no knobs. Where one is on, it hands them other actions than those that were
chosen, and agents other observations than those that the rules show; where none is, it does
nothing. Of a kernel's batches nothing is disturbed: see `not_batched`.

A task stands on one of these (and on `MaskedTicks` behind it where its kernel has a mask), and
calls `disturb` at the end of its `__init__`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from gamekeeper.interface.authoring import Snapshot
from gamekeeper.kernels.kernel_env import KernelRules, KernelTicks, KernelTurns
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.knobs import Disturbances, Knobs


class Disturbed(KernelRules):
    """Part that ticks and turns share; a task writes `whereabouts`, and what its knobs need.

    Attributes:
        disturbances: what the knobs do; None where they all are at their ideal.
        not_batched: why a batch of the kernel plays otherwise than this class; empty if it agrees.
    """

    disturbances: Disturbances | None
    not_batched: str

    def disturb(
        self,
        knobs: Knobs,
        *,
        things: Sequence[tuple[int, int]],
        noop: int,
        neighbours: Mapping[int, Sequence[int]],
    ) -> None:
        """Sets the knobs, the same for all agents.

        Args:
            things: parts (first, end) of a flat observation that stand for one thing each.
            noop: the action that does nothing.
            neighbours: by action, what it may turn out as under `actuator_slip`.
        """
        self.not_batched = "" if knobs.is_ideal else "knobs"
        self.disturbances = None
        if not knobs.is_ideal:
            spaces: dict[str, Any] = self.observation_spaces
            self.disturbances = Disturbances(
                knobs,
                bounds={agent: (space.low, space.high) for agent, space in spaces.items()},
                things=dict.fromkeys(spaces, things),
                noop=noop,
                neighbours=neighbours,
            )

    # -- what a task writes

    def held_out(self, rng: Stream) -> NDArray[Any]:
        """Tables of a held-out layout that `rng` alone draws: one record, like the kernel's own."""
        raise NotImplementedError(f"{type(self).__name__} has no held_out(rng)")

    def whereabouts(self) -> Sequence[Any]:
        """Place of each agent, by number; an agent whose place differs after a step has moved."""
        raise NotImplementedError(f"{type(self).__name__} has no whereabouts()")

    def finds_itself(self, agent: str) -> bool:
        """Tells whether an agent that has just moved learns its place, and loses its drift."""
        return False

    def strayed(self) -> None:
        """Told after each step, for rules that show agents where they believe themselves to be."""

    def believed(self, agent: str) -> NDArray[Any]:
        """Observation that an agent would have with sound sensors: by the rules."""
        seen: NDArray[Any] = super().observe(agent)
        return seen

    # -- episodes

    def starting_agents(self) -> Iterable[Any]:
        """Starts without delays, queues and drift; the layout is up before the rules begin."""
        if self.disturbances is not None:
            self.disturbances.begin(self.rng)
            self._lay_out()
        return super().starting_agents()

    def restore(self, snapshot: Snapshot) -> None:
        """Also the layout, which a snapshot has only in the numbers that it was drawn from."""
        super().restore(snapshot)
        if self.disturbances is not None:
            self._lay_out()

    def _lay_out(self) -> None:
        knobs = self.disturbances
        assert knobs is not None  # asked by the caller
        if knobs.is_held_out:
            self.tables = self.held_out(knobs.layout_rng())
        elif knobs.knobs.held_out:
            self.tables = self.kernel.tables.reshape(1)

    # -- a step

    def _recall(self, agents: Iterable[str]) -> dict[str, Any]:
        """Keeps observations of agents before a step; returns their places."""
        assert self.disturbances is not None  # asked by the caller
        for agent in agents:
            self.disturbances.remember(agent, self.believed)
        return dict(zip(self.possible_agents, self.whereabouts(), strict=True))

    def _wander(self, agents: Iterable[str], before: Mapping[str, Any]) -> None:
        """Lets agents that moved in a step err about their places."""
        knobs = self.disturbances
        assert knobs is not None  # asked by the caller
        after = dict(zip(self.possible_agents, self.whereabouts(), strict=True))
        for agent in agents:
            if after[agent] != before[agent]:
                knobs.moved(agent)
                if self.finds_itself(agent):
                    knobs.located(agent)
        self.strayed()

    def observe(self, agent: Any) -> Any:
        """Observation of an agent, as disturbed as its sensors are."""
        if self.disturbances is None:
            return super().observe(agent)
        return self.disturbances.shown(agent, self.believed)


class DisturbedTicks(Disturbed, KernelTicks):
    """Disturbed environment of a kernel in which all act at once."""

    def tick(self, actions: dict[Any, Any]) -> None:
        """Plays the actions of all agents, as disturbed as they are."""
        knobs = self.disturbances
        if knobs is None:
            super().tick(actions)
            return
        before = self._recall(actions)
        super().tick({agent: knobs.played(agent, action) for agent, action in actions.items()})
        self._wander(actions, before)


class DisturbedTurns(Disturbed, KernelTurns):
    """Disturbed environment of a kernel in which agents take turns."""

    def act(self, agent: Any, action: Any) -> None:
        """Plays the action of one agent, as disturbed as it is."""
        knobs = self.disturbances
        if knobs is None:
            super().act(agent, action)
            return
        before = self._recall((agent,))
        super().act(agent, self.carried_out(action, knobs.played(agent, action)))
        self._wander((agent,), before)

    def carried_out(self, chosen: int, done: int) -> int:
        """Action that is carried out, in place of the chosen one.

        Rules that judge the one and carry out the other are told so here.
        """
        return done
