"""An agent's decisions one after another: n of them between n + 1 observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gamekeeper.adapters.agent_rows import AgentRows
from gamekeeper.core.where import Where
from gamekeeper.errors import EvidenceError


@dataclass(frozen=True, slots=True)
class Course:
    """What one agent decided in one episode.

    Attributes:
        rows: [n + 1] the row of each observation; the last is what followed the last decision.
        rewards: [n] all that it was paid from a decision to the next, or to the end.
        terms: the same by reward term.
        terminated: its last flags.
        truncated: its last flags.
        paid_before: what it was paid before its first decision, which no decision earned.
        left_out: what it was paid for a last decision that no observation follows; None where one
            does. That decision isn't in `rows`.
    """

    rows: Any
    rewards: Any
    terms: Mapping[str, Any]
    terminated: bool
    truncated: bool
    paid_before: float
    left_out: float | None


def course_of(rows: AgentRows) -> Course | None:
    """The decisions of an agent; None where it made none that an observation follows.

    Raises:
        EvidenceError: something that it saw, did or was paid isn't of its space.
    """
    decided = np.flatnonzero(rows.decided)
    if not len(decided):
        return None
    _check(rows, decided, "obs", rows.observations.valid)
    _check(rows, decided, "action", rows.actions.valid)
    _check(rows, decided, "reward", rows.numbers("reward")[1])
    paid = rows.numbers("reward")[0]
    terms = {term: _between(rows.numbers(f"reward.{term}")[0], decided) for term in rows.terms}
    rewards = _between(paid, decided)
    last = int(decided[-1])
    after = np.flatnonzero(rows.observations.valid[last + 1 :])
    flags = [bool(rows.numbers(name)[0][last + 1 :].any()) for name in ("terminated", "truncated")]
    left_out = None
    if len(after):
        path = np.append(decided, last + 1 + after[0])
    else:
        path, flags, left_out = decided, [False, False], float(rewards[-1])
        rewards = rewards[:-1]
        terms = {term: each[:-1] for term, each in terms.items()}
    return Course(
        rows=path, rewards=rewards, terms=terms, terminated=flags[0], truncated=flags[1],
        paid_before=float(paid[: decided[0]].sum()), left_out=left_out,
    )  # fmt: skip


def _between(paid: Any, decided: Any) -> Any:
    """[decisions] the sum of what was paid from each to the next."""
    return np.add.reduceat(paid, decided)


def _check(rows: AgentRows, decided: Any, field: str, valid: Any) -> None:
    bad = decided[~valid[decided]]
    if not len(bad):
        return
    row = int(bad[0])
    entry = rows.odd(row).get(field, {})
    raise EvidenceError(
        f"the {_WORDS[field]} of {rows.agent!r} isn't of its space" if entry
        else f"{rows.agent!r} decided without a recorded {_WORDS[field]}",
        where=str(Where("", rows.episode, int(rows.turns[row]), rows.agent, field)),
        seen=str(entry)[:200] if entry else "nothing",
        mend="`--to numpy` keeps it as it was; `gamekeeper audit` says what is wrong with it",
    )  # fmt: skip


_WORDS = {"obs": "observation", "action": "action", "reward": "reward"}
