"""Extremes: crowds, nobody, names that are anything, values that are no numbers, long and short."""

import json
import tracemalloc
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv, ParallelEnv

import gamekeeper as gk
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import Replay, replay_evidence
from gamekeeper.runs.run_check import verify
from tests.cli.lines import document, said

NAMES: Final = [
    "../x",
    "/etc/passwd",
    "a/b",
    "C:\\x",
    "CON",
    "nul\0l",
    "new\nline",
    "\x1b[31mred",
    "",
    "  ",
    "\u202eright to left",
    "\u200f",
    "caf\u00e9",
    "cafe\u0301",
    "n" * 10_000,
    "\ud800",
    "\U0001f600",
    "agent",
    "Agent",
    "obs",
    "a.b",
    "a@b",
    "__all__",
    "0",
    "null",
    "%s{}",
    "'; drop table steps; --",
    "<script>alert(1)</script>",
]
"""Names of agents that a file system, a terminal, a page, SQL or a format might stumble over."""


class Ticks(gk.TickEnv):
    """Everybody is paid the number of the tick, in `length` ticks.

    Args:
        agents: their names.
        length: ticks of an episode; 0: all leave at once.
        size: numbers of an observation; each agent's has one more, where `own`.
        own: spaces differ from agent to agent.
    """

    metadata = {"name": "extreme_ticks_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(
        self, agents: Any = ("a",), length: int = 3, size: int = 1, own: bool = False
    ) -> None:
        super().__init__()
        self.length, self.tick_no = length, 0
        self.possible_agents = list(agents)
        spaces = [Box(-99, 99, (size + own * i,), np.float32) for i in range(len(agents))]
        self.observation_spaces = dict(zip(agents, spaces, strict=True))
        self.action_spaces = {agent: Discrete(2) for agent in agents}

    def start(self, rng: Any, options: Any) -> None:
        self.tick_no = 0

    def tick(self, actions: Any) -> None:
        self.tick_no += 1
        for agent in list(self.agents):
            self.add_reward(agent, float(self.tick_no))
            if self.tick_no >= self.length:
                self.terminate(agent, "over")

    def observe(self, agent: Any) -> Any:
        space = self.observation_spaces[agent]
        return np.full(space.shape, self.tick_no, np.float32)


