"""Packed episodes made by hand, and pages of them: what the browser's tests open."""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gamekeeper.reporting.page.packed_episode import deflated, in_base64
from gamekeeper.reporting.page.page_data import Page, PageBlock, PageSection, RunCard
from gamekeeper.reporting.page.page_html import render

Packed = dict[str, Any]


def roster(count: int, roles: Sequence[str] = ("picker", "carrier")) -> list[Packed]:
    """Agents by turns of each role, `picker_0`, `carrier_0`, `picker_1`, …, whose nothing is 0."""
    return [
        {"name": f"{role}_{i // len(roles)}", "role": role, "noop": 0}
        for i in range(count)
        for role in [roles[i % len(roles)]]
    ]


def parallel_episode(
    *, agents: int = 4, turns: int = 60, seed: int = 0, run: str = "a", episode: int = 0
) -> Packed:
    """An episode in which everybody acts at every tick, and is shown the end at a last one."""
    rng = np.random.Generator(np.random.PCG64(seed))
    rows = (turns + 1) * agents
    acts = np.repeat(np.arange(turns + 1) < turns, agents)
    action = rng.integers(0, 5, rows)
    reward = np.round(rng.normal(0, 1, rows) * (rng.random(rows) < 0.3), 3)
    cumulative_reward = np.concatenate([np.zeros(agents), reward[:-agents]])
    ended = ~acts
    return {
        **_header(run, episode, seed, "parallel", turns, roster(agents)),
        "rows": {
            "turn": np.repeat(np.arange(turns + 1), agents).tolist(),
            "agent": np.tile(np.arange(agents), turns + 1).tolist(),
            "order": _where(acts, np.tile(np.arange(agents), turns + 1)),
            "action": _where(acts, action),
            "cumulative_reward": cumulative_reward.tolist(),
            "reward": _where(acts, reward),
            "terms": {"delivery": _where(acts, np.maximum(reward, 0))},
            "terminated": ended.astype(int).tolist(),
            "truncated": [0] * rows,
            "mask": [5] * rows,
            "info": [6 if row % 7 == 0 else None for row in range(rows)],
        },
        "values": [0, 1, 2, 3, 4, [1, 1, 0, 1, 1], {"position": [1, 2]}],
        "endings": {
            member["name"]: {"turn": turns, "how": "terminated", "reason": "cleared"}
            for member in roster(agents)
        },
        "marks": [
            {"turn": turns // 3, "kind": "failure", "agent": "picker_0", "text": "dropped it"},
            {"turn": turns // 2, "kind": "label", "agent": None, "text": "perception"},
            {"turn": turns, "kind": "ending", "agent": None, "text": "all terminated: cleared"},
        ],
    }


def aec_episode(*, turns: int = 12, run: str = "b", episode: int = 0) -> Packed:
    """An episode of two who act by turns, drawn as cells."""
    names = roster(2, ("player",))
    return {
        **_header(run, episode, 5, "aec", turns, names),
        "rows": {
            "turn": list(range(turns)),
            "agent": [turn % 2 for turn in range(turns)],
            "order": [0] * turns,
            "action": [turn % 3 for turn in range(turns)],
            "cumulative_reward": [0] * turns,
            "reward": [0] * (turns - 1) + [1],
            "terms": {},
            "terminated": [0] * turns,
            "truncated": [0] * turns,
            "mask": [None] * turns,
            "info": [None] * turns,
        },
        "values": [0, 1, 2],
        "endings": {},
        "marks": [],
    }


def map_of(packed: Mapping[str, Any]) -> Packed:
    """A drawing in which each agent goes its way, a step a turn."""
    tracks = {
        member["name"]: [[turn, (turn * (i + 1)) % 10, (turn + i) % 8] for turn in range(20)]
        for i, member in enumerate(packed["agents"])
    }
    return {"kind": "map", "extent": [0, 10, 0, 8], "tracks": tracks}


def page_of(
    episodes: Iterable[Packed],
    *,
    charts: Sequence[Any] = (),
    is_view: bool = False,
    agents: tuple[tuple[str, str], ...] = (),
    **extra: Any,
) -> str:
    """A page with these episodes in it, and with charts; `agents`: names and roles of the runs."""
    every = [summed(packed) for packed in episodes]
    runs = tuple(
        RunCard(
            key, f"runs/{key}", "finalized", "parallel", "made by hand", len(every), "0", agents
        )
        for key in dict.fromkeys(packed["run"] for packed in every)
    )
    sections = (PageSection("player", "Player"),)
    if charts:
        sections += (PageSection("charts", "Charts", (PageBlock(charts=tuple(charts)),)),)
    page = Page("Episodes made by hand", "For the browser's tests.", runs, sections)
    entries = tuple(entry_of(packed) for packed in every)
    held = {} if is_view else {(p["run"], p["episode"]): deflated(p) for p in every}
    return render(replace(page, episodes=entries, packed=held, is_view=is_view, extra=extra))


def summed(packed: Packed) -> Packed:
    """The episode with a checksum of the rows of each turn."""
    rows = {**packed["rows"], **packed["rows"]["terms"]}
    columns = [values for name, values in rows.items() if name != "terms"]
    by_turn: dict[int, list[Any]] = {}
    for row in zip(*columns, strict=True):
        by_turn.setdefault(row[0], []).append(row)
    sums = [zlib.crc32(repr(by_turn.get(turn)).encode()) for turn in range(max(by_turn) + 1)]
    return {**packed, "checksums": in_base64(np.array(sums, "<u4").tobytes())}


def entry_of(packed: Mapping[str, Any]) -> Packed:
    """A packed episode as the page's list has it."""
    rewards = zip(packed["rows"]["agent"], packed["rows"]["reward"], strict=True)
    returns = dict.fromkeys((member["name"] for member in packed["agents"]), 0.0)
    for agent, reward in rewards:
        returns[packed["agents"][agent]["name"]] += reward or 0.0
    kept = {name: packed[name] for name in ("run", "episode", "seed", "turns", "end", "error")}
    more = {"packed": True, "why": ["first"], "failing": bool(packed["error"]), "labels": []}
    told = {"team": sum(returns.values()), "returns": returns, "spark": "ABZaz", "acts": "zA"}
    return {**kept, **more, **told, "base": packed["base"], "change": packed["change"]}


def _header(
    run: str, episode: int, seed: int, api: str, turns: int, agents: list[Packed]
) -> Packed:
    place = {"run": run, "episode": episode, "seed": seed, "api": api, "turns": turns}
    end = {"end": "ended", "error": None, "base": None, "change": None}
    return {**place, **end, "agents": agents, "drawing": None, "numbers": {}}


def _where(here: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> list[Any]:
    return [
        value if is_here else None for is_here, value in zip(here, values.tolist(), strict=True)
    ]
