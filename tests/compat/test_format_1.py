"""Runs that a gamekeeper of format version 1 wrote: whatever comes later reads them for good.

A test here that fails after a change of the source is right: fix the source. The runs, what
stands in `worlds.py`, and the constants below are never changed.
"""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import Replay, replay_evidence
from gamekeeper.runs.files.folder import digest_file
from gamekeeper.runs.files.manifest import load_manifest
from gamekeeper.runs.files.notes import read_notes
from gamekeeper.runs.load_run import load
from gamekeeper.runs.run_check import recover, verify
from tests.cli.lines import document, said
from tests.runs.finalize_again import finalize_again

HERE: Final = Path(__file__).with_name("v1")
MARKET: Final = "full:0e968c9fe937232507611adfe441b1de0151b41b63359b633b97ebf1880444de"
MARKET_INFOS: Final = "full:e9e7dd523d7f57b5db4bc9269b9e219ff4e2c2ec79bb1a9fa6d072bf31485871"
RELAY: Final = "full:60ef6dabe6940d12e2447b0c116bf5737f788b269278637c269b17e8c5ad712b"
RELAY_INFOS: Final = "full:9c74b8c32dbccb226340d57d477478ccd99f63d8e89e39839b53b27ee79f2ba7"
FRAMES: Final = "full:c4e0d45064821346913793f1bcea4c57767a5313771200abb24f8b0af4b8894f"
FRAMES_INFOS: Final = "full:af956b1d3c631563afffeeaff28df47d754ed3e6fafd53a5aaa7f412ffa09496"
FAILED: Final = "full:5eeb6c150cb954fa7ccb982479d9d873d5106cdd2e670f592657d88a78d76242"
FAILED_INFOS: Final = "full:3766289795c22a6336bfc05b6dbd0a05d14241b33e0b4543aacbb3ee5339cee7"
OPEN: Final = "full:b01db75804e08f003805dff27920df1c33856b967fb2e9f3f3a80745454dc555"  # recovered
WORLDS: Final = "a9badde2fb8b7f89423352046c48c4e5"


def digest(fingerprint: str) -> str:
    """The fingerprint of the same episodes in a run of level `digest`."""
    return fingerprint.replace("full", "digest")


CUT: Final = ["ended", "ended", "cut"]
FINALIZED: Final = {  # fingerprint, of infos, rows, ends of episodes
    "parallel": (MARKET, MARKET_INFOS, 46, CUT),
    "digest": (digest(MARKET), digest(MARKET_INFOS), 46, CUT),
    "frames": (FRAMES, FRAMES_INFOS, 46, CUT),
    "aec": (RELAY, RELAY_INFOS, 67, ["ended"] * 3),
    "aec-digest": (digest(RELAY), digest(RELAY_INFOS), 67, ["ended"] * 3),
    "failed": (FAILED, FAILED_INFOS, 13, ["failed"]),
}
ALL: Final = [*FINALIZED, "open"]


def played_again(evidence: Evidence, *, policies: bool = False) -> Replay:
    """A replay in the environment beside the runs."""
    identity = evidence.manifest["environment"]
    factory = identity["entry_point"].split(":")[1]
    opened = open_env(f"{HERE / 'worlds.py'}:{factory}", **identity["kwargs"])
    return replay_evidence(evidence, opened, policies=policies)


def copied(name: str, folder: Path) -> Path:
    """A run that may be changed."""
    return Path(shutil.copytree(HERE / name, folder / name))


def test_worlds_are_as_they_were() -> None:
    """Nobody edits the environment that the runs were recorded in."""
    digests = {load(HERE / name).manifest["environment"]["source_digest"] for name in ALL}
    assert {WORLDS} == digests
    assert open_env(f"{HERE / 'worlds.py'}:Market").identity["source_digest"] == WORLDS


@pytest.mark.parametrize("name", FINALIZED)
def test_finalized_run_is_read(name: str) -> None:
    """Fingerprints, number of rows and ends are those of the day of recording."""
    evidence = gk.load(HERE / name)
    manifest = evidence.manifest
    ends = evidence.episode_table["end"].to_pylist()
    found = (
        manifest["fingerprint"],
        manifest["info_fingerprint"],
        evidence.agent_steps.num_rows,
        ends,
    )
    assert found == FINALIZED[name]
    assert manifest["format_version"] == 1
    assert manifest["status"] == ("failed" if name == "failed" else "finalized")


@pytest.mark.parametrize("name", FINALIZED)
def test_finalized_run_verifies(name: str) -> None:
    """Every byte is as it was finalized, and the rows digest to the fingerprint of that day."""
    found = verify(HERE / name, fingerprint=FINALIZED[name][0])
    assert (found.ok, found.self_consistent, found.matches) == (True, True, True), str(found)


@pytest.mark.parametrize("name", ALL)
def test_run_replays(name: str) -> None:
    """The environment of that day comes to the same rows, infos and states."""
    found = played_again(load(HERE / name))
    assert found.verified, str(found)


@pytest.mark.parametrize("name", ["aec", "failed"])
def test_policies_choose_as_they_did(name: str) -> None:
    """Seeds, our own stream and the random policy draw what they drew."""
    found = played_again(load(HERE / name), policies=True)
    assert found.verified, str(found)


