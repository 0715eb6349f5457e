"""How often a diagnosis is right: planted causes, joint ones, lost ones, healthy set-ups.

The set-ups come from planted_causes.py, which knows nothing of the diagnosis. Each is recorded for
20 episodes and diagnosed with 2,000 episodes and no perturbations. A claim (`isolated`,
`joint`) is right where its labels are the planted ones and, where agents were named, no other agent
is given a cause. Prints a JSON line for each set-up (also into `--keep`, from which a second call
goes on), then the shares with Wilson intervals; `--page` writes
docs/reference/diagnosis-planted.md.

    python benchmarks/planted.py [--single 110] [--joint 20] [--lost 12] [--healthy 140]
        [--seed 0] [--part 0/2] [--keep planted.jsonl] [--page docs/reference/diagnosis-planted.md]
"""

import argparse
import json
import sys
import time
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from planted_causes import Planted, drawn, holds, rollout

import gamekeeper as gk
from gamekeeper.statistics.significance import wilson

KINDS = ("single", "joint", "no handle", "healthy")
CLAIMS = ("isolated", "joint", "protocol")
MOST_DRAWN = 12
"""Set-ups that are drawn for each that is wanted, at most."""


def diagnosed(planted: Planted, number: int) -> dict[str, Any]:
    """What the diagnosis says of a set-up, and whether that is right."""
    evidence = rollout(planted, seed=number, episodes=20)
    began = time.perf_counter()
    found = gk.diagnose(evidence, failed=planted.failed, perturbations=False)
    seconds = time.perf_counter() - began
    assert found.team is not None
    whom = {name for name, each in found.agents.items() if each.component}
    told = {
        "answer": found.team.answer,
        "said": list(found.team.labels) or _whole(found.team.component),
        "why": found.team.why,
        "whom": sorted(whom),
        "seconds": round(seconds, 2),
        "episodes": found.episodes,
    }
    if found.team.answer in CLAIMS:
        is_right = sorted(told["said"]) == sorted(planted.cures)
        strangers = {a for a in whom if planted.agents and not _is_meant(a, planted.agents)}
        told["right"] = is_right and not strangers
    return told


def _whole(component: str | None) -> list[str]:
    """A whole policy or memory in place of a label."""
    if component is None:
        return []
    return ["policy" if component.endswith("'s policy") else "memory"]


def _is_meant(agent: str, whom: tuple[str, ...]) -> bool:
    return agent in whom or agent.rpartition("_")[0] in whom


