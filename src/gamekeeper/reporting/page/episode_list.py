"""Entries of all episodes for the page's list, and single episodes packed with their marks."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.known_extent import env_steps
from gamekeeper.episodes.outcome import failed, failures, outcome_of
from gamekeeper.errors import ContractError, EvidenceError
from gamekeeper.reporting.page.episode_figures import (
    UNFINISHED,
    Figures,
    failing,
    figures_of,
    scope_text,
)
from gamekeeper.reporting.page.packed_episode import (
    Mark,
    PackedAgent,
    packed_agents,
    packed_episode,
)
from gamekeeper.reporting.page.pivots_section import pivot_marks, pivots_of, success_curve
from gamekeeper.reporting.page.player_drawing import DeclaredScene, Drawing, drawn
from gamekeeper.reporting.page.scene_drawing import scene_of

Label = Mapping[str, Any]

MOST_AGENTS: Final = 64
"""Most agents whose returns stand in the list; with more, only the sum."""


def entries_of(
    evidence: Evidence,
    *,
    run: str = "a",
    labels: Sequence[Label] = (),
    figures: Figures | None = None,
    failed: Sequence[bool | None] | None = None,
) -> list[dict[str, Any]]:
    """An entry for every episode, as the page's script lists them; none is packed yet.

    Args:
        evidence: of the run, which may still be recording.
        figures: of the run, where they are known already.
        failed: by episode, where it is known already.
    """
    figures = figures_of(evidence) if figures is None else figures
    failed = failing(evidence, figures)[0] if failed is None else failed
    has_few = len(figures.agents) <= MOST_AGENTS
    given: dict[Any, list[str]] = {}
    for each in labels:
        given.setdefault(each["episode"], []).append(str(each["label"]))
    team, sparks, bars = figures.team, sparks_of(figures), bars_of(figures)
    return [
        {
            "run": run,
            "episode": header["episode"],
            "seed": header["seed"],
            "turns": evidence.turns_of(header),
            "end": header["end"] or "open",
            "error": header["error"],
            "packed": False,
            "why": [],
            "failing": failed[place],
            "team": _finite(team[place]),
            "spark": sparks[place],
            "acts": bars[place],
            "returns": {
                agent: _finite(figures.returns[place, column])
                for column, agent in enumerate(figures.agents)
                if has_few and figures.present[place, column]
            },
            "labels": list(dict.fromkeys(given.get(header["episode"], ()))),
            "base": None,
            "change": None,
        }
        for place, header in enumerate(figures.headers)
    ]


def sparks_of(figures: Figures) -> list[str]:
    """Sparkline of each episode: a letter for each part, from A (the least of the run) to z.

    The sum of all agents' rewards so far, on one scale for the run; empty where one isn't finite.
    """
    cumulative = figures.cumulative
    is_known: NDArray[np.bool_] = np.atleast_1d(np.isfinite(cumulative).all(axis=1))
    known = cumulative[is_known]
    low, high = float(known.min(initial=0.0)), float(known.max(initial=0.0))
    parts = np.rint((known - low) / ((high - low) or 1.0) * (len(SCALE) - 1)).astype(np.int64)
    rows: list[list[int]] = parts.tolist()
    letters = iter(["".join(SCALE[k] for k in row) for row in rows])
    return [next(letters) if each else "" for each in is_known]


def bars_of(figures: Figures) -> list[str]:
    """Histogram of each episode's actions 0, 1, 2, ...: a letter each, from A (none) to z (all).

    Empty in a run whose actions aren't whole numbers.
    """
    counts = figures.actions
    used = int(np.flatnonzero(counts.any(axis=0)).max(initial=-1)) + 1
    if used == 0:
        return [""] * len(figures.headers)
    shares = counts[:, :used] / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    rows: list[list[int]] = np.rint(shares * (len(SCALE) - 1)).astype(np.int64).tolist()
    return ["".join(SCALE[k] for k in row) for row in rows]


def listed(entries: Sequence[dict[str, Any]], *, most_bytes: int) -> list[dict[str, Any]]:
    """The entries that fit: those on the page, then failing ones, then the others.

    Args:
        entries: in the order in which they are shown, which stays.
        most_bytes: limit of their JSON.
    """
    left, fitting = most_bytes, set()
    ranked = sorted(
        range(len(entries)),
        key=lambda place: (not entries[place]["packed"], not entries[place]["failing"]),
    )
    for place in ranked:
        left -= len(json.dumps(entries[place]))
        if left < 0 and not entries[place]["packed"]:
            break
        fitting.add(place)
    return [entry for place, entry in enumerate(entries) if place in fitting]


def _finite(value: float) -> float | None:
    return float(f"{value:.7g}") if np.isfinite(value) else None


def packed_of(
    evidence: Evidence,
    episode: int,
    *,
    run: str = "a",
    labels: Sequence[Label] = (),
    marks: Iterable[Mark] = (),
    roster: Sequence[PackedAgent] = (),
    frames: Drawing | None = None,
    has_failed: bool | None = None,
    condition: str | None = None,
    pivots: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """One episode as the player reads it, with its drawing and all its marks.

    Args:
        labels: failure labels of the run as plain data.
        marks: further ones, such as the first difference from another episode.
        roster: of the run, where it is known already.
        has_failed: True if it failed, where that is known already.
        condition: of the team, in place of what the contract declares.
        pivots: the document of `gamekeeper pivots`.
    Raises:
        EvidenceError: there is no such episode.
    """
    recorded = evidence.episode(episode)
    roster = roster or packed_agents(evidence)
    names = [member.name for member in roster]
    environment = evidence.manifest.get("environment") or {}
    declared = DeclaredScene(
        scene_of(evidence),
        [(member.name, member.role) for member in roster],
        environment.get("kwargs") or {},
    )
    lost = pivots_of(pivots, episode)
    branch = branch_of(evidence)
    marks = [*marks, *(() if lost is None else pivot_marks(lost)), *branch]
    failure = _failure_marks(evidence, recorded, has_failed, condition)
    every = [*marks, *_label_marks(recorded, labels), *failure]
    packed = packed_episode(
        recorded,
        roster,
        run=run,
        api=str(environment.get("api") or "parallel"),
        marks=every,
        volatile=evidence.contract.volatile_infos(),
        drawing=lambda infos: drawn(recorded, names, frames=frames, infos=infos, declared=declared),
    )
    if branch:
        packed["change"] = branch[0].text
    return packed if lost is None else {**packed, "curve": success_curve(lost)}


def branch_of(evidence: Evidence) -> list[Mark]:
    """The mark of a run that plays on from a turn of another one: there, one thing was changed."""
    branch = evidence.manifest.get("played_on")
    if not isinstance(branch, Mapping) or type(branch.get("turn")) is not int:
        return []
    agent, turn = str(branch.get("agent")), int(branch["turn"])
    if branch.get("policy") is not None:
        text = f"{agent} played by {branch['policy']} from here on"
    else:
        text = f"{agent} does {branch.get('action')} in place of what was recorded"
    return [Mark(turn, "change", text[:200], agent)]


def _label_marks(episode: Episode, labels: Iterable[Label]) -> Iterable[Mark]:
    for each in labels:
        if each["episode"] == episode.episode:
            why = f": {each['why']}" if each.get("why") else ""
            yield Mark(int(each["turn"] or 0), "label", f"{each['label']}{why}", each["agent"])


def _failure_marks(
    evidence: Evidence, episode: Episode, has_failed: bool | None, condition: str | None
) -> Iterable[Mark]:
    """Failure conditions that the episode met, at its end; an error has a mark of its own."""
    if (
        episode.header.get("error")
        or has_failed is False
        or episode.header.get("end") in UNFINISHED
    ):
        return
    try:
        conditions = failures(evidence.contract, condition)
        if has_failed and len(conditions) == 1:  # the only one: the outcome needn't be read
            answers = dict.fromkeys(conditions, True)
        else:
            answers = failed(outcome_of(episode), conditions, evidence.contract)
    except ContractError:  # no condition is declared, or the episode lacks a figure
        return
    for scope, is_failed in answers.items():
        if is_failed:
            text = scope_text(scope, conditions[scope]) if scope in conditions else scope
            yield Mark(env_steps(episode), "failure", text)


BUDGET_BYTES: Final = 2_500_000
"""Size of packed episodes on a page, in base64."""
SCALE: Final = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
"""Letters of a sparkline, from the least to the largest; `gallery.js` has them too."""
MISSES: Final = 3
"""Number of episodes that didn't fit after which no other is tried."""


