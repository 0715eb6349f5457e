"""An environment between two decisions of those who learn: the others play, the dead are told."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from gamekeeper.errors import ActionError, ContractError


@dataclass(frozen=True, slots=True)
class Told:
    """What a learner is told: before its next decision, or at its end.

    Attributes:
        observation, info: as the environment gave them.
        reward: all that it was paid since its last decision.
        terminated, truncated: whether it ended.
    """

    observation: Any
    reward: float
    info: Any
    terminated: bool = False
    truncated: bool = False

    @property
    def ended(self) -> bool:
        """Whether it takes no further decision."""
        return self.terminated or self.truncated


class Others(Protocol):
    """Who plays the agents that don't learn."""

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """What `agent` does."""


class World:
    """One copy of an environment, from one decision of a learner to the next.

    Args:
        env: a ParallelEnv or AECEnv.
        learners: who is told and asked, in the order of `possible_agents`.
        others: who plays the rest.

    Attributes:
        paid: by agent, learners and others, what it was paid in the episode.
        live: learners that were told something and haven't ended.
    """

    def __init__(self, env: Any, learners: Collection[Any], others: Others | None) -> None:
        self.env, self.learners, self.others = env, tuple(learners), others
        self.paid: dict[Any, float] = {}
        self.live: dict[Any, Told] = {}
        self._ended: set[Any] = set()

    @property
    def is_over(self) -> bool:
        """Whether nobody will be asked any more: nobody lives, or all who learn have ended."""
        return not self.env.agents or len(self._ended) == len(self.learners)

    def begin(self, seed: int, options: Mapping[str, Any] | None) -> dict[Any, Told]:
        """Begins an episode: what those who decide first are given."""
        self.paid, self.live, self._ended = {}, {}, set()
        self._reset({"seed": seed} if options is None else {"seed": seed, "options": options})
        told = self._first()
        return told if any(not one.ended for one in told.values()) else self._on(told)

    def act(self, actions: Mapping[Any, Any]) -> dict[Any, Told]:
        """Plays on until a learner decides again or the episode is over.

        Args:
            actions: of the learners that were told last and live, of all of them and nobody else.
        Returns:
            Who decides next, and who ended meanwhile; a learner of an AEC environment that waits
            for its turn is told nothing.
        Raises:
            ActionError: an action is missing, or is somebody's who doesn't decide now.
            ContractError: somebody who ended has come back.
        """
        return self._on(self._play(actions))

    def _on(self, told: dict[Any, Told]) -> dict[Any, Told]:
        """Plays on while no learner decides, as nobody of them is there or has the turn."""
        while not self.is_over and all(one.ended for one in told.values()):
            told |= self._play({})
        return {agent: told[agent] for agent in self.learners if agent in told}

    def _note(self, agent: Any, told: Told) -> Told:
        """Keeps who lives and who ended."""
        if agent in self._ended:
            raise ContractError(
                f"{agent!r} has ended and is back within the episode",
                where=f"the roster, {agent!r}",
                expected="an end that lasts until the episode is over",
                seen="the agent among those that live",
                mend="give who joins later a name of its own; RLlib has one stream for each name",
            )
        if told.ended:
            self._ended.add(agent)
            self.live.pop(agent, None)
        else:
            self.live[agent] = told
        return told

    def _pay(self, agent: Any, reward: Any) -> float:
        amount = float(reward)
        self.paid[agent] = self.paid.get(agent, 0.0) + amount
        return amount

    def _by_others(self, agent: Any, observation: Any, info: Any) -> Any:
        assert self.others is not None  # who doesn't learn was given a policy as all began
        return self.others.act(agent, observation, {} if info is None else info)

    def _chosen(self, actions: Mapping[Any, Any], agent: Any) -> Any:
        try:
            return actions[agent]
        except KeyError:
            raise ActionError(
                f"{agent!r} was observed and has no action",
                where="step",
                expected=f"an action of {agent!r}",
                seen=", ".join(map(str, actions)) or "no actions",
                mend="give an action to each agent of the last observations that hasn't ended",
            ) from None

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def _first(self) -> dict[Any, Told]:
        raise NotImplementedError

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, Told]:
        raise NotImplementedError


