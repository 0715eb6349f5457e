"""Measured structures of the environments of PettingZoo, mpe2 and Gamekeeper, each read in source.

    python benchmarks/published_forms.py --out FILE [--budget 6000] [--seed 0] [--only WORD ...]
    python benchmarks/published_forms.py --table FILE ... > docs/reference/measured-forms.md

The first measures each environment as `benchmarks.form_table` does, and adds a JSON line to FILE;
what has a line there isn't measured again. The second prints the page with the measured forms
beside `benchmarks/forms/published.toml`, in which stands what the sources say, and where.
"""

import argparse
import json
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.form_table import measurement
from benchmarks.replay_zoo import zoo
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import open_env

OURS: Final = (
    "connect_four",
    "foraging",
    "handover",
    "pursuit",
    "reference",
    "robotic_warehouse",
    "speaker_listener",
    "spread",
    "tag",
    "tictactoe",
    "two_robot_line",
    "warehouse",
    "warehouse_turns",
)
FIELDS: Final = ("stages", "order", "observe", "conflicts", "legality", "deterministic", "horizon")


def specs() -> Iterator[str]:
    """Every environment, for each API that it is offered in; those with pictures last."""
    yield from (f"gamekeeper/{name}-v0" for name in OURS)
    theirs = [spec for spec in zoo() if ".py:" not in spec and "gamekeeper/" not in spec]
    yield from sorted(theirs, key=lambda spec: ("butterfly" in spec or "sisl" in spec, spec))


def line_of(spec: str, *, budget: int, seed: int) -> dict[str, Any]:
    """The measured form of one environment, and the seconds that it took."""
    begun_s = time.perf_counter()
    try:
        found, _ = measurement(spec, budget=budget, seed=seed)
    except Exception as error:  # a missing package, or a fault of the environment
        return {"spec": spec, "error": f"{type(error).__name__}: {error}"[:200]}
    line = {"spec": spec, **{name: found.get(name) for name in FIELDS}}
    line["advice"], line["because"] = found.get("advice"), found.get("because")
    line["why"] = found.get("why")
    symmetric: Mapping[str, Any] = found.get("symmetric") or {}
    line["symmetric"] = {name: each.get("seems") for name, each in symmetric.items()}
    reward: Mapping[str, Any] = found.get("reward") or {}
    line["shared"], line["zero_sum"] = reward.get("shared"), reward.get("zero_sum")
    line["endings"] = (found.get("endings") or {}).get("kinds")
    line["may_leave"] = found.get("may_leave")
    return line | {"seconds": round(time.perf_counter() - begun_s, 1)}


TRUTHS: Final = Path(__file__).parent / "forms" / "published.toml"
JUDGED: Final = (
    "order",
    "observe",
    "conflicts",
    "legality",
    "horizon",
    "shared",
    "zero_sum",
    "advice",
)
HEADS: Final = ("Turn order", "Observed", "Conflicts", "Moves change masks", "Horizon", "Advice")
SHOWN: Final = ("order", "observe", "conflicts", "legality", "horizon", "advice")
INTRO: Final = """\
# Measured forms of published environments

Each environment was played as an audit plays it, with nothing declared, and its
form was measured. Then its source was read: what it says, and where, stands in
`benchmarks/forms/published.toml`. A value that differs from the source is
**bold**, with the source's in brackets; "-" says that nothing was claimed, with
too few cases. Gamekeeper's own stand beside their contracts. Environments with
pictures, and those whose steps are slow, were played for a quarter of the steps.
Made by `python benchmarks/published_forms.py`.
"""


def truths() -> dict[str, dict[str, Any]]:
    """What the sources say, by environment and API: `parallel:mpe2.simple_v3`."""
    whole = tomllib.loads(TRUTHS.read_text(encoding="utf-8"))
    parts = {api: whole.pop(f".{api}", {}) for api in ("aec", "parallel")}
    return {
        f"{api}:{name}": fields | parts[api].get(name, {})
        for name, fields in whole.items()
        for api in parts
    } | {f"gamekeeper/{name}-v0": declared(f"gamekeeper/{name}-v0") for name in OURS}


