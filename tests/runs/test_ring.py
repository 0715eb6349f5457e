"""Runs that retain some of their episodes, the figures of the others, and a size."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.episodes.outcome import outcome_of
from gamekeeper.errors import ContractError, EvidenceError, OrderError
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record
from gamekeeper.runs.ring import keep_rule as rules
from gamekeeper.runs.ring.keep_rule import KeepRule, keep_rule
from gamekeeper.runs.ring.ring_ledger import RingEpisode, RingLedger
from gamekeeper.runs.ring.ring_store import RingStore, create_ring
from gamekeeper.runs.run_check import recover, verify
from tests.runs.plays import replayed, write_env
from tests.runs.walks import Turns, Walk


def trained(
    env: Any, episodes: int, *, first: int = 0, after: Callable[[], None] | None = None
) -> None:
    """Plays episodes of which the returns go up and down."""
    for episode in range(first, first + episodes):
        env.reset(seed=episode)
        while env.agents:
            if hasattr(env, "agent_selection"):
                ended = env.last()[2]
                env.step(None if ended else episode % 3)
            else:
                env.step(dict.fromkeys(env.agents, episode % 3))
        if after is not None:
            after()


@pytest.mark.parametrize(
    ("text", "last", "has_failed", "most_bytes"),
    [
        ("failed", 0, True, rules.BYTES),
        ("last 1000", 1000, False, rules.BYTES),
        ("64 MB", None, False, 64_000_000),
        ("failed, last 10, 1.5GB", 10, True, 1_500_000_000),
        ("9000 kB, failed", 0, True, 9_000_000),
    ],
)
def test_keep_rule_reads_its_parts(
    text: str, last: int | None, has_failed: bool, most_bytes: int
) -> None:
    """Failed episodes, a number of the last ones and a size stand between commas."""
    assert KeepRule(text, last, has_failed, most_bytes) == keep_rule(text)


@pytest.mark.parametrize("text", ["", "first 3", "last", "failed, failed", "1 MB", "last 3;", 5])
def test_keep_rule_refuses_what_it_cannot_read(text: Any) -> None:
    """The error shows how a rule is written."""
    with pytest.raises(EvidenceError, match="which episodes are retained") as caught:
        keep_rule(text)
    assert 'keep="failed, last 100, 64 MB"' in caught.value.fix


def test_keep_rule_puts_marked_before_failed_before_last() -> None:
    """Where room is short the newest failed episodes go before the last ones, marks before both."""
    ended = [RingEpisode(n, size_bytes=10.0, is_failed=n in (2, 3, 6)) for n in range(9)]
    rule = KeepRule("", 3, True, 200)  # room for five

    assert {0, 2, 3, 6, 8} == rule.retained(ended, [0])
    assert {6, 7, 8, 3, 2} == rule.retained(ended, [])
    assert {0, 1} == KeepRule("", 0, True, 40).retained(ended, [0, 1])


@pytest.mark.parametrize("kind", [Walk, Turns])
@pytest.mark.parametrize("level", ["actions", "full"])
def test_ring_keeps_failed_and_marked_episodes(kind: Any, level: str, tmp_path: Path) -> None:
    """Failed, last, longest, best and worst ones stay under their numbers; sums tell the rest."""
    env = record(kind(), tmp_path / "run", level=level, keep="failed, last 2", failed="return < 3")
    trained(env, 12)
    env.close()
    kept = load(tmp_path / "run")
    keep = kept.manifest["keep"]

    assert kept.episode_table["episode"].to_pylist() == [0, 2, 3, 6, 9, 10, 11]
    assert keep["failed"] == [0, 3, 6, 9]
    assert keep["marked"] == {"longest": 0, "best": 2, "worst": 0}
    assert (keep["seen"], keep["retained"], keep["dropped"]["episodes"]) == (12, 7, 5)
    assert keep["dropped"]["ends"] == {"ended": 5}
    assert keep["dropped"]["agents"]["a"]["endings"] == {"terminated": 5}
    assert verify(tmp_path / "run").ok
    everything = record(kind(), tmp_path / "all", level=level)
    trained(everything, 12)
    everything.close()
    outcomes = {each.episode: outcome_of(each) for each in load(tmp_path / "all").episodes}
    dropped = [outcomes[number] for number in (1, 4, 5, 7, 8)]
    sums = keep["dropped"]["agents"]["b"]["returns"]
    assert sums["sum"] == sum(each.returns["b"] for each in dropped)
    assert sums["max"] == max(each.returns["b"] for each in dropped)
    assert keep["dropped"]["lengths"]["sum"] == sum(each.turns for each in dropped)
    for episode in kept.episodes:
        assert outcomes[episode.episode] == outcome_of(episode)


def test_ring_replays_and_expands_under_the_numbers_of_the_training(tmp_path: Path) -> None:
    """Replay, expand and report take a run whose numbers have gaps."""
    path = write_env(tmp_path)
    env = record(gk.make(f"{path}:Walk"), tmp_path / "run", level="actions", keep="last 2")
    trained(env, 9)
    env.close()

    assert replayed(tmp_path / "run").verified
    whole = gk.expand(tmp_path / "run", tmp_path / "whole")
    assert load(tmp_path / "run").episode_table["episode"].to_pylist() == (
        whole.episode_table["episode"].to_pylist()
    )
    gk.report(tmp_path / "run", tmp_path / "page.html")
    assert "retains 4 of the 9 episodes" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "retains 4 of the 9 episodes" in str(load(tmp_path / "run"))


def ring_of(folder: Path, rule: KeepRule) -> RingStore:
    """An open run that retains what `rule` says."""
    facts = {"environment": {}, "level": "actions", "spaces": {}}
    return create_ring(folder, facts, RingLedger(rule, {}, Contract(), must_measure=False))


def poured(source: Path, ring: RingStore, *, rounds: int, after: Callable[[], None]) -> None:
    """Appends the episodes of a run again and again, under new numbers, one at a time."""
    tables = load(source).tables
    numbers = tables.table("episodes")["episode"].to_pylist()
    for number in range(rounds * len(numbers)):
        for stream in ("agent_steps", "episodes"):
            rows = tables.episode(stream, number % len(numbers)).combine_chunks()
            again = pa.array([number] * rows.num_rows, pa.int32())
            ring.append(stream, rows.set_column(0, "episode", again).to_batches()[0])
        after()


@pytest.fixture(scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of level `actions` with ten episodes."""
    folder = tmp_path_factory.mktemp("small") / "run"
    env = record(Walk(), folder, level="actions")
    trained(env, 10)
    env.close()
    return folder


