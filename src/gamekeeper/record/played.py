"""Who played a run, and the command that plays the same anew."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from gamekeeper.core.evidence import Evidence

Played: TypeAlias = "Mapping[tuple[str, str | None], Sequence[str]]"
"""Agents' names by the name and version of their policy."""


def policies_of(evidence: Evidence) -> dict[tuple[str, str | None], list[str]]:
    """Who was played by which policy and version: agents' names by both; empty if not named."""
    found: dict[tuple[str, str | None], dict[str, None]] = {}
    for text in evidence.episodes["policies"].unique().to_pylist():
        try:
            named = json.loads(text or "{}")
            rows = [(a, (str(e["policy"]), _text(e.get("version")))) for a, e in named.items()]
        except (ValueError, TypeError, KeyError, AttributeError):  # nothing that a recorder wrote
            continue
        for agent, key in rows:
            found.setdefault(key, {})[str(agent)] = None
    return {key: list(agents) for key, agents in found.items()}


def record_command(
    evidence: Evidence,
    played: Played,
    environment: str,
    kwargs: str | None,
) -> str:
    """What records the same anew, as far as the run says how it was played."""
    manifest = evidence.manifest
    words = ["gamekeeper", "record", environment]
    words += kwargs_words(manifest.get("environment") or {}, kwargs)
    names = {name for name, _ in played}
    if len(names) == 1:
        words += ["--policy", next(iter(names))] if names != {"random"} else []
    else:
        words += [w for (name, _), agents in played.items() for agent in agents
                  for w in ("--policy", f"{agent}={name}")]  # fmt: skip
    words += ["--episodes", str(evidence.episodes.num_rows)]
    words += ["--seed", str(manifest["seed"])] if manifest.get("seed") is not None else []
    words += ["--level", "digest"] if manifest.get("level") == "digest" else []
    return shlex.join([*words, "--out", f"{evidence.path}-again"])


def kwargs_words(then: Mapping[str, Any], kwargs: str | None) -> list[str]:
    """The option for the environment's arguments: as they were typed, else as recorded.

    Args:
        then: the recorded identity.
        kwargs: as typed; None: not at all.
    """
    given = kwargs if kwargs is not None else json.dumps(then.get("kwargs") or {})
    return [] if given == "{}" else ["--kwargs", given]


def _text(version: object) -> str | None:
    return None if version is None else str(version)