def declared(spec: str) -> dict[str, Any]:
    """What the contract of one of ours declares, in the same fields."""
    opened = open_env(spec)
    contract = declared_contract(None, opened)
    assert contract is not None
    schedule, kinds = contract.schedule, {term.kind for term in contract.rewards.values()}
    truth: dict[str, Any] = {
        "order": schedule.order,
        "observe": schedule.observe,
        "conflicts": schedule.conflicts,
        "horizon": schedule.horizon or "none",
        "advice": opened.api,
    }
    if len(kinds) == 1:  # a term that legal episode never pays has another kind in some
        truth |= {"shared": kinds == {"shared"}, "zero_sum": kinds == {"zero-sum"}}
    return truth


def name_of(spec: str) -> str:
    """`parallel:mpe2.simple_v3` of `parallel:mpe2.simple_v3:parallel_env`."""
    api, colon, rest = spec.partition(":")
    if not colon:
        return spec
    return f"{api}:{rest.partition(':')[0]}"


def results(
    lines: Iterable[Mapping[str, Any]],
) -> Iterator[tuple[Mapping[str, Any], dict[str, str]]]:
    """Each measured line with `right`, `wrong` or `silent` by judged field."""
    known = truths()
    for line in lines:
        truth = known.get(name_of(line["spec"]), {})
        judged = {}
        for field in JUDGED:
            if field not in truth:
                continue
            wanted = None if truth[field] == "none" and field == "horizon" else truth[field]
            value = line[field]
            is_silent = value is None and wanted is not None
            judged[field] = "silent" if is_silent else "right" if value == wanted else "wrong"
        yield line, judged


def page(lines: list[Mapping[str, Any]]) -> str:
    """The page: sums by field, then a row for each environment."""
    rows, known = list(results(lines)), truths()
    counts = {field: Counter(judged.get(field) for _, judged in rows) for field in JUDGED}
    out = [INTRO, "| field | right | wrong | not claimed |", "|---|---:|---:|---:|"]
    for field, count in counts.items():
        out.append(f"| {field} | {count['right']} | {count['wrong']} | {count['silent']} |")
    out += ["", "| environment | " + " | ".join(HEADS) + " |", "|---" * (len(HEADS) + 1) + "|"]
    for line, judged in rows:
        truth = known.get(name_of(line["spec"]), {})
        cells = [_cell(line[field], judged.get(field), truth.get(field)) for field in SHOWN]
        out.append(f"| `{line['spec']}` | " + " | ".join(cells) + " |")
    return "\n".join(out)


def _cell(value: Any, result: str | None, truth: Any) -> str:
    text = "-" if value is None else {True: "yes", False: "no"}.get(value, str(value))
    return f"**{text}** ({truth})" if result == "wrong" else text


def read(paths: Iterable[Path]) -> list[Mapping[str, Any]]:
    """The measured lines of files, without those that ended in an error."""
    lines = [json.loads(text) for path in paths for text in path.read_text().splitlines()]
    return [line for line in lines if "error" not in line]


def main() -> None:
    """Measures, or prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, nargs="+")
    parser.add_argument("--budget", type=int, default=6_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=())
    options = parser.parse_args()
    if options.table:
        print(page(read(options.table)))
        return
    done = set()
    if options.out.exists():
        done = {json.loads(line)["spec"] for line in options.out.read_text().splitlines()}
    for spec in specs():
        if spec in done or (options.only and not any(word in spec for word in options.only)):
            continue
        line = line_of(spec, budget=options.budget, seed=options.seed)
        with options.out.open("a") as lines:
            lines.write(json.dumps(line, default=str) + "\n")
        print(spec, line.get("error", line.get("seconds")), file=sys.stderr)


if __name__ == "__main__":
    main()