def order_of(
    figures: Figures,
    *,
    failing: Sequence[bool | None],
    named: Iterable[int] = (),
    labelled: Iterable[int] = (),
    diverging: Iterable[int] = (),
) -> list[tuple[int, tuple[str, ...]]]:
    """All episodes in the order in which they are put on the page, each with its reasons.

    Named ones first, then unfinished ones, those with labels or divergences, one that failed (the
    lowest team return, where no failure is declared), the median and the best by team return, the
    other failing ones; then the rest, spread over the run.

    Args:
        named: numbers of episodes that were asked for.
        labelled: numbers of those with labels.
        diverging: numbers of those that differ from another run's.
    Raises:
        EvidenceError: a named episode isn't in the run.
    """
    numbers = [int(header["episode"]) for header in figures.headers]
    known = set(numbers)
    named = list(dict.fromkeys(named))
    for each in named:
        if each not in known:
            raise EvidenceError(
                f"the run has no episode {each}",
                where="episodes",
                expected=f"one of {len(numbers)} episodes",
                actual=str(each),
                fix="`gamekeeper show RUN` tells the number of episodes",
            )
    failed = [number for number, bad in zip(numbers, failing, strict=True) if bad]
    stopped = [int(each["episode"]) for each in figures.headers if each["end"] in UNFINISHED]
    lowest, median, best = _by_team(figures, numbers)
    is_judged = any(each is not None for each in failing)
    reasons: dict[int, list[str]] = {}
    for why, group in (
        ("named", named),
        ("unfinished", stopped),
        ("label", labelled),
        ("divergence", diverging),
        ("failing", failed[:1]) if is_judged else ("lowest", lowest),
        ("median", median),
        ("best", best),
        ("failing", failed[1:]),
        ("", _spread(numbers)),
    ):
        for number in group:
            if number in known:
                given = reasons.setdefault(number, [])
                given += [why] if why and why not in given else []
    return [(number, tuple(given)) for number, given in reasons.items()]


