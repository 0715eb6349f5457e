"""Parsers that take one text or one document, without a run around it."""

import contextlib
import io
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gamekeeper as gk
from gamekeeper.cli._options import json_object
from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.diagnosis.labels import labels
from gamekeeper.episodes.spaces import space_from_json
from gamekeeper.errors import GamekeeperError
from gamekeeper.evaluation.evaluator import load_evaluation
from gamekeeper.evaluation.spec_reader import read_file, read_spec
from gamekeeper.interface.policy import parse_choices
from gamekeeper.reporting.evaluation_text import evaluation_text
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs.files.folder import MANIFEST
from gamekeeper.runs.files.manifest import parse_manifest
from gamekeeper.runs.parts.receipts import receipt_of
from gamekeeper.runs.untrusted.arrow_messages import batch_sizes, kind_and_body, metadata_size
from gamekeeper.runs.untrusted.parquet_footer import read_footer

Read = Callable[[bytes], Any]
TARGETS = (
    "contract",
    "contract-data",
    "spec",
    "spec-data",
    "condition",
    "options",
    "manifest",
    "space",
    "notes",
    "receipt",
    "evaluation",
    "footer",
)
PLAIN = ("contract-data", "spec-data", "manifest", "space", "notes", "receipt", "evaluation")
"""Those whose inputs are JSON, so that values are altered as well as bytes."""
PART = "00000000-00000002"


def inputs_of(target: str, run_files: Path, evaluated: Path) -> list[bytes]:
    """Real inputs of a parser.

    Args:
        run: a finalized one, with annotations.
        evaluated: the folder of an evaluation.
    """
    root = Path(gk.__file__).parent
    if target == "contract":
        return [path.read_bytes() for path in sorted((root / "tasks").rglob("*.toml"))]
    if target == "spec":
        return [path.read_bytes() for path in sorted((root / "evaluation").glob("suites/*.toml"))]
    if target == "contract-data":
        texts = [_text(data) for data in inputs_of("contract", run_files, evaluated)]
        return [json.dumps(Contract.parse(text).to_json()).encode() for text in texts]
    if target == "spec-data":
        specs = [tomllib.loads(_text(data)) for data in inputs_of("spec", run_files, evaluated)]
        return [json.dumps(spec).encode() for spec in specs]
    if target == "condition":
        return [
            b"return < 0.5",
            b"deliveries >= 3 and not is_over",
            b"picker.grasp == 'lost' or length > 20",
        ]
    if target == "options":
        return [
            b"random",
            b"picker=reference",
            b"a=module:callable",
            b'{"n": 3, "x": [1, {"y": null}]}',
        ]
    if target == "manifest":
        return [(run_files / MANIFEST).read_bytes()]
    if target == "space":
        spaces = json.loads((run_files / MANIFEST).read_bytes())["spaces"]
        return [json.dumps(space).encode() for space in spaces.values()] + [
            b'{"kind": "Dict", "spaces": {"a": {"kind": "Discrete", "n": 3, "start": 0}}}'
        ]
    if target == "notes":
        return [(run_files / "annotations.jsonl").read_bytes()]
    if target == "receipt":
        fields = {
            "key": PART,
            "folder": f"parts/{PART}.abc",
            "first": 0,
            "episodes": 2,
            "turns": 9,
            "error": None,
            "schemas": {"agent_steps": "QUJD"},
        }
        return [json.dumps(fields).encode()]
    if target == "evaluation":
        return [(evaluated / "evaluation.json").read_bytes()]
    if target == "footer":
        return [path.read_bytes()[-3000:] for path in sorted(run_files.glob("*.parquet"))]
    raise KeyError(target)


def reader(target: str, place: Path) -> Read:
    """What reads an input of a target; bytes that are no text are replaced.

    Args:
        place: a folder of its own, with `run_files` and `evaluated` in it.
    """
    run_files, evaluated = place / "run_files", place / "evaluated"
    readers: dict[str, Read] = {
        "contract": lambda data: Contract.parse(_text(data), source="fuzz.toml"),
        "spec": lambda data: read_file(_put(place / "spec.toml", data)),
        "contract-data": lambda data: Contract.from_json(_plain(data)),
        "spec-data": lambda data: read_spec(_plain(data), source="fuzz.toml"),
        "condition": lambda data: Failure(_text(data)).holds({"return": 0.0, "length": 3.0}),
        "options": _options,
        "manifest": lambda data: parse_manifest(data, place / MANIFEST),
        "space": lambda data: space_from_json(_plain(data)),
        "notes": lambda data: (_put(run_files / "annotations.jsonl", data), labels(run_files)),
        "receipt": lambda data: _receipt(place, data),
        "evaluation": lambda data: _evaluation(evaluated, data),
        "footer": _footer,
    }
    return readers[target]


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def _put(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def _options(data: bytes) -> None:
    with contextlib.suppress(GamekeeperError):
        parse_choices([_text(data)])
    json_object(_text(data), option="--kwargs")


def _plain(data: bytes) -> Any:
    """Plain data, as a caller hands it in."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise GamekeeperError("no JSON") from error


def _receipt(place: Path, data: bytes) -> None:
    _put(place / "storage" / "parts" / f"{PART}.json", data)
    storage = Storage.at(place / "storage")
    found = receipt_of(storage, PART)
    if found is not None:
        storage.path_of(found.folder)
        for stream in ("episodes", "agent_steps"):
            found.schema(stream)


def _evaluation(folder: Path, data: bytes) -> None:
    _put(folder / "evaluation.json", data)
    found = load_evaluation(folder)
    evaluation_text(found.to_json(), width=80)
    str(found)
    found._repr_html_()


def _footer(data: bytes) -> None:
    # Both are called within `reading`, which makes an error of the house of whatever they say;
    # here only what no such frame could catch counts: a loop, a crash, memory.
    with contextlib.suppress(ValueError, IndexError, KeyError, OverflowError, RecursionError):
        read_footer(io.BytesIO(data), len(data))
    with contextlib.suppress(Exception):
        metadata_size(data[:8])
        kind_and_body(data)
        batch_sizes(data, data)
    raise GamekeeperError("looked at")
