"""Frame of the tables of diagnoses with nothing declared: answers, rows that are kept, shares."""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gamekeeper as gk
from gamekeeper.statistics.significance import wilson

ORDER = 7
CAUSES = ("isolated", "joint", "ambiguous", "protocol", "environment")
Row = dict[str, Any]


def read(path: Path) -> list[Row]:
    """Rows of a file; none where there is no file yet."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def shares(counts: Mapping[str, tuple[int, int]]) -> Row:
    """Hits of so many, by name, with Wilson intervals."""
    found: Row = {}
    for name, (hits, of) in counts.items():
        share = wilson(hits, of) if of else None
        interval = None if share is None else [round(share.low, 3), round(share.high, 3)]
        found[name] = {"hits": hits, "of": of, "interval": interval}
    return found


def options_of(doc: str, keep: str) -> argparse.ArgumentParser:
    """The options that all tables have."""
    parser = argparse.ArgumentParser(description=doc.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=1e9, help="after which no other begins")
    parser.add_argument("--keep", type=Path, default=Path(keep))
    parser.add_argument("--also", type=Path, nargs="*", default=[], help="other parts' files")
    return parser


def answer_of(
    env: Any,
    policies: Any,
    options: argparse.Namespace,
    *,
    failed: str,
    kwargs: Mapping[str, Any] | None = None,
    replace: Mapping[str, Any] | None = None,
) -> Row:
    """The diagnosis of a set-up that is recorded for 10 episodes."""
    evidence = gk.rollout(
        env, policies=policies, episodes=10, seed=options.seed + 1, env_kwargs=kwargs
    )
    began = time.process_time()
    found = gk.diagnose(
        evidence,
        env=env,
        policies=policies,
        replace=replace,
        failed=failed,
        perturbations=False,
        episodes=options.episodes,
        seed=options.seed,
    )
    assert found.team is not None
    named = [name for name, e in found.agents.items() if e.answer in CAUSES and e.component]
    return {
        "answer": found.team.answer,
        "said": list(found.team.labels),
        "whom": sorted(named) if found.team.answer not in ("environment", "protocol") else [],
        "component": found.team.component or "",
        "why": found.team.why,
        "lags": {name: each.lag for name, each in found.responses.items()},
        "episodes": found.episodes,
        "cpu_s": round(time.process_time() - began, 1),
    }


def table(
    measure: str,
    cases: Sequence[Any],
    options: argparse.Namespace,
    *,
    holds: Callable[[Any], bool],
    fields: Iterable[str],
    answer: Callable[[Any], Row],
    summary: Callable[[list[Row]], Row],
) -> None:
    """Has set-ups that aren't kept yet diagnosed, prints a line for each, then the shares.

    Args:
        cases: with a `name`.
        holds: tells if a set-up is what it claims to be; else it is kept without an answer.
        fields: of a set-up that stand in its row.
    """
    began, known = time.perf_counter(), {row["name"] for row in read(options.keep)}
    for case in cases:
        if case.name in known or time.perf_counter() - began > options.seconds:
            continue
        row: Row = json.loads(json.dumps({key: getattr(case, key) for key in ("name", *fields)}))
        if holds(case):
            row |= answer(case)
            print(json.dumps(row), flush=True)
        with options.keep.open("a") as file:
            file.write(json.dumps(row) + "\n")
    rows = [row for path in (options.keep, *options.also) for row in read(path)]
    held = [row for row in rows if "answer" in row]
    said = {"set-ups": len(rows), "of": len(cases), "held": len(held), **summary(held)}
    print(json.dumps({"measure": measure, "episodes": options.episodes, **said}))
