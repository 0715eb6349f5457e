"""A multi-agent environment from one decision of a learner to the next.

Other agents act by their policies, and agents that ended make their last turns.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from gamekeeper.errors import ActionError, ContractError
from gamekeeper.interface.joint_policy import JointPolicy


@dataclass(frozen=True, slots=True)
class StepOutput:
    """Observation and reward of a learner before its next decision, or at its end.

    Attributes:
        observation, info: as the environment gave them.
        reward: sum since its last decision.
        terminated, truncated: True where it ended so.
    """

    observation: Any
    reward: float
    info: Any
    terminated: bool = False
    truncated: bool = False

    @property
    def ended(self) -> bool:
        """True if it takes no further decision."""
        return self.terminated or self.truncated


class LearnerSteps:
    """One copy of an environment. Use `LearnerTicks` or `LearnerTurns`.

    Args:
        env: a ParallelEnv or AECEnv.
        learners: agents that learn, in the order of `possible_agents`.
        others: policies of the rest; None where all agents learn.

    Attributes:
        paid: by agent, learners and others, its rewards in the episode.
        live: learners that were observed and haven't ended.
    """

    def __init__(self, env: Any, learners: Collection[Any], others: JointPolicy | None) -> None:
        self.env, self.learners, self.others = env, tuple(learners), others
        self.paid: dict[Any, float] = {}
        self.live: dict[Any, StepOutput] = {}
        self._ended: set[Any] = set()

    @property
    def is_over(self) -> bool:
        """True if no decision follows: no agent is live, or all that learn have ended."""
        return not self.env.agents or len(self._ended) == len(self.learners)

    def begin(self, seed: int | None, options: Mapping[str, Any] | None) -> dict[Any, StepOutput]:
        """Begins an episode; returns the observations of learners that decide first."""
        self.paid, self.live, self._ended = {}, {}, set()
        self._reset({"seed": seed} if options is None else {"seed": seed, "options": options})
        return self._play_on(self._first())

    def act(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        """Plays on until a learner decides again or the episode is over.

        Args:
            actions: of exactly the learners that were observed last and are live.
        Returns:
            Learners that decide next or ended meanwhile; a learner of an AEC environment that waits
            for its turn isn't among them.
        Raises:
            ActionError: an action is missing, or is of an agent that doesn't decide now.
            ContractError: an agent that ended has come back.
        """
        return self._play_on(self._play(actions))

    def _play_on(self, outputs: dict[Any, StepOutput]) -> dict[Any, StepOutput]:
        """Plays on while no learner decides, as none of them is live or has the turn."""
        while not self.is_over and all(output.ended for output in outputs.values()):
            outputs |= self._play({})
        return {agent: outputs[agent] for agent in self.learners if agent in outputs}

    def _note(self, agent: Any, output: StepOutput) -> StepOutput:
        """Notes that a learner is live, or has ended."""
        if agent in self._ended:
            raise ContractError(
                f"{agent!r} has ended and is back within the episode",
                where=f"the roster, {agent!r}",
                expected="an end that lasts until the episode is over",
                actual="the agent among those that live",
                fix="name an agent that joins later anew: learners have one stream for each name",
            )
        if output.ended:
            self._ended.add(agent)
            self.live.pop(agent, None)
        else:
            self.live[agent] = output
        return output

    def _pay(self, agent: Any, reward: Any) -> float:
        amount = float(reward)
        self.paid[agent] = self.paid.get(agent, 0.0) + amount
        return amount

    def _by_others(self, agent: Any, observation: Any, info: Any) -> Any:
        assert self.others is not None  # every agent that doesn't learn has a policy
        return self.others.act(agent, observation, {} if info is None else info)

    def _chosen(self, actions: Mapping[Any, Any], agent: Any) -> Any:
        try:
            return actions[agent]
        except KeyError:
            raise ActionError(
                f"{agent!r} was observed and has no action",
                where="step",
                expected=f"an action of {agent!r}",
                actual=", ".join(map(str, actions)) or "no actions",
                fix="give an action to each agent of the last observations that hasn't ended",
            ) from None

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def _first(self) -> dict[Any, StepOutput]:
        raise NotImplementedError

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        raise NotImplementedError


class LearnerTicks(LearnerSteps):
    """A Parallel environment: all live agents decide in each tick."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self._seen, self._infos = self.env.reset(**arguments)

    def _first(self) -> dict[Any, StepOutput]:
        live = set(self.env.agents)
        return {
            agent: self._note(agent, StepOutput(self._seen[agent], 0.0, self._infos.get(agent)))
            for agent in self.learners
            if agent in live
        }

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        mine, before = set(self.learners), list(self.env.agents)
        strangers = [agent for agent in actions if agent not in before or agent not in mine]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} doesn't decide now",
                where="step",
                actual=repr(strangers[0]),
                expected=", ".join(str(agent) for agent in before if agent in mine),
                fix="give actions to the agents of the last observations alone",
            )
        acts = {
            agent: self._chosen(actions, agent)
            if agent in mine
            else self._by_others(agent, self._seen[agent], self._infos.get(agent))
            for agent in before
        }
        self._seen, rewards, terms, truncs, self._infos = self.env.step(acts)
        paid = {agent: self._pay(agent, rewards.get(agent, 0.0)) for agent in before}
        live = set(self.env.agents)
        outputs: dict[Any, StepOutput] = {}
        for agent in self.learners:
            was_there = agent in acts
            if not was_there and agent not in live:
                continue
            if was_there and agent not in live and not (terms.get(agent) or truncs.get(agent)):
                outputs[agent] = self._note(agent, self._departed(agent, paid[agent]))
                continue
            output = StepOutput(
                self._seen[agent],
                paid.get(agent, 0.0),
                self._infos.get(agent),
                bool(terms.get(agent)),
                bool(truncs.get(agent)),
            )
            outputs[agent] = self._note(agent, output)
        return outputs

    def _departed(self, agent: Any, reward: float) -> StepOutput:
        """Output of an agent that left without an ending: terminated, with its last observation."""
        last = self.live[agent]
        return StepOutput(
            self._seen.get(agent, last.observation),
            reward,
            self._infos.get(agent, last.info),
            terminated=True,
        )