def play(kind: str, wanted: int, seed: int, part: tuple[int, int], keep: Path) -> None:
    """Looks for set-ups of a kind that are what they claim to be, and has them diagnosed."""
    known = [json.loads(line) for line in keep.read_text().splitlines()] if keep.exists() else []
    seen = {row["number"] for row in known if row["kind"] == kind}
    got = sum(row["kind"] == kind and "answer" in row for row in known)
    place, parts = part
    for number, planted in enumerate(islice(drawn(kind, seed), MOST_DRAWN * wanted)):
        if got >= -(-wanted // parts) or number % parts != place:
            if got >= -(-wanted // parts):
                return
            continue
        if number in seen:
            continue
        shares = holds(planted)
        row: dict[str, Any] = {"number": number, **planted.told(), "shares": shares}
        if shares is not None:
            row |= diagnosed(planted, number)
            got += 1
            print(json.dumps(row), flush=True)
        with keep.open("a") as file:
            file.write(json.dumps(row) + "\n")


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Right claims, abstentions where there is a handle, causes named to the healthy."""
    failing = [row for row in rows if row["kind"] != "healthy"]
    healthy = [row for row in rows if row["kind"] == "healthy"]
    claims = [row for row in failing if row["answer"] in CLAIMS]
    handled = [row for row in failing if row["kind"] != "no handle"]
    counts = {
        "claims right": (sum(row["right"] for row in claims), len(claims)),
        "abstained with a handle": (
            sum(row["answer"] not in CLAIMS for row in handled),
            len(handled),
        ),
        "cause named without a handle": (
            sum(bool(row["said"]) for row in failing if row["kind"] == "no handle"),
            len(failing) - len(handled),
        ),
        "cause named to the healthy": (sum(bool(row["said"]) for row in healthy), len(healthy)),
    }
    found: dict[str, Any] = {"failing": len(failing), "healthy": len(healthy)}
    for name, (hits, looks) in counts.items():
        share = wilson(hits, looks)
        found[name] = {
            "hits": hits,
            "of": looks,
            "share": share.p,
            "low": share.low,
            "high": share.high,
        }
    return found


def matrix(rows: list[dict[str, Any]]) -> Counter[tuple[str, str]]:
    """How often what was planted was answered so."""
    found: Counter[tuple[str, str]] = Counter()
    for row in rows:
        planted = " + ".join(sorted(row["labels"])) or row["kind"]
        if row["kind"] == "joint":
            planted = "joint"
        said = " + ".join(row["said"]) if row["answer"] == "isolated" else row["answer"]
        is_wrong_pair = row["answer"] == "joint" and not row.get("right")
        found[planted, "joint, wrong" if is_wrong_pair else said] += 1
    return found


def page(rows: list[dict[str, Any]], command: str) -> str:
    """The page of figures."""
    figures, cells = summary(rows), matrix(rows)
    labels = [
        "perception",
        "state estimation",
        "policy",
        "memory",
        "control",
        "timing",
        "data coverage",
        "evaluation",
    ]
    nothing = ["elsewhere", "healthy", "not_failing", "unexplained", "not_tried"]
    across = [*labels, "joint", "joint, wrong", "ambiguous", *nothing]
    across = [name for name in across if any(said == name for _, said in cells)]
    down = [*labels, "joint", "no handle", "healthy"]
    lines = [
        "# How often a diagnosis is right",
        "",
        "Set-ups with a planted cause, made without the diagnosis' own code, each looked at by "
        "plain rollouts before it counts (the rule stands in benchmarks/planted_causes.py); "
        "recorded for 20 episodes and diagnosed on fresh seeds.",
        "",
        f"`{command}`",
        "",
        "| | hits | of | share | 95 % |",
        "|---|---|---|---|---|",
    ]
    for name, each in figures.items():
        if isinstance(each, dict):
            lines.append(
                f"| {name} | {each['hits']} | {each['of']} | {each['share']:.1%} | "
                f"{each['low']:.1%} to {each['high']:.1%} |"
            )
    lines += ["", "Planted (down) and answered (across):", ""]
    lines += ["| | " + " | ".join(across) + " |", "|---" * (len(across) + 1) + "|"]
    for name in down:
        counts = [str(cells[name, said] or "") for said in across]
        lines.append(f"| {name} | " + " | ".join(counts) + " |")
    wrong = [row for row in rows if row.get("right") is False]
    if wrong:
        lines += ["", "Wrong claims:", ""]
        lines += [
            f"- {row['task']} {json.dumps(row['kwargs'])} {json.dumps(row['policies'])}: planted "
            f"{', '.join(row['labels']) or row['kind']}, said {', '.join(row['said'])} of "
            f"{', '.join(row['whom'])}"
            for row in wrong
        ]
    seconds = sorted(row["seconds"] for row in rows if row["kind"] != "healthy")
    lines += [
        "",
        f"A diagnosis of a failing set-up took {seconds[len(seconds) // 2]:.1f} s in the "
        f"middle, {seconds[-1]:.1f} s at most, in one process.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Plays what is wanted and says how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for kind, wanted in zip(KINDS, (110, 20, 12, 140), strict=True):
        name = {"no handle": "lost"}.get(kind, kind)
        parser.add_argument(f"--{name}", type=int, default=wanted)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--part", default="0/1")
    parser.add_argument("--keep", type=Path, default=Path("planted.jsonl"))
    parser.add_argument("--also", type=Path, nargs="*", default=[], help="other parts' files")
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    place, parts = map(int, options.part.split("/"))
    wanted = (options.single, options.joint, options.lost, options.healthy)
    for kind, count in zip(KINDS, wanted, strict=True):
        play(kind, count, options.seed, (place, parts), options.keep)
    lines = [
        line for path in [options.keep, *options.also] for line in path.read_text().splitlines()
    ]
    rows = [row for row in map(json.loads, lines) if "answer" in row]
    print(json.dumps({"measure": "planted causes", **summary(rows)}))
    if options.page is not None:
        options.page.write_text(page(rows, "python benchmarks/planted.py"), encoding="utf-8")


if __name__ == "__main__":
    main()