def _by_team(figures: Figures, numbers: Sequence[int]) -> tuple[list[int], ...]:
    """The first episode with the lowest team return, the median one and the best."""
    team = np.where(np.isfinite(figures.team), figures.team, -np.inf)
    if not len(team):
        return [], [], []
    by_team = np.argsort(team, kind="stable")
    return tuple([numbers[int(by_team[place])]] for place in (0, (len(team) - 1) // 2, -1))


def _spread(numbers: Sequence[int]) -> list[int]:
    """The first, the last, the one between them, and so on: any beginning is spread evenly."""
    if not numbers:
        return []
    found = [0, len(numbers) - 1]
    gaps = [(0, len(numbers) - 1)]
    while gaps:
        low, high = gaps.pop(0)
        middle = (low + high) // 2
        if high - low > 1:
            found.append(middle)
            gaps += [(low, middle), (middle, high)]
    return [numbers[place] for place in dict.fromkeys(found)]


class Budget:
    """Bytes that are left for episodes; after a few that don't fit, it counts as spent."""

    def __init__(self, size_bytes: int) -> None:
        self.left = size_bytes
        self.misses = 0

    @property
    def is_spent(self) -> bool:
        """True if no further episode should be tried."""
        return self.left <= 0 or self.misses >= MISSES

    def take(self, size_bytes: int) -> bool:
        """Spends so many bytes if they are left."""
        if size_bytes > self.left:
            self.misses += 1
            return False
        self.left -= size_bytes
        return True


def chosen_text(taken: Sequence[tuple[int, tuple[str, ...]]], every: int, *, run: str) -> str:
    """Names the episodes that are on the page, and the command that shows the others; "" of all.

    Args:
        taken: numbers with their reasons.
        every: number of episodes of the run.
        run: its folder as it was named.
    """
    if len(taken) == every:
        return ""
    names = [
        f"{number} ({', '.join(why)})" if why else str(number) for number, why in sorted(taken)
    ]
    return (
        f"{len(taken)} of {every} episodes are on this page, as many as its size limit allows: "
        f"{', '.join(names) or 'none'}. `gamekeeper view {run}` shows all of them; "
        "`--episode N` puts one on the page, `--budget MB` raises the limit."
    )
