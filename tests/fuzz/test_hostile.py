"""Evidence by somebody who makes its hashes too: refused where it isn't what a recorder writes."""

import ast
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from benchmarks.fuzzing.run_folders import finalize_again as finalize_again_file
from gamekeeper.cli._options import json_object
from gamekeeper.diagnosis import counterfactuals
from gamekeeper.diagnosis.labels import labels
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError, SpecError
from gamekeeper.evaluation.evaluator import load_evaluation
from gamekeeper.evaluation.spec_reader import read_file
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs.files.folder import MANIFEST
from gamekeeper.runs.files.notes import annotate
from gamekeeper.runs.parts.receipts import receipt_of
from gamekeeper.viewing.sql.evidence_places import places_of
from tests.runs.finalize_again import finalize_again

DEEP = "[" * 100_000


@pytest.fixture
def line(tmp_path: Path) -> Path:
    """A small finalized run."""
    gk.rollout("two_robot_line", episodes=1, seed=0, out=tmp_path / "run", most_turns=3)
    return tmp_path / "run"


def change_manifest(run: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Changes a manifest, and makes its checksums fit."""
    path = run / MANIFEST
    manifest = json.loads(path.read_text())
    change(manifest)
    path.write_text(json.dumps(manifest))
    finalize_again(run)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("agents", [["picker"]]),
        ("agents", 5),
        ("contract", "x"),
        ("environment", []),
        ("spaces", {"picker": 3}),
        ("spaces", {"picker": {"action": "x"}}),
        ("seed", "1"),
        ("seed", 10**60),
        ("state_space", 1),
        ("terms", [1]),
        ("fingerprint", []),
        ("level", 2),
    ],
)
def test_manifest_of_another_shape_is_refused_by_field(
    line: Path, field: str, value: object
) -> None:
    """The error names the field."""
    change_manifest(line, lambda manifest: manifest.update({field: value}))
    with pytest.raises(RunError) as caught:
        gk.load(line)
    assert field in caught.value.what


def test_query_looks_at_manifests_too(line: Path) -> None:
    """It reads them by itself, without the tables."""
    change_manifest(line, lambda manifest: manifest.update(agents=5))
    with pytest.raises(RunError, match="agents"):
        places_of([line])


@pytest.mark.parametrize("change", [{"agent": ["x"]}, {"episode": "x"}, {"turn": {}}])
def test_label_of_another_shape_is_refused(line: Path, change: dict[str, Any]) -> None:
    """Annotations are JSON that anybody may have written."""
    annotate(line, {"kind": "label", "label": "planning", **change})
    with pytest.raises(EvidenceError, match=next(iter(change))):
        labels(line)


@pytest.mark.parametrize("name", ["kwargs", "versions", "imported", "entry_point", "name", "api"])
def test_environment_of_another_shape_is_refused_by_field(line: Path, name: str) -> None:
    """What is printed, compared and opened later is of its type from the start."""
    change_manifest(line, lambda manifest: manifest["environment"].update({name: [1]}))
    with pytest.raises(RunError) as caught:
        gk.load(line)
    assert f"environment.{name}" in caught.value.what


@pytest.mark.parametrize("text", [DEEP, "{", '{"action_mask": 3}'])
def test_cell_of_another_shape_is_one_documented_error(line: Path, text: str) -> None:
    """What a cell says is bounded and looked at when somebody reads it."""
    steps = pq.read_table(line / "agent_steps.parquet")
    masks = pa.array([b"\1\2\3"] * steps.num_rows, pa.binary())
    for name, column in (("info", pa.array([text] * steps.num_rows)), ("action_mask", masks)):
        place = steps.schema.get_field_index(name)
        steps = steps.set_column(place, steps.schema.field(place), column)
    pq.write_table(steps, line / "agent_steps.parquet")
    finalize_again_file(line, "agent_steps.parquet")
    evidence = gk.load(line)
    with pytest.raises(EvidenceError):
        [turn.infos for episode in evidence.episodes for turn in episode.turns]


@pytest.mark.parametrize(
    "change",
    [
        {"folder": 5},
        {"folder": "parts/k.a/../../../x"},
        {"schemas": 3},
        {"first": "x"},
        {"schemas": {"agent_steps": "QUJD"}},
        {"schemas": {"agent_steps": [1]}},
        {"error": 3},
    ],
)
def test_receipt_of_another_shape_is_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    """Nor does the folder that it names lead out of storage."""
    said = {
        "key": "k",
        "folder": "parts/k.a",
        "first": 0,
        "episodes": 1,
        "turns": 1,
        "error": None,
        "schemas": {},
    }
    storage = Storage.at(tmp_path)
    storage.put("parts/k.json", json.dumps(said | change).encode())
    with pytest.raises(RunError):
        look(storage)


def look(storage: Storage) -> None:
    """Everything that a merge takes from a receipt."""
    receipt = receipt_of(storage, "k")
    assert receipt is not None
    receipt.schema("agent_steps")
    storage.path_of(receipt.folder)


def test_storage_reads_no_more_than_it_was_told(tmp_path: Path) -> None:
    """A receipt of any length would be in memory before anybody looks at it."""
    storage = Storage.at(tmp_path)
    storage.put("x", b"123456")
    assert storage.get("x", most_bytes=6) == b"123456"
    with pytest.raises(RunError, match="larger than"):
        storage.get("x", most_bytes=5)


@pytest.mark.parametrize("text", [DEEP, "[]", "3", "{", '{"kind": "evaluation"}', "\x80"])
def test_document_that_is_no_evaluation_is_refused(tmp_path: Path, text: str) -> None:
    """Whatever it is instead."""
    (tmp_path / "evaluation.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(EvidenceError):
        load_evaluation(tmp_path)


def test_deep_options_are_wrong_use() -> None:
    """No fault of ours is told to whoever types brackets."""
    with pytest.raises(GamekeeperError, match="--kwargs"):
        json_object(DEEP, option="--kwargs")


@pytest.mark.parametrize("text", [f"name = {DEEP}", f"name = {'9' * 5000}"])
def test_deep_specification_is_refused(tmp_path: Path, text: str) -> None:
    """As any other that is nested deeply."""
    (tmp_path / "spec.toml").write_text(text)
    with pytest.raises(SpecError):
        read_file(tmp_path / "spec.toml")


def test_saved_case_holds_no_code_of_the_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Words of a diagnosed run end no docstring: the case is a file that somebody runs."""
    evil = '"""\nimport os; os.abort()\n"""\\'
    found = SimpleNamespace(labels=("planning",), why=evil, substitutes=(1,), tested=(), scope=evil)
    runs = {"a": "x", evil: "y"}
    diagnosis = SimpleNamespace(
        runs=runs, team=found, agents={}, answers=(found,), fingerprint=evil
    )
    evidence = SimpleNamespace(
        episode_table=SimpleNamespace(num_rows=2), manifest={"seed": 1}, contract=None
    )
    monkeypatch.setattr(counterfactuals, "load", lambda folder: evidence)
    monkeypatch.setattr(counterfactuals, "_arguments", lambda each: {"spec": evil})
    monkeypatch.setattr(counterfactuals, "_failing", lambda *rest: 2)
    tree = ast.parse(counterfactuals.case_text(diagnosis, "run", failed=evil))  # type: ignore[arg-type]  # stands for a diagnosis
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import)]
    assert [name.name for node in imported for name in node.names] == ["pytest", "gamekeeper"]
    assert "os.abort" in (ast.get_docstring(tree) or "")
