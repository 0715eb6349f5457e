"""A block of AEC copies: each step is one turn of whoever's turn it is in each copy.

A dead agent's None turn is no step of anybody's: it is made at once, and what it is given there
(its last observation and info) is final.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.interface.capture import AgentId
from gamekeeper.vector.sub_env_block import StepOutputs, SubEnvBlock, bare, put_mask
from gamekeeper.vector.vector_form import getter


class TurnBlock(SubEnvBlock):
    """Copies of an AEC environment."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._bare = [bare(env) for env in self.envs]
        self._last_infos: list[dict[AgentId, Any]] = [{} for _ in self.envs]  # infos of who ended
        self._ended: list[set[tuple[str, AgentId]]] = [set() for _ in self.envs]
        self._leaves = [
            [(getter(leaf.path), i) for i, leaf in enumerate(group.observed)]
            for group in self.form.groups
        ]
        self._finals = [name for name in self._arrays if name.startswith("final.")]
        self._givens = [name for name in self._arrays if name.startswith(("obs.", "mask."))]

    def _begin(self, e: int, outputs: StepOutputs) -> None:
        self._reset_env(e)
        self._last_infos[e], self._ended[e] = {}, set()
        self._arrays["live"][e] = False
        self._find_live(e, outputs)
        self._turn_of_the_living(e, outputs, {})

    def step(self) -> StepOutputs:
        """One turn in every copy; a copy that is over begins anew, when `autoreset` says so."""
        outputs, arrays = StepOutputs(), self._arrays
        for name in ("rewards", "terminated", "truncated", "ended"):
            arrays[name][...] = 0
        fresh, turns = arrays["over"].tolist(), arrays["turn"].tolist()
        actions = [read() for read in self._actions]
        for e in range(len(self.envs)):
            arrays["cursor"][0] = e
            if fresh[e]:
                arrays["over"][e] = False
                self._episodes[e] += self._slots
                self._begin(e, outputs)
                continue
            row = actions[self._group_of[turns[e]]][e]
            self.envs[e].step(row)
            paid: dict[AgentId, float] = {}
            self._note(e, paid)
            self._turn_of_the_living(e, outputs, paid)
            for agent, reward in paid.items():
                arrays["rewards"][e, self._column[agent]] = reward
            self._after_env()
        return outputs

    def _note(self, e: int, paid: dict[AgentId, float]) -> None:
        """Notes rewards and endings of the last step."""
        env = self._bare[e]
        if any(env.rewards.values()):
            for agent, reward in env.rewards.items():
                if reward:
                    paid[agent] = paid.get(agent, 0.0) + float(reward)
        column, ended = self._column, self._ended[e]
        for name in ("terminated", "truncated"):
            flags: Mapping[AgentId, Any] = getattr(env, _FLAGS[name])
            if True in flags.values():
                for agent, flag in flags.items():
                    if flag and (name, agent) not in ended:
                        ended.add((name, agent))
                        self._arrays[name][e, column[agent]] = True

    def _turn_of_the_living(self, e: int, outputs: StepOutputs, paid: dict[AgentId, float]) -> None:
        """Makes the None turns of the dead, then shows what the agent in turn is given."""
        env, recorded = self._bare[e], self.envs[e]
        while env.agents:
            agent = env.agent_selection
            observation, _, terminated, truncated, info = recorded.last()
            if not (terminated or truncated):
                if self._ended[e]:
                    self._keep_late_finals(e, outputs)
                self._find_live(e, outputs)
                self._show(e, agent, observation, info, outputs)
                return
            self._keep_final(e, agent, observation, info, outputs)
            recorded.step(None)
            self._note(e, paid)
        self._over(e, outputs)

    def _keep_late_finals(self, e: int, outputs: StepOutputs) -> None:
        """Last observations of agents that have ended and whose last turn comes after others'."""
        env = self._bare[e]
        for agent in env.agents:
            if env.terminations.get(agent) or env.truncations.get(agent):
                self._keep_final(e, agent, env.observe(agent), env.infos.get(agent, {}), outputs)

    def _keep_final(
        self, e: int, agent: AgentId, observation: Any, info: Any, outputs: StepOutputs
    ) -> None:
        """Keeps the last observation of an agent beside those of agents that ended before it."""
        last_infos, column = self._last_infos[e], self._column[agent]
        if agent in last_infos:
            return
        if not last_infos:
            self._blank_finals(e)
        g = self._group_of[column]
        for get, i in self._leaves[g]:
            self._arrays[f"final.{g}.{i}"][e, column - self.form.groups[g].first] = get(observation)
        last_infos[agent] = info
        outputs.final[e] = dict(last_infos)

    def _blank_finals(self, e: int) -> None:
        for name in self._finals:
            self._arrays[name][e] = 0

    def _find_live(self, e: int, outputs: StepOutputs) -> None:
        env, row = self._bare[e], self._arrays["live"][e]
        if len(env.agents) == self._count and not self._ended[e]:
            row[...] = True
            return
        was_live = row.copy()
        row[...] = False
        for agent in env.agents:
            is_dead = env.terminations.get(agent) or env.truncations.get(agent)
            row[self._column[agent]] = not is_dead
        self._note_departures(e, was_live & ~row, outputs)

    def _note_departures(self, e: int, departed: NDArray[np.bool_], outputs: StepOutputs) -> None:
        """Notes agents that left without an ending as terminated; they have no last observation."""
        ended = {agent for _, agent in self._ended[e]}
        for column in departed.nonzero()[0].tolist():
            agent = self._agents[column]
            if agent in ended:
                continue
            self._ended[e].add(("terminated", agent))
            self._arrays["terminated"][e, column] = True
            if not self._last_infos[e]:
                self._blank_finals(e)
            self._last_infos[e][agent] = {}
            outputs.final[e] = dict(self._last_infos[e])

    def _show(
        self, e: int, agent: AgentId, observation: Any, info: Any, outputs: StepOutputs
    ) -> None:
        column = self._column[agent]
        g = self._group_of[column]
        if len(self.form.groups) > 1:
            for name in self._givens:
                self._arrays[name][e] = 0
        for get, i in self._leaves[g]:
            self._arrays[f"obs.{g}.{i}"][e] = get(observation)
        self._arrays["turn"][e] = column
        if self.form.groups[g].flags:
            put_mask(self._arrays[f"mask.{g}"][e], self.form.masks[agent](observation, info))
        if self._wants_infos:
            outputs.infos[e] = {agent: info}

    def _over(self, e: int, outputs: StepOutputs) -> None:
        arrays = self._arrays
        self._note_departures(e, arrays["live"][e], outputs)
        if not self._last_infos[e]:
            self._blank_finals(e)
        outputs.final[e] = dict(self._last_infos[e])
        arrays["ended"][e] = True
        for name in self._givens:
            arrays[name][e] = 0
        arrays["live"][e] = False
        arrays["over"][e] = self.autoreset == "next_step"
        if self.autoreset == "same_step":
            self._episodes[e] += self._slots
            self._begin(e, outputs)


_FLAGS: Final = {"terminated": "terminations", "truncated": "truncations"}