def test_ring_stays_within_its_size_while_it_is_open(small_run: Path, tmp_path: Path) -> None:
    """Old segments go while recording goes on; the newest and the marked episodes stay."""
    sizes: list[int] = []
    ring = ring_of(tmp_path / "run", KeepRule("", 20, False, 200_000))

    def after() -> None:
        sizes.append(0)
        for path in (tmp_path / "run").iterdir():
            with suppress(FileNotFoundError):  # another thread takes segments away meanwhile
                sizes[-1] += path.stat().st_size * (path.suffix != ".tmp")

    poured(small_run, ring, rounds=12, after=after)
    table, entries = ring.settle()
    keep = entries["keep"]
    ring.finalize({"fingerprint": None})

    assert max(sizes) <= 200_000
    assert [0, 2, *range(100, 120)] == table["episode"].to_pylist()
    assert (keep["seen"], keep["retained"], keep["dropped"]["episodes"]) == (120, 22, 98)
    assert table.equals(load(tmp_path / "run").episode_table)
    assert {"agent_steps.parquet", "episodes.parquet", "manifest.json"} == {
        path.name for path in (tmp_path / "run").iterdir()
    }


def test_ring_is_whole_wherever_it_is_killed(
    small_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Copies taken after each append and around each step of a rewriting all recover."""
    copies: list[tuple[Path, int]] = []
    done = [0]

    def snapshot() -> None:
        if len(copies) == 16:
            return
        copies.append((tmp_path / f"copy-{len(copies)}", done[0]))
        shutil.copytree(tmp_path / "run", copies[-1][0])

    def watched(name: str) -> None:
        real = getattr(RingStore, name)

        def call(self: RingStore, *arguments: Any) -> Any:
            snapshot()
            found = real(self, *arguments)
            snapshot()
            return found

        monkeypatch.setattr(RingStore, name, call)

    def after() -> None:
        done[0] += 1
        if ring._worker is not None:
            ring._worker.join()

    ring = ring_of(tmp_path / "run", KeepRule("", 3, False, 40_000))
    watched("_write_manifest")
    watched("_anew")
    poured(small_run, ring, rounds=2, after=after)
    ring.abandon()

    assert len(copies) == 16
    for copy, episodes in copies:
        seen = load(copy).episode_table.num_rows
        evidence = recover(copy)
        keep = evidence.manifest["keep"]
        assert verify(copy).damage == ()
        assert seen == evidence.episode_table.num_rows == keep["retained"]
        assert episodes <= keep["seen"] == keep["dropped"]["episodes"] + seen <= episodes + 1
        assert "segments" not in evidence.manifest


def test_ring_asks_for_a_condition_that_is_measured(tmp_path: Path) -> None:
    """Failed episodes need a condition; one that asks for unknown figures ends with the first."""
    with pytest.raises(ContractError, match="nothing says when an episode failed"):
        record(Walk(), tmp_path / "none", keep="failed")
    with pytest.raises(EvidenceError, match="don't go together"):
        record(Walk(), tmp_path / "none", failed="return < 3")
    assert not (tmp_path / "none").exists()
    for keep in ("failed", "last 3"):
        env = record(Walk(), tmp_path / keep, level="actions", keep=keep, failed="missing < 3")
        trained(env, 1)
        with pytest.raises(ContractError, match="'missing'"):
            env.close()


def test_ring_reads_infos_of_ended_agents_at_level_actions(tmp_path: Path) -> None:
    """A condition may name numbers of the last infos, which a small run doesn't keep."""
    env = record(Walk(), tmp_path / "run", level="actions", keep="failed", failed="turn > 4")
    trained(env, 3)
    env.close()
    assert load(tmp_path / "run").manifest["keep"]["failed"] == [0, 1, 2]


def test_ring_records_vector_environments(tmp_path: Path) -> None:
    """Copies that are stepped together go into one run, of which some episodes stay."""
    path = write_env(tmp_path)
    venv = gk.vector.make(f"{path}:Walk", num_envs=3, seed=5)
    gk.record(venv, tmp_path / "run", level="actions", keep="failed, last 1", failed="return < 6")
    venv.reset()
    rng = np.random.default_rng(0)
    for _ in range(30):
        venv.step(rng.integers(0, 2, (3, 2)))
    venv.close()

    evidence = load(tmp_path / "run")
    keep = evidence.manifest["keep"]
    returns = {each.episode: outcome_of(each).team_return for each in evidence.episodes}
    assert keep["seen"] == 21
    assert evidence.manifest["checked"]["outcome"] == "not checked"
    assert keep["retained"] == evidence.episode_table.num_rows < 21
    assert all(returns[number] < 6 for number in keep["failed"])
    assert gk.replay(tmp_path / "run", allow_import=True).verified


def test_vector_environment_that_is_recorded_is_reset_once(tmp_path: Path) -> None:
    """A second reset is refused, and closing finalizes what was recorded until then."""
    path = write_env(tmp_path)
    venv = gk.vector.make(f"{path}:Walk", num_envs=2, seed=5)
    adapter = SimpleNamespace(slots=SimpleNamespace(venv=venv))  # as those to trainers hold it
    assert gk.record(adapter, tmp_path / "run", level="actions") is adapter
    venv.reset()
    with pytest.raises(OrderError, match="reset a second time"):
        venv.reset()
    venv.close()
    assert load(tmp_path / "run").episode_table["end"].to_pylist() == ["cut", "cut"]
