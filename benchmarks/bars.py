"""Every bar that the project has set itself: measured, kept, and shown as one table.

What is wanted stands in benchmarks/wanted/*.toml, a file for each room: commands, the bars that one
command measures, where in its JSON lines a figure is. What was measured is kept in
benchmarks/results/*.json, a file for each command, so that a part can be measured at any time; the
table of docs/performance.md is made of both.

    python benchmarks/bars.py                          # measures everything that can run here
    python benchmarks/bars.py --only recording kernels --write
    python benchmarks/bars.py --list                   # commands, minutes, what each needs
    python benchmarks/bars.py --table --write          # the page's table anew, nothing measured

`--write` keeps results and writes the table; without it the figures are only printed, a JSON line a
bar: {"bar", "what", "wanted", "value", "low", "high", "reached"}. `low` and `high` are the least
and the most of several runs (`--repeats`), or the script's own spread. `--whole` takes the long
command where the usual one is short. Interpreters and peers that live in environments of their own
are named with `--python NAME=PATH`; what isn't named, or found as .venv-NAME, is skipped and said.

With each result stand its date, the load when it began, and `others`: how many cores other work
took meanwhile, by the system's own count; on a quiet machine it is below 0.1.
"""

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent))
from bars_page import page_with, reached, text_of
from bars_read import Lines, figure_of

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parent
WANTED, RESULTS = HERE / "wanted", HERE / "results"
PAGE: Final = ROOT / "docs" / "performance.md"
PATIENCE: Final = 8
"""A command that takes so many times its minutes is given up."""


def runs() -> list[dict[str, Any]]:
    """Every command with its bars, in the order of the rooms."""
    rooms = [tomllib.loads(path.read_text("utf-8")) for path in sorted(WANTED.glob("*.toml"))]
    rooms.sort(key=lambda room: room["place"])
    return [{"room": room["room"], **run} for room in rooms for run in room["run"]]


def results() -> dict[str, dict[str, Any]]:
    """What is kept, by the command's name."""
    return {path.stem: json.loads(path.read_text("utf-8")) for path in RESULTS.glob("*.json")}


def python_of(run: Mapping[str, Any], named: Mapping[str, str]) -> str | None:
    """The interpreter of a command; None where it isn't here."""
    name = run.get("python")
    if name is None:
        return sys.executable
    usual = ROOT / f".venv-{name}" / "bin" / "python"
    return named.get(name) or (str(usual) if usual.exists() else None)


def command_of(
    run: Mapping[str, Any], named: Mapping[str, str], *, whole: bool = False, scratch: str = ""
) -> list[str]:
    """The command as it is started, peers included that are named; SCRATCH is a folder."""
    text = run["whole"] if whole and "whole" in run else run["command"]
    words = shlex.split(text.replace("SCRATCH", scratch))
    python = python_of(run, named)
    if words[0] == "python" and python is not None:
        words[0] = python
    for peer in run.get("peers", ()):
        if peer in named:
            words += ["--peer", f"{peer}={named[peer]}"]
    return words


def missing(run: Mapping[str, Any], named: Mapping[str, str]) -> str | None:
    """Why a command can't run here, or None."""
    if python_of(run, named) is None:
        return f"needs --python {run['python']}=PATH"
    absent = [name for name in run.get("peers", ()) if name not in named]
    if absent and run.get("needs_peers", False):
        return "needs " + " ".join(f"--python {name}=PATH" for name in absent)
    return None


def measured(run: Mapping[str, Any], named: Mapping[str, str], options: Any) -> dict[str, Any]:
    """Runs a command as often as asked for; the entry that is kept of it."""
    repeats = 1 if options.whole else options.repeats or run.get("repeats", 1)
    minutes = run.get("whole_minutes" if options.whole else "minutes", 5)
    load, busy_s, began_s = os.getloadavg()[0], _busy_s(), time.monotonic()
    own_s, every = _own_s(), []
    with tempfile.TemporaryDirectory(prefix="bars-") as scratch:
        if "before" in run:
            before = {"command": run["before"]}
            _lines(command_of(before, named, scratch=scratch), minutes)
        for number in range(repeats):
            folder = Path(scratch) / str(number) if "before" not in run else Path(scratch)
            folder.mkdir(exist_ok=True)
            command = command_of(run, named, whole=options.whole, scratch=str(folder))
            every.append(_lines(command, minutes))
    wall_s = time.monotonic() - began_s
    others = max(0.0, (_busy_s() - busy_s) - (_own_s() - own_s)) / wall_s
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "load": round(load, 1),
        "others": round(others, 2),
        "seconds": round(wall_s),
        "repeats": repeats,
        "python": ".".join(map(str, sys.version_info[:2])),
        "command": run["whole" if options.whole and "whole" in run else "command"],
        "bars": {bar["name"]: figure_of(every, bar) for bar in run["bar"]},
    }


