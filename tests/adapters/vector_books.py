"""Arrays of a vector environment that has played the ledger, against the log."""

from __future__ import annotations

from typing import Any

import numpy as np

import gamekeeper as gk
from gamekeeper.adapters.slot_views import at, put, zeros
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector.vector_form import ALL, MASK
from tests.adapters import ledger
from tests.adapters.ledger import Cell, Decision

ENVS, EPISODES, SEED = 2, 2, 3


def arrays(cell: Cell) -> str:
    """Steps a vector environment and compares it with the log; every cell is taken."""
    found = _Reader(cell).read()
    for env in range(ENVS):
        expected: list[list[Decision]] = [[] for _ in cell.learners]
        for k in range(EPISODES):
            for decision in ledger.decisions(cell, episode_seed(SEED, env + k * ENVS)):
                if decision.agent < len(cell.learners):
                    expected[decision.agent].append(decision)
        for agent, decisions in enumerate(expected):
            got = found[env][agent][: len(decisions)]
            assert [repr(one) for one in got] == [repr(one) for one in decisions]
    return ""


class _Reader:
    """Steps a vector environment by the ledger's rule, and reads its arrays agent by agent."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.is_aec = cell, cell.api == "aec"
        self.venv = gk.vector.make(
            cell.spec, ENVS, engine="serial", seed=SEED, env_kwargs=cell.kwargs
        )
        self.found: Any = [[[] for _ in cell.learners] for _ in range(ENVS)]
        self.before = np.zeros((ENVS, len(cell.learners)))
        self.is_open = np.zeros(self.before.shape, bool)

    def read(self) -> Any:
        """Decisions, [env][agent]."""
        obs, infos = self.venv.reset()
        steps = EPISODES * max(ledger.ENDS[self.cell.ends])
        for _ in range(steps * (ledger.TURNS_A_TICK if self.is_aec else 1)):
            joint = {group.name: self._chosen(group, obs, infos) for group in self.venv.groups}
            obs, rewards, terms, truncs, infos = self.venv.step(joint.get(ALL, joint))
            self._note(rewards, terms, truncs, infos)
        self.venv.close()
        return self.found

    def _of(self, group: Any, part: Any) -> Any:
        return part if group.name == ALL else part[group.name]

    def _chosen(self, group: Any, obs: Any, infos: Any) -> Any:
        """Actions of a group of agents; notes each learner's decision."""
        lead = (ENVS,) if self.is_aec else (ENVS, len(group.agents))
        actions = zeros(group.action_space, lead)
        for env in range(ENVS):
            for place, name in enumerate(group.agents):
                column = group.first + place
                acts = infos["turn"][env] == column if self.is_aec else None
                live = self._of(group, infos["live"])[env, place]
                if name in self.cell.learners and (live if acts is None else acts):
                    index = env if self.is_aec else (env, place)
                    put(actions, index, self._decided(group, env, place, index, obs, infos))
        return actions

    def _decided(self, group: Any, env: int, agent: int, index: Any, obs: Any, infos: Any) -> Any:
        seen = at(self._of(group, obs), index)
        if isinstance(seen, dict) and MASK in seen:
            seen = {key: part for key, part in seen.items() if key != MASK}
        code = ledger.decode(self.cell.seen, seen)
        ledger.same(seen, ledger.encode(self.cell.seen, code))
        if self.cell.mask:
            flags = self._of(group, infos[MASK])[index]
            ledger.same(flags, ledger.flat_flags(self.cell.form, code))
        action = ledger.act(self.cell.form, code, masked=self.cell.mask)
        log = self.found[env][agent]
        if self.is_open[env, agent]:
            log[-1].following = code
        log.append(Decision(agent, code, action, before=float(self.before[env, agent])))
        self.before[env, agent], self.is_open[env, agent] = 0.0, True
        return action

    def _note(self, rewards: Any, terms: Any, truncs: Any, infos: Any) -> None:
        group = next(g for g in self.venv.groups if "dog_0" in g.agents)
        paid, ended, cut = (self._of(group, part) for part in (rewards, terms, truncs))
        for env, agent in np.ndindex(*self.before.shape):
            log = self.found[env][agent]
            if self.is_open[env, agent]:
                log[-1].reward += float(paid[env, agent])
            else:
                self.before[env, agent] += float(paid[env, agent])
            if ended[env, agent] or cut[env, agent]:
                final = at(self._of(group, infos["final_obs"][env]), agent)
                log[-1].following = ledger.decode(self.cell.seen, final)
                log[-1].end = bool(ended[env, agent]), bool(cut[env, agent])
                self.is_open[env, agent] = False