class Ticks(World):
    """A Parallel environment: all who live decide in each tick."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self._seen, self._infos = self.env.reset(**arguments)

    def _first(self) -> dict[Any, Told]:
        live = set(self.env.agents)
        return {
            agent: self._note(agent, Told(self._seen[agent], 0.0, self._infos.get(agent)))
            for agent in self.learners
            if agent in live
        }

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, Told]:
        mine, before = set(self.learners), list(self.env.agents)
        strangers = [agent for agent in actions if agent not in before or agent not in mine]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} doesn't decide now", where="step", seen=repr(strangers[0]),
                expected=", ".join(str(agent) for agent in before if agent in mine),
                mend="give actions to the agents of the last observations alone",
            )  # fmt: skip
        acts = {
            agent: self._chosen(actions, agent)
            if agent in mine
            else self._by_others(agent, self._seen[agent], self._infos.get(agent))
            for agent in before
        }
        self._seen, rewards, terms, truncs, self._infos = self.env.step(acts)
        paid = {agent: self._pay(agent, rewards.get(agent, 0.0)) for agent in before}
        live, told = set(self.env.agents), {}
        for agent in self.learners:
            was_there = agent in acts
            if not was_there and agent not in live:
                continue
            if was_there and agent not in live and not (terms.get(agent) or truncs.get(agent)):
                told[agent] = self._note(agent, self._gone(agent, paid[agent]))
                continue
            one = Told(
                self._seen[agent], paid.get(agent, 0.0), self._infos.get(agent),
                bool(terms.get(agent)), bool(truncs.get(agent)),
            )  # fmt: skip
            told[agent] = self._note(agent, one)
        return told

    def _gone(self, agent: Any, reward: float) -> Told:
        """Somebody who left without an ending: cut off, at the last that there is of it."""
        last = self.live[agent]
        return Told(
            self._seen.get(agent, last.observation), reward, self._infos.get(agent, last.info),
            truncated=True,
        )  # fmt: skip


class Turns(World):
    """An AEC environment: one agent decides at a time; the dead are told in turns of their own."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self.env.reset(**arguments)

    def _first(self) -> dict[Any, Told]:
        return self._to_a_learner()

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, Told]:
        agent = self.env.agent_selection
        strangers = [other for other in actions if other != agent]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} acts out of turn", where="step", expected=repr(agent),
                seen=repr(strangers[0]),
                mend="give one action, that of the agent in the last observations",
            )  # fmt: skip
        self.env.step(self._chosen(actions, agent))
        return self._to_a_learner()

    def _to_a_learner(self) -> dict[Any, Told]:
        """Makes the turns of the dead and the others; stops where a learner decides."""
        env, mine = self.env, set(self.learners)
        told: dict[Any, Told] = {}
        while env.agents:
            agent = env.agent_selection
            observation, reward, terminated, truncated, info = env.last()
            amount = self._pay(agent, reward)
            if agent in mine and (agent in self.live or not (terminated or truncated)):
                one = Told(observation, amount, info, bool(terminated), bool(truncated))
                told[agent] = self._note(agent, one)
                if not one.ended:
                    break
            elif agent in mine:  # it ended before it had decided anything
                self._ended.add(agent)
            is_dead = terminated or truncated
            env.step(None if is_dead else self._by_others(agent, observation, info))
            if len(self._ended) == len(self.learners):
                for other in env.agents:  # what they weren't told any more
                    self._pay(other, env._cumulative_rewards.get(other, 0.0))
                break
        for agent in [one for one in self.live if one not in env.agents]:
            told[agent] = self._note(agent, self._gone(agent))
        return told

    def _gone(self, agent: Any) -> Told:
        """Somebody who is gone and had no turn to be told: the last that there is of it."""
        env, last = self.env, self.live[agent]
        amount = self._pay(agent, env._cumulative_rewards.get(agent, 0.0))
        terminated = bool(env.terminations.get(agent))
        return Told(last.observation, amount, last.info, terminated, not terminated)
