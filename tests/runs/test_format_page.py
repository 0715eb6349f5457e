"""The page of run format 1 names every file, column and key that runs have."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from gamekeeper.interface.opening import open_env
from gamekeeper.runs.expanding import play_whole
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record
from gamekeeper.runs.run_check import recover
from tests.runs.plays import step_through, write_env

ROOT = Path(__file__).parents[2]
COMPAT = ROOT / "tests" / "compat" / "v1"
TYPES = {"int32", "int16", "int64", "string", "bool", "double", "binary"}
PAGE = (ROOT / "docs" / "format.md").read_text(encoding="utf-8")
WORDS = set(re.findall(r"`([^`\n]+)`", PAGE))
"""All that stands as code on the page."""


def dropping(folder: Path) -> Any:
    """An environment whose run drops episodes: unseeded resets, and an attribute that was set."""
    path = write_env(folder)
    env = record(open_env(f"{path}:Walk").env, folder / "run", level="actions", keep="last 2")
    env.turns = 4
    for seed in (1, None, None, None):
        step_through(env, seed=seed)
    return env


def small(folder: Path) -> Path:
    """The run of `dropping`, finalized."""
    dropping(folder).close()
    return folder / "run"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Finalized runs of every level and status, an expansion and a recovered one."""
    folder = tmp_path_factory.mktemp("runs")
    found = [path for path in COMPAT.iterdir() if (path / "episodes.parquet").is_file()]
    run = small(folder)
    name = f"{folder / 'walks.py'}:Walk"
    play_whole(load(run), str(folder / "whole"), env=name, report=lambda **_: None)
    shutil.copytree(COMPAT / "open", folder / "recovered")
    recover(folder / "recovered")
    return [*found, run, folder / "whole", folder / "recovered"]


def named(column: str) -> str:
    """A column as it stands on the page."""
    kind, point, _ = column.partition("@")[0].rstrip("'").partition(".")
    return f"{kind}.{'TERM' if kind == 'reward' else 'PATH'}" if point else kind


def test_every_column_stands_on_the_page_with_its_type(runs: list[Path]) -> None:
    """Of fixed columns the type stands beside the name; the others follow their leaf."""
    rows = {
        name: line.split("|")[2]
        for line in PAGE.splitlines()
        if line.startswith("| `") and line.count("|") >= 4
        for name in re.findall(r"`([^`]+)`", line.split("|")[1])
    }
    looked_at = 0
    for path in (each for run in runs for each in run.glob("*.parquet")):
        for field in pq.read_schema(path):
            assert named(field.name) in WORDS, (path, field.name)
            kind = str(field.type).replace("double", "float64")
            if path.stem in ("episodes", "agent_steps") and not (field.metadata or {}).get(b"leaf"):
                assert kind in rows[named(field.name)], (path, field)
                looked_at += 1
    assert looked_at > 100


def test_every_file_and_key_stands_on_the_page(runs: list[Path]) -> None:
    """Keys of manifests and of what lies in them, but for names of agents, packages and spaces."""
    keys: set[str] = set()
    for run in runs:
        manifest = json.loads((run / "manifest.json").read_bytes())
        keys |= manifest.keys() | manifest["environment"].keys()
        inner = [manifest.get(key) or {} for key in ("checked", "expanded", "keep", "checksums")]
        keys |= {key for each in inner for key in each}
        keys |= {key for each in manifest.get("cuts", ()) for key in each}
        keys |= {key for space in manifest["spaces"].values() for key in space}
        assert {path.name for path in run.iterdir()} <= {*WORDS, "frames"}
        keys |= of_keep(manifest.get("keep"))
    assert {"keep", "expanded", "checked"} <= keys
    assert keys - WORDS == set()


def of_keep(keep: Any) -> set[str]:
    """Keys within the entry of a run that drops episodes."""
    if keep is None:
        return set()
    dropped = keep["dropped"]
    agents = [key for each in dropped["agents"].values() for key in each]
    return {*dropped, *keep["marked"], *dropped["lengths"], *agents}


def test_every_key_of_an_open_run_and_of_openings_stands_on_the_page(tmp_path: Path) -> None:
    """A run that drops episodes says where its streams begin; openings say what states are."""
    env = dropping(tmp_path)
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_bytes())
    env.close()
    header = list(load(small_closed(tmp_path)).headers)[-1]
    opening = json.loads(header["opening"])

    keys = {*manifest, *opening, *opening["generators"], *opening["generators"]["own"][0]}
    assert {"segments", "keep", "generators", "attributes"} <= keys
    assert keys - WORDS == set()


def small_closed(folder: Path) -> Path:
    """As `small`, in a folder of its own."""
    (folder / "closed").mkdir()
    return small(folder / "closed")
