"""What an audit takes, and what it finds beside PettingZoo's own tests.

    python benchmarks/audit.py time [--rounds 3]        # quick and default audits of simple_spread
    python benchmarks/audit.py found [FOLDER ...]   # faults found, ours and PettingZoo's tests

`time` prints wall seconds of whole commands (`gamekeeper audit ... --json`), the median of the
rounds, the slowest probes, and whether all rounds gave the same verdicts.

`found` takes faulty and clean environments: files with `make` and `VIOLATION` (None: clean) in the
folders given, else those of `tests/faults`. For each it runs an audit of the default budget, and
PettingZoo's API and seed tests in a process of its own; a fault counts as found by these when one
of them raises, a clean one as a false alarm. One JSON line an environment, one of sums at the end.
"""

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
SPREAD: Final = "mpe2.simple_spread_v3:parallel_env"
QUIET: Final = {**os.environ, "SDL_VIDEODRIVER": "dummy", "PYGAME_HIDE_SUPPORT_PROMPT": "1"}
TESTS: Final = """
import importlib, importlib.util, sys, warnings
warnings.simplefilter("ignore")
from pettingzoo.test import api_test, parallel_api_test, seed_test, parallel_seed_test
home, _, name = sys.argv[1].rpartition(":")
if home.endswith(".py"):
    spec = importlib.util.spec_from_file_location("faulty", home)
    module = sys.modules["faulty"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
else:
    module = importlib.import_module(home)
make, api = getattr(module, name), sys.argv[2]
tests = {
    "api": lambda: (parallel_api_test if api == "parallel" else api_test)(make(), 1000),
    "seed": lambda: (parallel_seed_test if api == "parallel" else seed_test)(make),
}
raised = []
for name, test in tests.items():
    try:
        test()
    except BaseException as error:
        raised.append(f"{name}: {type(error).__name__}")
print("RAISED", ", ".join(raised))
"""


def timed(arguments: list[str]) -> tuple[float, dict[str, Any]]:
    """Wall seconds of a whole audit, and its document."""
    begun_s = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "gamekeeper", "audit", *arguments, "--json"],
        capture_output=True,
        text=True,
        env=QUIET,
        cwd=ROOT,
    )
    return time.perf_counter() - begun_s, json.loads(done.stdout)


def time_lines(rounds: int) -> Iterator[dict[str, Any]]:
    """A line for the quick audit and one for the default budget."""
    for name, options in (("quick", ["--quick"]), ("default", [])):
        runs = [timed([SPREAD, *options]) for _ in range(rounds)]
        documents = [document for _, document in runs]
        verdicts = [[(v["id"], v["outcome"], v["cases"]) for v in d["verdicts"]] for d in documents]
        slowest = sorted(documents[-1]["timings"].items(), key=lambda item: -item[1])[:6]
        yield {
            "figure": "audit_time",
            "environment": SPREAD,
            "budget": name,
            "wall_s": round(statistics.median(wall for wall, _ in runs), 2),
            "audit_s": round(statistics.median(d["seconds"] for d in documents), 2),
            "steps": documents[-1]["steps"],
            "checks": len(verdicts[-1]),
            "failed": [v["id"] for v in documents[-1]["verdicts"] if v["outcome"] == "failed"],
            "same_verdicts": all(each == verdicts[0] for each in verdicts),
            "slowest_s": dict(slowest),
        }


def subjects(folders: list[str]) -> Iterator[tuple[str, str, bool]]:
    """What is audited, its API, and whether there is a fault."""
    from pettingzoo import AECEnv

    if not folders:
        sys.path.insert(0, str(ROOT))
        from tests.faults import environments

        for each in environments().values():
            api = "aec" if issubclass(each.env, AECEnv) else "parallel"
            yield each.spec, api, bool(each.checks)
    for path in sorted(each for folder in folders for each in Path(folder).resolve().glob("*.py")):
        if path.name.startswith("_"):
            continue
        module = _module(path)
        try:
            api = "aec" if isinstance(module.make(), AECEnv) else "parallel"
        except Exception:  # a fault of its own; the audit says so
            api = getattr(module, "API", "parallel")
        yield f"{path}:make", api, bool(getattr(module, "VIOLATION", None))


def _module(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(f"faulty_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def found_lines(folders: list[str]) -> Iterator[dict[str, Any]]:
    """A line for each environment, then the sums."""
    sums = {"faults": 0, "clean": 0, "ours": 0, "theirs": 0, "our_alarms": 0, "their_alarms": 0}
    for spec, api, is_faulty in subjects(folders):
        _, document = timed([spec])
        ours = [v["id"] for v in document["verdicts"] if v["outcome"] == "failed"]
        done = subprocess.run(
            [sys.executable, "-c", TESTS, spec, api],
            capture_output=True,
            text=True,
            env=QUIET,
            timeout=600,
            cwd=ROOT,
        )
        said = [line for line in done.stdout.splitlines() if line.startswith("RAISED")]
        theirs = said[0].removeprefix("RAISED").strip() if said else f"exit {done.returncode}"
        sums["faults" if is_faulty else "clean"] += 1
        sums["ours" if is_faulty else "our_alarms"] += bool(ours)
        sums["theirs" if is_faulty else "their_alarms"] += bool(theirs)
        yield {
            "figure": "audit_found",
            "environment": spec,
            "fault": is_faulty,
            "gamekeeper": ours,
            "pettingzoo": theirs,
        }
    yield {"figure": "audit_found", "sums": sums}


def main() -> None:
    """Prints JSON lines."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figure", choices=["time", "found"])
    parser.add_argument("folders", nargs="*")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    if arguments.figure == "time":
        lines = time_lines(arguments.rounds)
    else:
        lines = found_lines(arguments.folders)
    for line in lines:
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
