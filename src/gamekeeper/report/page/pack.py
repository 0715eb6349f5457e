"""A trace as a packed episode: what the player on a page reads."""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.core.trace import Trace
from gamekeeper.report.page.columns import row_columns
from gamekeeper.report.page.plain import Values, plain_of_text

APART: Final = 3
"""As many agents that end alike at once have a mark each; more share one."""
LEVEL: Final = 6
"""Of deflate; 9 takes twice as long for two per cent."""

Drawing: TypeAlias = tuple[Mapping[str, Any] | None, str]
"""What the player draws, and where that comes from, or why there is nothing."""
Draw: TypeAlias = Callable[[Sequence[Any]], Drawing]
"""The drawing, from the info of every row as plain JSON."""


@dataclass(frozen=True, slots=True)
class Seat:
    """An agent as a packed episode names it.

    Attributes:
        name: the agent.
        role: declared, else its name without the number.
        noop: the action that does nothing; None where none is declared.
    """

    name: str
    role: str
    noop: Any = None


@dataclass(frozen=True, slots=True)
class Mark:
    """A place in an episode that a reader may jump to.

    Attributes:
        turn: where.
        kind: `divergence`, `failure`, `label`, `error`, `ending` or `change`.
        text: what is there.
        agent: whose; None: nobody's alone.
    """

    turn: int
    kind: str
    text: str
    agent: str | None = None


def seats_of(evidence: Evidence) -> tuple[Seat, ...]:
    """Every agent of a run, in the order in which it was seated."""
    contract = evidence.contract
    return tuple(
        Seat(name, contract.role_of(name) or role_in_name(name), contract.noop_of(name))
        for name in map(str, evidence.manifest.get("agents") or ())
    )


def packed_episode(
    trace: Trace,
    seats: Sequence[Seat],
    *,
    run: str = "a",
    api: str = "parallel",
    marks: Iterable[Mark] = (),
    drawing: Drawing | Draw = (None, ""),
) -> dict[str, Any]:
    """One episode as the player reads it, in plain JSON.

    Args:
        trace: the episode.
        seats: of its run; only those that have a row stand in the result.
        run: the letter of the run on the page.
        api: `aec` or `parallel`.
        marks: beside those of endings and errors, which are found here.
        drawing: what the player draws, or what makes it of the rows' infos.
    """
    present = set(pc.unique(trace.steps["agent"]).to_pylist())
    seated = [seat for seat in seats if seat.name in present]
    seated += [Seat(name, role_in_name(name)) for name in sorted(present - {s.name for s in seats})]
    values = Values()
    rows = row_columns(trace.steps, [seat.name for seat in seated], values)
    endings = endings_of(trace)
    if callable(drawing):
        drawing = drawing([None if p is None else values.items[p] for p in rows["info"]])
    change = trace.change
    return {
        "run": run,
        "episode": trace.episode,
        "seed": trace.seed,
        "api": api,
        "turns": turns_of(trace),
        "end": trace.header.get("end") or "open",
        "error": trace.header.get("error"),
        "base": _base(trace),
        "change": None if change is None else json.dumps(dict(change), default=str),
        "agents": [asdict(seat) for seat in seated],
        "rows": rows,
        "values": values.items,
        "endings": endings,
        "marks": [asdict(mark) for mark in _in_order(trace, endings, marks)],
        "drawing": drawing[0],
        "drawing_note": drawing[1],
        "numbers": _sums(trace.steps),
    }


def deflated(packed: Mapping[str, Any]) -> bytes:
    """A packed episode as JSON, deflated without a header: what a page holds in base64."""
    text = json.dumps(packed, allow_nan=False, separators=(",", ":"), default=str)
    press = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return press.compress(text.encode()) + press.flush()


def in_base64(data: bytes) -> str:
    """Bytes as a page holds them."""
    return b64encode(data).decode("ascii")


def turns_of(trace: Trace) -> int:
    """How many crossings there were; of an episode that never ended, as far as its rows tell."""
    told = trace.header.get("turns")
    if told is not None:
        return int(told)
    acted = trace.steps.filter(pc.is_valid(trace.steps["order"]))["turn"]
    return int(pc.max(acted).as_py()) + 1 if len(acted) else 0


def endings_of(trace: Trace) -> dict[str, dict[str, Any]]:
    """By agent, the turn at which it was first told that it ended, how, and the rules' reason."""
    steps = trace.steps
    flags = {
        name: pc.fill_null(steps[name], False).to_numpy() for name in ("terminated", "truncated")
    }
    rows = np.flatnonzero(flags["terminated"] | flags["truncated"])
    reasons = _reasons(trace)
    found: dict[str, dict[str, Any]] = {}
    for row in rows.tolist():
        agent = steps["agent"][row].as_py()
        if agent not in found:
            how = "terminated" if flags["terminated"][row] else "truncated"
            reason = reasons.get(agent)
            found[agent] = {
                "turn": steps["turn"][row].as_py(),
                "how": how,
                "reason": None if reason is None else str(reason),
            }
    return found


def _reasons(trace: Trace) -> Mapping[str, Any]:
    text = trace.header.get("endings")
    told = plain_of_text(text) if text else {}
    return told if isinstance(told, Mapping) else {}


def _base(trace: Trace) -> dict[str, Any] | None:
    return None if trace.base is None else {"run": trace.base, "episode": trace.episode}


def _in_order(
    trace: Trace, endings: Mapping[str, Mapping[str, Any]], marks: Iterable[Mark]
) -> list[Mark]:
    found = [*marks, *_ending_marks(endings)]
    if trace.header.get("error"):
        found.append(Mark(turns_of(trace), "error", str(trace.header["error"])))
    return sorted(found, key=lambda mark: (mark.turn, mark.kind, mark.agent or ""))


def _ending_marks(endings: Mapping[str, Mapping[str, Any]]) -> list[Mark]:
    """One for each agent, or one for many that end alike at once."""
    alike: dict[tuple[int, str, str], list[str]] = {}
    for agent, end in endings.items():
        alike.setdefault((end["turn"], end["how"], end["reason"] or ""), []).append(agent)
    marks = []
    for (turn, how, reason), agents in alike.items():
        text = f"{how}: {reason}" if reason and reason != how else how
        if len(agents) > APART:
            marks.append(Mark(turn, "ending", f"{len(agents)} agents {text}"))
        else:
            marks += [Mark(turn, "ending", text, agent) for agent in agents]
    return marks


def _sums(steps: pa.Table) -> dict[str, dict[str, float | None]]:
    """By agent, its return and how often it acted; the empty steps of the dead aren't acts."""
    ended = pc.or_(*(pc.fill_null(steps[name], False) for name in ("terminated", "truncated")))
    acted = pc.if_else(ended, pa.scalar(None, pa.int16()), steps["order"])
    steps = pa.table({"agent": steps["agent"], "reward": steps["reward"], "order": acted})
    table = steps.group_by("agent", use_threads=False)
    found = table.aggregate([("reward", "sum"), ("order", "count")]).to_pydict()
    return {
        agent: {"return": _finite(total or 0.0), "length": acted}
        for agent, total, acted in zip(
            found["agent"], found["reward_sum"], found["order_count"], strict=True
        )
    }


def _finite(value: float) -> float | None:
    return float(f"{value:.10g}") if np.isfinite(value) else None
