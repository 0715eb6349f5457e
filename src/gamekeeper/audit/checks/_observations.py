"""What agents were given to see, row by row, beside the space that says what it may be. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from gamekeeper.audit.check import Occasion
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import BOUNDS, DTYPE, NAN, Misfit, misfits, suspects
from gamekeeper.core.trace import MASK, Trace, Turn


@dataclass(slots=True)
class _Rows:
    """Observations of one agent in one trace."""

    turns: list[Turn] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)


def spaces_of(evidence: Gathered, which: str) -> dict[str, Any]:
    """The space of each agent, `observation` or `action`; also those known only after a reset."""
    found = {
        name: getattr(spec, f"{which}_space")
        for name, spec in evidence.agents.items()
        if getattr(spec, f"{which}_space") is not None
    }
    for fact in evidence.facts("spaces", "space"):
        if fact.value["which"] == which and fact.value["space"] is not None:
            found.setdefault(str(fact.where.agent), fact.value["space"])
    return found


def judged(evidence: Gathered, kind: str) -> Iterator[Occasion]:
    """An occasion for every observation that was given: whether it misses its space in `kind`."""
    known = spaces_of(evidence, "observation")
    for trace in (*evidence["rollout"], *evidence["spaces"]):
        exact, odd = _rows(trace, known)
        for agent, rows in exact.items():
            is_open = kind in (BOUNDS, NAN) and rows.values
            bad = suspects(known[agent], rows.values, kind) if is_open else frozenset()
            for at, turn in enumerate(rows.turns):
                if at in bad:
                    yield _looked(evidence, trace, turn, agent, known[agent], rows.values[at], kind)
                else:
                    yield Occasion(trace.at(turn, agent, "observations"), True)
        for agent, rows in odd.items():
            is_told = kind != DTYPE or _is_told(agent, known[agent], rows)
            for turn, value in zip(rows.turns, rows.values, strict=True):
                with_masks = agent in turn.ended and not is_told
                yield _looked(evidence, trace, turn, agent, known[agent], value, kind, with_masks)


def _rows(trace: Trace, known: Mapping[str, Any]) -> tuple[dict[str, _Rows], dict[str, _Rows]]:
    """Rows whose structure, dtypes and shapes are those of the space, and the others."""
    exact: dict[str, _Rows] = {}
    odd: dict[str, _Rows] = {}
    for turn in trace.turns:
        strange = turn.odd
        for agent, value in turn.observations.items():
            if agent in known:
                is_odd = "obs" in strange.get(agent, ())
                rows = (odd if is_odd else exact).setdefault(agent, _Rows())
                rows.turns.append(turn)
                rows.values.append(value)
    return exact, odd


def _looked(
    evidence: Gathered,
    trace: Trace,
    turn: Turn,
    agent: str,
    space: Any,
    value: Any,
    kind: str,
    with_masks: bool = False,
) -> Occasion:
    found = next(
        (each for each in misfits(space, value) if _is_meant(each, kind, with_masks)), None
    )
    if found is None:
        return Occasion(trace.at(turn, agent, "observations"), True)
    where = trace.at(turn, agent, f"observations{found.path}")
    return Occasion(
        where, False, found.expected, found.seen, proof=proof(evidence.api, agent, found)
    )


def _is_meant(found: Misfit, kind: str, with_masks: bool) -> bool:
    return found.kind == kind and (with_masks or not is_of_mask(found.kind, found.path))


def _is_told(agent: str, space: Any, rows: _Rows) -> bool:
    """The checks of masks, which look at who may move, tell of this agent's masks anyway."""
    return any(
        is_of_mask(each.kind, each.path)
        for turn, value in zip(rows.turns, rows.values, strict=True)
        if agent not in turn.ended
        for each in misfits(space, value)
    )


def is_of_mask(kind: str, path: str) -> bool:
    """Whether a misfit is only the dtype of an action mask."""
    return kind == DTYPE and path.endswith(f"[{MASK!r}]")


def proof(api: str, agent: str, found: Misfit) -> str:
    """Lines that raise as long as what the agent is given misses its space."""
    if api == "parallel":
        chosen = [
            f"agent = next(a for a in observations if str(a) == {agent!r})",
            "value, space = observations[agent], env.observation_space(agent)",
        ]
    else:
        chosen = ["value, space = env.last()[0], env.observation_space(env.agent_selection)"]
    return "\n".join([*chosen, f"assert {found.test}, value"])