class LearnerTurns(LearnerSteps):
    """An AEC environment: one agent decides at a time; ended agents have turns of their own."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self.env.reset(**arguments)

    def _first(self) -> dict[Any, StepOutput]:
        return self._to_a_learner()

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        agent = self.env.agent_selection
        strangers = [other for other in actions if other != agent]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} acts out of turn",
                where="step",
                expected=repr(agent),
                actual=repr(strangers[0]),
                fix="give one action, that of the agent in the last observations",
            )
        self.env.step(self._chosen(actions, agent))
        return self._to_a_learner()

    def _to_a_learner(self) -> dict[Any, StepOutput]:
        """Makes the turns of ended and of other agents; stops where a learner decides."""
        env, mine = self.env, set(self.learners)
        outputs: dict[Any, StepOutput] = {}
        while env.agents:
            agent = env.agent_selection
            observation, reward, terminated, truncated, info = env.last()
            amount = self._pay(agent, reward)
            if agent in mine and (agent in self.live or not (terminated or truncated)):
                output = StepOutput(observation, amount, info, bool(terminated), bool(truncated))
                outputs[agent] = self._note(agent, output)
                if not output.ended:
                    break
            elif agent in mine:  # it ended before it had decided anything
                self._ended.add(agent)
            is_dead = terminated or truncated
            env.step(None if is_dead else self._by_others(agent, observation, info))
            if len(self._ended) == len(self.learners):
                for other in env.agents:  # rewards that no turn of theirs will show
                    self._pay(other, env._cumulative_rewards.get(other, 0.0))
                break
        for agent in [each for each in self.live if each not in env.agents]:
            outputs[agent] = self._note(agent, self._departed(agent))
        return outputs

    def _departed(self, agent: Any) -> StepOutput:
        """Output of an agent that left without a last turn, with its last observation."""
        env, last = self.env, self.live[agent]
        amount = self._pay(agent, env._cumulative_rewards.get(agent, 0.0))
        is_cut = bool(env.truncations.get(agent)) and not env.terminations.get(agent)
        return StepOutput(last.observation, amount, last.info, not is_cut, is_cut)
