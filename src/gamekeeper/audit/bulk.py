"""How much memory evidence takes: plays with images are fewer and shorter than others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.audit.lab import LEAST_TURNS, Lab
from gamekeeper.core.gathered import Look, Twin
from gamekeeper.core.trace import Trace

EVIDENCE_BYTES: Final = 2 << 30
"""What the traces of all probes may hold together; reading them takes as much once more."""


def most_turns(lab: Lab, size_bytes: int) -> int:
    """The turns whose observations and states take so many bytes; a play's least at least."""
    sizes = [space_bytes(spec.observation_space) for spec in lab.agents.values()]
    each = max(sizes, default=0) if lab.api == "aec" else sum(sizes)
    each += space_bytes(getattr(lab.opened.env, "state_space", None))
    return max(size_bytes // max(each, 1), LEAST_TURNS)


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


def held_bytes(look: Look) -> int:
    """What the traces of a look hold, those that share their rows counted once."""
    tables = {id(table): table for trace in _traces(look) for table in (trace.steps, trace.states)}
    return sum(table.nbytes for table in tables.values() if table is not None)


def slimmed(twin: Twin) -> Twin:
    """The same twin, a sham or changed play that went as its base did sharing the base's rows."""
    if twin.volatile:  # these may differ where nothing else does
        return twin
    sham = _sharing(twin.base, twin.sham) if twin.noise is None else twin.sham
    trace = _sharing(twin.base, twin.trace) if twin.divergence is None else twin.trace
    return replace(twin, sham=sham, trace=trace)


def _sharing(base: Trace, same: Trace) -> Trace:
    if same.steps.num_rows != base.steps.num_rows or (same.states is None) != (base.states is None):
        return same
    return replace(same, steps=base.steps, states=base.states, _cache=base._cache)


def _traces(look: Look) -> Iterator[Trace]:
    yield from look.traces
    for twin in look.twins:
        yield from (twin.base, twin.sham, twin.trace)
