"""Memory that evidence takes: episodes with images are fewer and shorter than others."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.probe_session import LEAST_TURNS, ProbeSession
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeRun
from gamekeeper.episodes.episode import Episode

EVIDENCE_BYTES: Final = 2 << 30
"""Bytes that the episodes of all probes may hold; reading them takes as much once more."""


def most_turns(session: ProbeSession, size_bytes: int, least: int = LEAST_TURNS) -> int:
    """The turns whose observations and states take so many bytes; `least` at least."""
    sizes = [space_bytes(spec.observation_space) for spec in session.agents.values()]
    each = max(sizes, default=0) if session.api == "aec" else sum(sizes)
    each += space_bytes(getattr(session.opened.env, "state_space", None))
    return max(size_bytes // max(each, 1), least)


def space_bytes(space: Any) -> int:
    """Bytes of a value of a space, as far as it is made of arrays."""
    parts = getattr(space, "spaces", None)
    if isinstance(parts, Mapping):
        parts = parts.values()
    if isinstance(parts, Iterable):
        return sum(map(space_bytes, parts))
    shape, dtype = getattr(space, "shape", None), getattr(space, "dtype", None)
    if not isinstance(shape, tuple) or not isinstance(dtype, np.dtype):
        return 0
    return int(np.prod(shape)) * dtype.itemsize


def held_bytes(look: ProbeRun) -> int:
    """Bytes that the episodes of a run hold, those that share their rows counted once."""
    tables = {
        id(table): table for episode in _episodes(look) for table in (episode.steps, episode.states)
    }
    return sum(table.nbytes for table in tables.values() if table is not None)


def slimmed(counterfactual: ProbeCounterfactual) -> ProbeCounterfactual:
    """The same counterfactual; a rerun that went as its base did shares the base's rows."""
    if counterfactual.volatile:  # these may differ where nothing else does
        return counterfactual
    base = counterfactual.base
    unchanged_rerun, episode = counterfactual.unchanged_rerun, counterfactual.episode
    if counterfactual.noise is None:
        unchanged_rerun = _sharing(base, unchanged_rerun)
    if counterfactual.divergence is None:
        episode = _sharing(base, episode)
    return replace(counterfactual, unchanged_rerun=unchanged_rerun, episode=episode)


def _sharing(base: Episode, same: Episode) -> Episode:
    if same.steps.num_rows != base.steps.num_rows or (same.states is None) != (base.states is None):
        return same
    return replace(same, steps=base.steps, states=base.states, _cache=base._cache)


def _episodes(look: ProbeRun) -> Iterator[Episode]:
    yield from look.episodes
    for counterfactual in look.counterfactuals:
        yield from (counterfactual.base, counterfactual.unchanged_rerun, counterfactual.episode)
