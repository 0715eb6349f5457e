"""What manifests and annotations tell, as small tables beside the streams."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final, TypeAlias

from gamekeeper.adapters.sql.places import Place
from gamekeeper.record.files.notes import NOTES

Row: TypeAlias = tuple[Any, ...]

TABLES: Final[Mapping[str, Mapping[str, str]]] = {
    "runs": {
        "run": "VARCHAR", "environment": "VARCHAR", "api": "VARCHAR", "status": "VARCHAR",
        "level": "VARCHAR", "seed": "BIGINT", "kwargs": "VARCHAR", "source_digest": "VARCHAR",
        "fingerprint": "VARCHAR",
    },
    "agents": {"run": "VARCHAR", "agent": "VARCHAR", "role": "VARCHAR"},
    "labels": {
        "run": "VARCHAR", "episode": "INTEGER", "turn": "INTEGER", "agent": "VARCHAR",
        "label": "VARCHAR", "why": "VARCHAR", "said_by": "VARCHAR", "said_at": "VARCHAR",
        "proposed": "BOOLEAN",
    },
}  # fmt: skip
"""Names of the tables, and their columns with DuckDB's types; no word of SQL among them."""


def rows_of(table: str, bundles: Iterable[Place]) -> Iterator[Row]:
    """The rows of one of these tables.

    Raises:
        BundleError: annotations are damaged.
    """
    return _ROWS[table](bundles)


def _runs(bundles: Iterable[Place]) -> Iterator[Row]:
    for place in bundles:
        manifest = place.manifest
        environment = _mapping(manifest.get("environment"))
        texts = [environment.get("name"), environment.get("api"), manifest.get("status"),
                 manifest.get("level")]  # fmt: skip
        seed = manifest.get("seed")
        yield (
            place.run, *map(_text, texts), seed if type(seed) is int else None,
            json.dumps(environment.get("kwargs") or {}),
            _text(environment.get("source_digest")), _text(manifest.get("fingerprint")),
        )  # fmt: skip


def _agents(bundles: Iterable[Place]) -> Iterator[Row]:
    """Each agent's role, as the contract that it was recorded under names it."""
    from gamekeeper.core.contract import Contract

    known: dict[str, Callable[[str], str | None]] = {}
    for place in bundles:
        declared = place.manifest.get("contract")
        text = json.dumps(declared)
        if text not in known:
            known[text] = Contract.from_json(declared).role_of if declared else _nobody
        for agent in place.manifest.get("agents") or ():
            yield place.run, str(agent), known[text](str(agent))


def _labels(bundles: Iterable[Place]) -> Iterator[Row]:
    for place in bundles:
        if not (place.folder / NOTES).exists():
            continue
        from gamekeeper.diagnose.labels import labels

        for each in labels(place.folder):
            yield (
                place.run, each.episode, each.turn, each.agent, each.label, each.why, each.by,
                each.at, each.proposed,
            )  # fmt: skip


def _nobody(agent: str) -> None:
    """No contract, so no role."""


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _text(value: object) -> str | None:
    return None if value is None else str(value)


_ROWS: Final[Mapping[str, Callable[[Iterable[Place]], Iterator[Row]]]] = {
    "runs": _runs, "agents": _agents, "labels": _labels,
}  # fmt: skip