def _lines(command: list[str], minutes: float) -> Lines:
    """The JSON lines that a command prints; what else it says goes to stderr."""
    paths = [str(ROOT / "src"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    sys.stderr.write(f"{shlex.join(command)}\n")
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            said, _ = process.communicate(timeout=60 * minutes * PATIENCE)
        except subprocess.TimeoutExpired:
            process.terminate()
            said, _ = process.communicate()
    return [json.loads(line) for line in said.splitlines() if line.startswith("{")]


def _busy_s() -> float:
    """Processor seconds of everything on this machine since it started, all cores."""
    try:
        times = Path("/proc/stat").read_text("ascii").splitlines()[0].split()[1:]
    except OSError:
        return 0.0
    user, nice, system, _, _, irq, soft, *_ = map(int, times)
    return (user + nice + system + irq + soft) / os.sysconf("SC_CLK_TCK")


def _own_s() -> float:
    own = os.times()
    return own.user + own.system + own.children_user + own.children_system


def keep(run: Mapping[str, Any], entry: Mapping[str, Any], *, whole: bool) -> None:
    """Writes an entry; a figure that wasn't found leaves the one of before, with its date."""
    path = RESULTS / f"{run['name']}.json"
    kept = json.loads(path.read_text("utf-8")) if path.exists() else {}
    kind = "whole" if whole and "whole" in run else "usual"
    before = kept.get(kind, {"bars": {}})
    found = {
        name: {**{key: before[key] for key in ("date", "load")}, **before["bars"][name]}
        if figure["value"] is None and name in before["bars"]
        else figure
        for name, figure in entry["bars"].items()
    }
    kept[kind] = {**entry, "bars": found}
    path.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def tell(run: Mapping[str, Any], entry: Mapping[str, Any]) -> None:
    """A JSON line for each bar."""
    for bar in run["bar"]:
        found = entry["bars"][bar["name"]]
        line = {
            "bar": f"{run['name']}/{bar['name']}",
            "what": bar["what"],
            "wanted": text_of(bar),
            **found,
            "reached": reached(bar, found),
        }
        sys.stdout.write(json.dumps(line, ensure_ascii=False) + "\n")
    sys.stdout.flush()


def listed(chosen: Lines, named: Mapping[str, str]) -> None:
    """Commands with their minutes, and what keeps one from running here."""
    for run in chosen:
        clock = "quiet" if run.get("clock") else "any"
        why = missing(run, named)
        sys.stdout.write(
            f"{run['name']:22} {run.get('minutes', 1):5} min  {clock:5}  {run['command']}"
            f"{f'  [{why}]' if why else ''}\n"
        )
    minutes = sum(run.get("minutes", 1) for run in chosen if missing(run, named) is None)
    sys.stdout.write(f"{minutes:.0f} minutes together\n")


def write_page() -> None:
    """The table of the page is that of the results."""
    page = PAGE.read_text("utf-8")
    PAGE.write_text(page_with(page, runs(), results()), encoding="utf-8")


def main() -> int:
    """Measures what is asked for; 1 where a figure couldn't be read."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [run["name"] for run in runs()]
    usual = [run["name"] for run in runs() if not run.get("apart")]
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=names, default=usual)
    parser.add_argument("--room", help="the commands of one room")
    parser.add_argument("--python", action="append", default=[], metavar="NAME=PATH")
    parser.add_argument("--repeats", type=int, help="runs of each command, in place of its own")
    parser.add_argument("--whole", action="store_true", help="the long command, where there is one")
    parser.add_argument("--write", action="store_true", help="keeps results and writes the table")
    parser.add_argument("--table", action="store_true", help="measures nothing")
    parser.add_argument("--list", action="store_true", help="names what there is to run")
    options = parser.parse_args()
    named = dict(pair.split("=", 1) for pair in options.python)
    chosen = [run for run in runs() if run["name"] in options.only]
    chosen = [run for run in chosen if options.room in (None, run["room"])]
    if options.list:
        listed(chosen, named)
        return 0
    is_whole = True
    for run in [] if options.table else chosen:
        why = missing(run, named)
        if why is not None:
            sys.stderr.write(f"{run['name']} is skipped: {why}\n")
            continue
        entry = measured(run, named, options)
        tell(run, entry)
        is_whole &= all(each["value"] is not None for each in entry["bars"].values())
        if options.write:
            keep(run, entry, whole=options.whole)
            write_page()
    if options.table and options.write:
        write_page()
    return 0 if is_whole else 1


if __name__ == "__main__":
    sys.exit(main())
