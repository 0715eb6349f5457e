"""Policies that a run names, as choices and as options of a command line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.interface.policy import EVERYONE, SAME


def policies_of(evidence: Evidence) -> dict[tuple[str, str | None], list[str]]:
    """Agents' names by the name and version of their policy; empty if no policies are named."""
    found: dict[tuple[str, str | None], dict[str, None]] = {}
    for text in evidence.episode_table["policies"].unique().to_pylist():
        for agent, entry in _named(text).items():
            version = entry.get("version")
            key = str(entry["policy"]), None if version is None else str(version)
            found.setdefault(key, {})[agent] = None
    return {key: list(agents) for key, agents in found.items()}


def _named(text: str | None) -> dict[str, Mapping[str, Any]]:
    """The entries of an episode's policies by agent; empty for a text that no recorder wrote."""
    with suppress(ValueError, AttributeError):
        entries = {str(agent): entry for agent, entry in json.loads(text or "{}").items()}
        if all(isinstance(entry, dict) and "policy" in entry for entry in entries.values()):
            return entries
    return {}


def choices_in(text: str | None) -> dict[str, str]:
    """Returns the choices that give agents the policies that an episode names.

    They are keyed as they were chosen, and agents that shared an object share one again; empty
    where the episode names none.
    """
    choices: dict[str, str] = {}
    for agent, entry in _named(text).items():
        place = str(entry.get("chosen_for", agent))
        owner = str(entry.get("object", place))
        choices[owner] = str(entry["policy"])
        if place != owner:
            choices[place] = f"{SAME}{owner}"
    return choices


def choices_of(evidence: Evidence) -> dict[str, str]:
    """Returns the choices of policies of all episodes; of one place the last."""
    found: dict[str, str] = {}
    for text in evidence.episode_table["policies"].unique().to_pylist():
        found |= choices_in(text)
    return found


def policy_words(evidence: Evidence) -> list[str]:
    """Returns the options of a command line that choose the recorded policies again."""
    return [
        word
        for place, name in choices_of(evidence).items()
        for word in ("--policy", name if place == EVERYONE else f"{place}={name}")
    ]
