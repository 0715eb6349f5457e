"""All agents of a Parallel episode as one: arrays by agent, a tick a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gamekeeper.adapters.agent_rows import AgentRows, Values, nested
from gamekeeper.adapters.gymnasium import nothing
from gamekeeper.core.space import Codec
from gamekeeper.core.trace import Spaces
from gamekeeper.errors import EvidenceError


@dataclass(frozen=True, slots=True)
class Together:
    """One episode of all agents.

    Attributes:
        observations: by agent, n + 1 of each.
        actions: by agent, n of each.
        rewards: [n] the sum of all agents'.
        ends: [2, n] terminated and truncated.
        infos: by field and agent, n + 1 of each; `paid` is what the crossing that follows paid.
    """

    observations: Mapping[str, Any]
    actions: Mapping[str, Any]
    rewards: Any
    ends: Any
    infos: Mapping[str, Any]


def together_of(
    found: Mapping[str, AgentRows], known: Mapping[str, Spaces], names: list[str]
) -> Together | None:
    """The episode of all agents; None where nobody decided anything that is followed by a look.

    Raises:
        EvidenceError: something that an agent saw or did isn't of its space.
    """
    for rows in found.values():
        _check(rows)
    acted = [rows.turns[rows.decided].max() for rows in found.values() if rows.decided.any()]
    seen = [
        rows.turns[rows.observations.valid].max()
        for rows in found.values()
        if rows.observations.valid.any()
    ]
    if not acted or not seen:
        return None
    ticks = min(int(max(acted)) + 1, int(max(seen)))
    if ticks < 1:
        return None
    parts = {name: _Part(found.get(name), known[name], ticks) for name in names}
    ended = [part for part in parts.values() if part.is_there]
    is_terminated = any(part.fields["terminated"][ticks] for part in ended)
    ends = np.zeros((2, ticks), bool)
    ends[:, -1] = is_terminated, not is_terminated
    return Together(
        observations={name: part.observations for name, part in parts.items()},
        actions={name: part.actions for name, part in parts.items()},
        rewards=np.sum([part.fields["paid"][:ticks] for part in parts.values()], axis=0),
        ends=ends,
        infos=_by_field(parts),
    )


class _Part:
    """One agent's part, a place for each tick and one more."""

    def __init__(self, rows: AgentRows | None, known: Spaces, ticks: int) -> None:
        assert known.observation is not None  # the data set's space was made of them
        assert known.action is not None
        self.is_there = rows is not None
        count = ticks + 1
        self.fields: dict[str, Any] = {
            "live": np.zeros(count, bool), "given": np.zeros(count, bool),
            "order": np.full(count, -1, np.int16), "received": np.zeros(count),
            "terminated": np.zeros(count, bool), "truncated": np.zeros(count, bool),
            "paid": np.zeros(count), "was_paid": np.zeros(count, bool),
            "saw": np.zeros(count, bool), "info": [""] * count,
        }  # fmt: skip
        if rows is None:
            blank = np.zeros(0, np.intp)
            self.observations = _filled(known.observation, None, blank, blank, count)
            self.actions = _filled(known.action, None, blank, blank, ticks)
            return
        kept = np.flatnonzero(rows.turns < count)
        turns = rows.turns[kept]
        sees = kept[rows.observations.valid[kept]]
        acts = kept[rows.decided[kept] & (turns < ticks)]
        self.observations = _filled(
            known.observation, rows.observations, sees, rows.turns[sees], count
        )
        self.actions = _filled(known.action, rows.actions, acts, rows.turns[acts], ticks)
        self._fill(rows, kept, turns, acts)

    def _fill(self, rows: AgentRows, kept: Any, turns: Any, acts: Any) -> None:
        fields = self.fields
        for name in ("live", "received", "terminated", "truncated"):
            fields[name][turns] = rows.numbers(name)[0][kept]
        fields["given"][turns] = rows.numbers("terminated")[1][kept]
        fields["order"][rows.turns[acts]] = rows.numbers("order")[0][acts]
        fields["paid"][turns] = rows.numbers("reward")[0][kept]
        fields["was_paid"][turns] = rows.numbers("reward")[1][kept]
        fields["saw"][turns] = rows.observations.valid[kept]
        fields["paid"][-1] = fields["was_paid"][-1] = 0  # of a crossing that isn't in the data set
        texts, masks = rows.texts("info"), rows.masks()
        for row, turn in zip(kept.tolist(), turns.tolist(), strict=True):
            fields["info"][turn] = texts[row] or ""
        terms = {term: np.zeros(len(fields["paid"])) for term in rows.terms}
        for term, paid in terms.items():
            paid[turns] = rows.numbers(f"reward.{term}")[0][kept]
            paid[-1] = 0.0
        if terms:
            fields["terms"] = terms
        kinds = {(mask.dtype.str, mask.shape) for mask in masks if mask is not None}
        if len(kinds) == 1:
            dtype, shape = kinds.pop()
            fields["action_mask"] = np.zeros((len(fields["paid"]), *shape), dtype)
            for row, turn in zip(kept.tolist(), turns.tolist(), strict=True):
                if masks[row] is not None:
                    fields["action_mask"][turn] = masks[row]


def _by_field(parts: Mapping[str, _Part]) -> dict[str, Any]:
    names = dict.fromkeys(name for part in parts.values() for name in part.fields)
    return {
        name: {agent: part.fields[name] for agent, part in parts.items() if name in part.fields}
        for name in names
    }


def _filled(codec: Codec, values: Values | None, rows: Any, turns: Any, count: int) -> Any:
    """Values at their turns, zeros elsewhere, in the form of their space."""
    leaves: dict[str, Any] = {}
    blanks = codec.pack(nothing(codec.space)) or [0] * len(codec.leaves)
    for leaf, blank in zip(codec.leaves, blanks, strict=True):
        taken = None if values is None else values.leaves[leaf.path]
        if leaf.kind in ("text", "json"):
            texts = [""] * count
            for row, turn in zip(rows.tolist(), turns.tolist(), strict=True):
                texts[turn] = taken[row]  # type: ignore[index]  # rows come of values
            leaves[leaf.path] = texts
            continue
        whole = np.zeros((count, *leaf.shape), leaf.dtype)
        if leaf.kind == "int":
            whole[:] = blank
        if taken is not None:
            whole[turns] = taken[rows]
        leaves[leaf.path] = whole
    return nested(codec.space, leaves, codec)


def _check(rows: AgentRows) -> None:
    for row, text in enumerate(rows.texts("odd")):
        strange = {} if text is None else rows.odd(row)
        bad = next(
            (name for name in ("obs", "action", "reward") if "value" in strange.get(name, {})), None
        )
        if bad is not None:
            raise EvidenceError(
                f"something of {rows.agent!r} isn't of its space",
                where=f"episode {rows.episode}, turn {rows.turns[row]}, {bad}",
                seen=str(strange[bad])[:200],
                mend="`--to numpy` keeps it as it was; `gamekeeper audit` says what is wrong",
            )
