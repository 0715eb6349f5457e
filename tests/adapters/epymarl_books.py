"""Compares what an EPyMARL runner writes down, once it has played the ledger, with the log."""

from __future__ import annotations

from typing import Any, Final

from gymnasium.spaces import unflatten

from gamekeeper.errors import SpecError
from gamekeeper.randomness.seeds import episode_seed
from tests.adapters import ledger
from tests.adapters.ledger import Cell, Code, Decision
from tests.adapters.sb3_books import ENVS, EPISODES, SEED, log

NUMBERED: Final = "refused: EPyMARL has numbered actions only"


def expected(cell: Cell) -> str:
    """Reason why a cell is refused; empty where it is taken."""
    return "" if cell.form == "Discrete" else NUMBERED


def episodes(cell: Cell) -> str:
    """Plays episodes as EPyMARL's runner does and compares them; says why if refused."""
    from gamekeeper.adapters.epymarl import multi_agent_env

    role = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    options = {"common_reward": None, "time_limit": 100, "check": None, "seed": SEED, **role}
    try:
        env = multi_agent_env(cell.spec, env_kwargs=cell.kwargs, **options)
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0]}"
    found: dict[Code, Decision] = {}
    for _ in range(ENVS * EPISODES):
        _Book(env, cell, found).play()
    whole = log(cell)
    assert sorted(found) == sorted(whole)
    for code, decision in whole.items():
        assert repr(found[code]) == repr(decision)
    env.close()
    return ""


class _Book:
    """Book of one episode: what is seen, available, done and paid, step by step."""

    def __init__(self, env: Any, cell: Cell, found: dict[Code, Decision]) -> None:
        self.env, self.cell, self.found = env, cell, found
        self.open: dict[int, Decision] = {}
        self.before = [0.0] * env.n_agents

    def play(self) -> None:
        """Steps to the end; the end of all is that of the agents that ended last."""
        env = self.env
        env.reset()
        is_over = False
        while not is_over:
            legal = env.get_avail_actions()
            actions = [flags.index(1) for flags in legal]
            for agent in self._acting():
                actions[agent] = self._decided(agent, legal[agent])
            _, rewards, terminated, truncated, info = env.step(actions)
            is_over = terminated or truncated
            self._note(rewards)
            assert info == {"episode_limit": truncated}
        assert not self.open
        first = episode_seed(SEED, env.episode) % ledger.SIZES[0]
        ends = ledger.ENDS[self.cell.ends]
        last = [agent for agent, end in enumerate(ends) if end == max(ends)]
        assert terminated == any(ledger.ending(first, agent)[0] for agent in last)

    def _acting(self) -> list[int]:
        env = self.env
        turn = env.env.agent_selection if self.cell.api == "aec" else None
        return [i for i, a in enumerate(env.agents) if env.live[i] and (turn is None or turn == a)]

    def _code(self, agent: int) -> Code:
        row = self.env.get_obs_agent(agent)
        return ledger.decode(self.cell.seen, unflatten(ledger.SEEN[self.cell.seen], row))

    def _decided(self, agent: int, legal: Any) -> int:
        code = self._code(agent)
        if self.cell.mask:
            ledger.same(legal, ledger.flat_flags(self.cell.form, code))
        action = ledger.act(self.cell.form, code, masked=self.cell.mask)
        if agent in self.open:
            self.open[agent].following = code
        decision = Decision(agent, code, action, before=self.before[agent])
        self.open[agent] = self.found[code] = decision
        self.before[agent] = 0.0
        return int(action)

    def _note(self, rewards: Any) -> None:
        env = self.env
        for agent, paid in enumerate(rewards):
            if agent in self.open:
                self.open[agent].reward += float(paid)
            else:
                self.before[agent] += float(paid)
            flags = bool(env.terminations[agent]), bool(env.truncations[agent])
            if any(flags) and agent in self.open:
                ended = self.open.pop(agent)
                ended.end, ended.following = flags, self._code(agent)
