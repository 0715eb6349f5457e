"""An episode packed as the JSON that the player on a page reads."""

import json
import zlib
from base64 import b64encode
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.divergence import turn_checksums
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.known_extent import env_steps
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.reporting.page.packed_values import PackedValues, fields_of_text, row_columns
from gamekeeper.reporting.page.scene_drawing import scene_of

APART: Final = 3
"""Most agents with equal endings at one turn that have a mark each; more share one."""
TORN: Final = "torn"
KILLED: Final = "the recorder was killed: later turns are lost"
LEVEL: Final = 6
"""Level of deflate; 9 takes twice as long for two per cent."""

Drawing: TypeAlias = tuple[Mapping[str, Any] | None, str]
"""Drawing of the player, and its source, or the reason why there is none."""
Draw: TypeAlias = Callable[[Sequence[Any]], Drawing]
"""Makes the drawing from the info of every row as plain JSON."""


@dataclass(frozen=True, slots=True)
class PackedAgent:
    """An agent as a packed episode names it.

    Attributes:
        role: declared, else its name without the number.
        noop: the declared noop; None where there is none.
        actions: names of its actions, by number; empty where none are declared.
    """

    name: str
    role: str
    noop: Any = None
    actions: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Mark:
    """A place in an episode that a reader may jump to.

    Attributes:
        kind: `since` (the first difference that the answers name), `divergence`, `failure`,
            `pivot`, `label`, `error`, `ending` or `change`.
        agent: agent that it belongs to; None: all.
    """

    turn: int
    kind: str
    text: str
    agent: str | None = None


def packed_agents(evidence: Evidence) -> tuple[PackedAgent, ...]:
    """Every agent of a run, in the order of `possible_agents`."""
    contract, scene = evidence.contract, scene_of(evidence)
    found = []
    for name in map(str, evidence.manifest.get("agents") or ()):
        role = contract.role_of(name) or role_in_name(name)
        found.append(PackedAgent(name, role, contract.noop_of(name), scene.actions_of(role)))
    return tuple(found)


def packed_episode(
    episode: Episode,
    roster: Sequence[PackedAgent],
    *,
    run: str = "a",
    api: str = "parallel",
    marks: Iterable[Mark] = (),
    volatile: Collection[str] = (),
    drawing: Drawing | Draw = (None, ""),
) -> dict[str, Any]:
    """One episode as the player reads it, in plain JSON.

    Args:
        roster: of its run; only those that have a row stand in the result.
        run: the letter of the run on the page.
        api: `aec` or `parallel`.
        marks: beside those of endings and errors, which are found here.
        volatile: info fields that aren't compared.
        drawing: drawing of the player, or the function that makes it of the rows' infos.
    """
    present = set(pc.unique(episode.steps["agent"]).to_pylist())
    members = [member for member in roster if member.name in present]
    members += [
        PackedAgent(name, role_in_name(name)) for name in sorted(present - {s.name for s in roster})
    ]
    values = PackedValues()
    rows = row_columns(episode.steps, [member.name for member in members], values)
    endings = endings_of(episode)
    if callable(drawing):
        drawing = drawing([None if p is None else values.items[p] for p in rows["info"]])
    change = episode.change
    return {
        "run": run,
        "episode": episode.episode,
        "seed": episode.seed,
        "api": api,
        "turns": env_steps(episode),
        "end": episode.header.get("end") or "open",
        "error": episode.header.get("error"),
        "base": None if episode.base is None else {"run": episode.base, "episode": episode.episode},
        "change": None if change is None else json.dumps(dict(change), default=str),
        "agents": [asdict(member) for member in members],
        "rows": rows,
        "values": values.items,
        "checksums": in_base64(
            np.array(turn_checksums(episode, volatile=volatile), "<u4").tobytes()
        ),
        "endings": endings,
        "marks": [asdict(mark) for mark in _in_order(episode, endings, marks)],
        "drawing": drawing[0],
        "drawing_note": drawing[1],
        "numbers": _sums(episode.steps),
    }


def deflated(packed: Mapping[str, Any]) -> bytes:
    """A packed episode as JSON, deflated without a header; a page holds it in base64."""
    text = json.dumps(packed, allow_nan=False, separators=(",", ":"), default=str)
    encoder = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return encoder.compress(text.encode()) + encoder.flush()


def in_base64(data: bytes) -> str:
    """Encodes bytes for a page."""
    return b64encode(data).decode("ascii")


def endings_of(episode: Episode) -> dict[str, dict[str, Any]]:
    """By agent, the first turn at which it was terminated or truncated, and the rules' reason."""
    steps = episode.steps
    flags = {
        name: pc.fill_null(steps[name], False).to_numpy() for name in ("terminated", "truncated")
    }
    rows = np.flatnonzero(flags["terminated"] | flags["truncated"])
    reasons = fields_of_text(episode.header.get("endings"))
    found: dict[str, dict[str, Any]] = {}
    for row in rows.tolist():
        agent = steps["agent"][row].as_py()
        if agent not in found:
            reason = reasons.get(agent)
            found[agent] = {
                "turn": steps["turn"][row].as_py(),
                "how": "terminated" if flags["terminated"][row] else "truncated",
                "reason": None if reason is None else str(reason),
            }
    return found


def _in_order(
    episode: Episode, endings: Mapping[str, Mapping[str, Any]], marks: Iterable[Mark]
) -> list[Mark]:
    found = [*marks, *_ending_marks(endings)]
    if episode.header.get("error"):
        found.append(Mark(_stopped_at(episode), "error", str(episode.header["error"])))
    elif episode.header.get("end") == TORN:
        found.append(Mark(_stopped_at(episode), "error", KILLED))
    return sorted(found, key=lambda mark: (mark.turn, mark.kind, mark.agent or ""))


def _stopped_at(episode: Episode) -> int:
    """The turn whose step raised, otherwise the last turn that has a row."""
    turns = episode.steps["turn"]
    raised = turns.filter(pc.is_valid(episode.steps["raised"]))
    return int(pc.max(raised if len(raised) else turns).as_py() or 0)


def _ending_marks(endings: Mapping[str, Mapping[str, Any]]) -> list[Mark]:
    """A mark for each agent, or one for many with equal endings at the same turn."""
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
    """By agent, its return and number of actions, without the None steps of ended agents."""
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