def test_values_are_read_as_they_were() -> None:
    """NaN, -0.0, nonconforming values, names with a slash, masks, terms, volatile infos."""
    evidence = load(HERE / "parallel")
    rows = {(r["turn"], r["agent"]): r for r in evidence.episode(0).steps.to_pylist()}
    assert math.isnan(rows[2, "buyer_0"]["obs.near"][0])
    assert rows[2, "buyer_0"]["obs.near"][1] == math.inf
    assert math.copysign(1, rows[0, "buyer_0"]["obs.near"][1]) == -1
    assert rows[0, "seller_0"]["order"] == 1
    assert rows[2, "käufer/2"]["action@käufer/2"] == [2, 1]
    assert rows[3, "buyer_0"]["action_mask"] == bytes([1, 1, 1, 0])
    nonconforming = [json.loads(rows[turn, "buyer_0"]["nonconforming"]) for turn in (4, 2)]
    assert nonconforming[0]["obs"]["value"]["near"]["dtype"] == "<f8"
    assert nonconforming[1]["reward"]["type"] == "numpy.ndarray"
    assert evidence.episode_table["options"].to_pylist()[1] == '{"start":2.5}'
    relay = load(HERE / "aec")
    terms = [
        sum(v for v in relay.agent_steps[f"reward.{t}"].to_pylist() if v)
        for t in ("stride", "team")
    ]
    assert terms == [27.0, 3.0]
    assert relay.contract.volatile_infos() == {"wall_s"}


def test_failure_is_told() -> None:
    """What the environment raised stands with its episode."""
    (error,) = load(HERE / "failed").episode_table["error"].to_pylist()
    assert error.endswith("RuntimeError: the market burned down\n")


def test_labels_are_read() -> None:
    """The label of that day is listed, and the chain of annotations holds."""
    (note,) = read_notes(HERE / "aec")
    found = note["label"], note["agent"], note["episode"], note["why"], note["by"]
    assert found == ("control", "runner_1", 1, "waits", "author")


def test_open_run_is_recovered(tmp_path: Path) -> None:
    """A run that was killed then is finalized now, and replays."""
    run = copied("open", tmp_path)
    recovered = recover(run)
    assert recovered.manifest["status"] == "recovered"
    assert recovered.episode_table["end"].to_pylist() == ["ended", "torn"]
    assert recovered.episode_table["turns"].to_pylist() == [6, 3]
    assert recovered.fingerprint == OPEN
    assert verify(run).ok
    assert played_again(recovered).verified


@pytest.mark.parametrize("name", ["aec", "frames", "open"])
def test_report_is_written(name: str, tmp_path: Path) -> None:
    """A page of a run of that day is drawn."""
    gk.report(copied(name, tmp_path), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert ("relay_v1" if name == "aec" else "market_v1") in page


def test_sql_is_answered(capfd: pytest.CaptureFixture[str]) -> None:
    """The tables of `gamekeeper query` hold the returns of that day."""
    pytest.importorskip("duckdb")
    sql = "select agent, sum(return) as total from returns group by agent order by agent"
    code, found = document(capfd, "query", HERE / "aec", sql)
    totals = {row["agent"]: row["total"] for row in found["rows"]}
    assert (code, totals) == (0, {"runner_0": 12.25, "runner_1": 3.5, "runner_2": 14.25})


def test_same_evidence_has_no_divergence() -> None:
    """Runs of that day are compared, those of one level."""
    assert gk.diff(HERE / "parallel", HERE / "parallel") is None
    with pytest.raises(EvidenceError, match="different levels"):
        gk.diff(HERE / "parallel", HERE / "digest")


def test_newer_format_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What a newer gamekeeper wrote is not guessed at: the error says what to do, the code is 2."""
    run = copied("parallel", tmp_path)
    finalize_again(run, format_version=2)
    for look in (gk.load, verify, recover):
        with pytest.raises(RunError, match="newer format") as caught:
            look(run)
        assert caught.value.fix == "upgrade: pip install --upgrade gamekeeper"
    assert said(capfd, "verify", run)[0] == 2


def test_additions_within_a_version_are_passed_over(tmp_path: Path) -> None:
    """Names in the manifest, columns and files that this reader doesn't know change nothing."""
    run = copied("parallel", tmp_path)
    steps = pq.read_table(run / "agent_steps.parquet")
    pq.write_table(
        steps.append_column("later", pa.array(range(steps.num_rows))), run / "agent_steps.parquet"
    )
    size, digest = digest_file(run / "agent_steps.parquet")
    checksums = load_manifest(run)["checksums"]
    checksums["files"]["agent_steps.parquet"] = {"size": size, "digest": digest}
    later = {"of": ["a", "newer", "writer"]}
    environment = {**load_manifest(run)["environment"], "later": later}
    finalize_again(run, later=later, environment=environment, checksums=checksums)
    (run / "notes.txt").write_text("somebody's own\n", encoding="utf-8")
    assert verify(run, fingerprint=MARKET).ok
    assert played_again(load(run)).verified
    assert gk.diff(run, HERE / "parallel") is None