class Turns(gk.TurnEnv):
    """The one in turn is paid, `length` times each."""

    metadata = {"name": "extreme_turns_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self, agents: Any = ("a",), length: int = 3) -> None:
        super().__init__()
        self.length, self.turn_no = length, 0
        self.possible_agents = list(agents)
        self.observation_spaces = {agent: Box(0, 1, (1,), np.float32) for agent in agents}
        self.action_spaces = {agent: Discrete(2) for agent in agents}

    def start(self, rng: Any, options: Any) -> None:
        self.turn_no = 0

    def act(self, agent: Any, action: Any) -> None:
        self.turn_no += 1
        self.add_reward(agent, 1.0)
        if self.turn_no >= self.length * len(self.possible_agents):
            for each in list(self.agents):
                self.terminate(each, "over")

    def observe(self, agent: Any) -> Any:
        return np.ones(1, np.float32)


def replayed(run: Path, env: Any) -> Replay:
    """A replay of `run` in `env`, in this process."""
    return replay_evidence(gk.load(run), open_env(env))


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("kind", [Ticks, Turns])
def test_names_of_agents_may_be_anything(
    kind: Any, own: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Recorded, verified, replayed, shown, reported, queried and exported under their names."""
    settings = {"own": own} if kind is Ticks else {}
    run = tmp_path / "run"
    evidence = gk.rollout(kind(NAMES, **settings), episodes=2, out=run)
    names = evidence.manifest["agents"]
    assert [name for name, agent in zip(names, NAMES, strict=True) if name != agent] == [
        '""',
        '"\\ud800"',  # half of a pair, which UTF-8 doesn't carry
    ]
    assert replayed(run, kind(NAMES, **settings)).verified
    assert verify(run).ok
    code, shown, _ = said(capfd, "show", run)
    assert code == 0
    assert [sign for sign in "\x1b\0\u202e\u200f" if sign in shown] == []
    assert max(map(len, shown.splitlines())) < 200
    assert set(document(capfd, "show", run)[1]["agents"]) == set(names)
    assert said(capfd, "report", run, "--out", tmp_path / "page.html")[0] == 0
    page = (tmp_path / "page.html").read_text()
    assert [text for text in ("\0", "\x1b", "<script>alert") if text in page] == []
    sql = "select distinct agent from agent_steps"
    rows = document(capfd, "query", run, sql, "--rows", 99)[1]["rows"]
    assert {row["agent"] if isinstance(row, dict) else row[0] for row in rows} == set(names)
    assert said(capfd, "export", run, "--to", "numpy", "--out", tmp_path / "a.npz")[0] == 0
    inside = sorted(path.name for path in tmp_path.iterdir())
    assert inside == ["a.npz", "page.html", "run"]


@pytest.mark.parametrize("agents", [[0, "0"], ["", '""'], [1, "1", "1'"], [("a", 1), '["a",1]']])
def test_names_that_are_spelled_alike_stay_apart(agents: list[Any], tmp_path: Path) -> None:
    """An agent 0 and an agent "0" have a name each, and their own rows."""
    evidence = gk.rollout(Ticks(agents), episodes=1, out=tmp_path / "run")
    assert len(set(evidence.manifest["agents"])) == len(agents)
    assert {agent.return_mean for agent in evidence.summary.agents.values()} == {6.0}
    assert len(evidence.summary.agents) == len(agents)
    assert replayed(tmp_path / "run", Ticks(agents)).verified


class NobodyTicks(ParallelEnv):  # type: ignore[type-arg]
    """A game for which nobody came."""

    metadata = {"name": "nobody_ticks_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self) -> None:
        self.possible_agents: list[str] = []
        self.agents: list[str] = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        return {}, {}

    def step(self, actions: Any) -> Any:
        return {}, {}, {}, {}, {}


class NobodyTurns(AECEnv):  # type: ignore[type-arg]
    """The same in turns."""

    metadata = {"name": "nobody_turns_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self) -> None:
        self.possible_agents, self.agents = [], []

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.rewards, self._cumulative_rewards, self.infos = {}, {}, {}
        self.terminations, self.truncations, self.agent_selection = {}, {}, None

    def step(self, action: Any) -> None:
        raise AssertionError("nobody is there to step")


@pytest.mark.parametrize(
    ("kind", "turns"), [(NobodyTicks, 0), (NobodyTurns, 0), (Ticks, 3), (Turns, 4)]
)
def test_nobody_and_one_alone_are_recorded(
    kind: Any, turns: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One agent makes a game (in turns it steps once more to leave); none, episodes of no turn."""
    run = tmp_path / "run"
    evidence = gk.rollout(kind(), episodes=2, out=run)
    assert evidence.episode_table["turns"].to_pylist() == [turns] * 2
    assert evidence.manifest["status"] == "finalized"
    assert verify(run).ok
    assert replayed(run, kind()).verified
    assert said(capfd, "show", run)[0] == 0
    assert said(capfd, "report", run, "--out", tmp_path / "page.html")[0] == 0


def test_audit_of_nobody_is_a_finding_and_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """No check of ours breaks where there is nobody to look at."""
    monkeypatch.setattr("gamekeeper.auditing.confirm.TRIES", 1)
    for kind in (NobodyTicks, NobodyTurns):
        found = gk.audit(kind, budget=200, select=("GK",))
        assert [v.id for v in found.verdicts if v.outcome == "error"] == []


@pytest.mark.parametrize("kind", [Ticks, Turns])
def test_crowd_costs_in_proportion(kind: Any, tmp_path: Path) -> None:
    """A thousand agents: a row each where they act, verified and summed up."""
    crowd = [f"a_{i}" for i in range(1_000)]
    evidence = gk.rollout(kind(crowd, length=1), episodes=1, out=tmp_path / "run")
    assert len(evidence.summary.agents) == len(crowd)
    assert evidence.agent_steps.num_rows <= 4 * len(crowd)
    assert replayed(tmp_path / "run", kind(crowd, length=1)).verified


def test_thousands_of_short_episodes_are_kept(tmp_path: Path) -> None:
    """One turn each, every one with its seed and its end."""
    evidence = gk.rollout(Ticks(length=1), episodes=1_000, out=tmp_path / "run")
    assert evidence.episode_table["end"].to_pylist() == ["ended"] * 1_000
    assert evidence.episode_table["turns"].to_pylist() == [1] * 1_000
    assert len(set(evidence.episode_table["seed"].to_pylist())) == 1_000
    assert verify(tmp_path / "run").ok


def test_memory_stays_flat_over_a_long_episode(tmp_path: Path) -> None:
    """Four times as many turns in one episode take no more of Python's memory."""
    peaks = []
    for length in (4_000, 16_000):
        env = Turns(("a", "b"), length=length // 2)
        tracemalloc.start()
        try:
            gk.rollout(env, episodes=1, out=tmp_path / str(length), level="digest")
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert gk.load(tmp_path / str(length)).episode_table["turns"].to_pylist() == [length + 2]
    assert peaks[1] < 2 * peaks[0] + 4_000_000


class Nonconforming(ParallelEnv):  # type: ignore[type-arg]
    """Observations, rewards and infos that are no numbers, or no finite ones."""

    metadata = {"name": "nonconforming_v0"}  # noqa: RUF012  # as PettingZoo declares it
    VALUES: Final = (float("nan"), float("inf"), -float("inf"), -0.0, 1e308, 5e-324)

    def __init__(self) -> None:
        self.possible_agents, self.tick_no = ["a"], 0

    def observation_space(self, agent: str) -> Any:
        return Box(-np.inf, np.inf, (1,), np.float64)

    def action_space(self, agent: str) -> Any:
        return Discrete(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.tick_no = ["a"], 0
        return {"a": np.array([self.VALUES[0]])}, {"a": {}}

    def step(self, actions: Any) -> Any:
        value = self.VALUES[self.tick_no]
        self.tick_no += 1
        over = self.tick_no == len(self.VALUES)
        self.agents = [] if over else ["a"]
        seen = self.VALUES[min(self.tick_no, len(self.VALUES) - 1)]
        info = {"value": value, "array": np.array([value]), "big": 1 << 200}
        return tuple({"a": part} for part in (np.array([seen]), value, over, False, info))


def test_numbers_that_are_not_finite_are_kept_bit_for_bit(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """NaN, infinities and -0.0 come back, replay, and leave every document strict JSON."""
    run = tmp_path / "run"
    evidence = gk.rollout(Nonconforming(), episodes=1, out=run)
    seen = [turn.observations["a"][0] for turn in evidence.episodes[0].turns]
    assert np.array(seen[:6]).tobytes() == np.array(Nonconforming.VALUES).tobytes()
    assert replayed(run, Nonconforming()).verified
    code, found = document(capfd, "show", run)  # refuses NaN, which is no JSON
    assert (code, found["episodes"]) == (0, 1)
    assert said(capfd, "report", run, "--out", tmp_path / "page.html")[0] == 0
    manifest = (run / "manifest.json").read_text()
    json.loads(manifest, parse_constant=pytest.fail)


@pytest.mark.parametrize("level", ["full", "digest"])
def test_large_observation_is_kept(level: str, tmp_path: Path) -> None:
    """One observation of 16 MB a turn; the benchmark takes 100 MB."""
    env = Ticks(length=2, size=4_000_000)
    evidence = gk.rollout(env, episodes=1, out=tmp_path / "run", level=level)
    assert evidence.agent_steps.num_rows == 3
    assert verify(tmp_path / "run").ok
    assert replayed(tmp_path / "run", Ticks(length=2, size=4_000_000)).verified
