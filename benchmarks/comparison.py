"""Who finds what: PettingZoo's tests, Gymnasium's checker and the audit on the same planted faults.

    python benchmarks/comparison.py [--api parallel] [--only NAME ...] [--table]

The environments stand in faults_parallel.py and faults_aec.py: sound ones, unusual but legal ones,
and ones with a single fault each. A tester finds a fault where it raises (PettingZoo's tests,
Gymnasium's `check_env`) or calls a promise broken (the audit, without a contract, at its quick
budget). What it says of a sound or legal one is a false alarm. PettingZoo's warnings don't count,
as they come for sound ones too. `converted` runs the API test after PettingZoo's own conversion to
the other API. One JSON line an environment, then the sums; `--table` prints the table of
docs/reference/measured.md.
"""

import argparse
import contextlib
import io
import json
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import gymnasium.utils.env_checker
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test, state_test
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec

sys.path.insert(0, str(Path(__file__).parent))

import faults_aec
import faults_parallel

FIGURE: Final = "comparison_faults"
CYCLES: Final = 1000
PATIENCE_S: Final = 120  # a test that takes longer has hung
COLUMNS: Final = ("api", "seed", "state", "converted", "check_env", "audit")
MODULES: Final = {"parallel": faults_parallel, "aec": faults_aec}


def tests_of(api: str, make: Callable[[], Any]) -> dict[str, Callable[[], object]]:
    """The testers that come as functions, for one environment."""
    if api == "parallel":
        found: dict[str, Callable[[], object]] = {
            "api": lambda: parallel_api_test(make(), CYCLES),
            "seed": lambda: parallel_seed_test(make),
            "state": lambda: state_test(parallel_to_aec(make()), make()),
            "converted": lambda: api_test(parallel_to_aec(make()), CYCLES),
        }
    else:
        found = {
            "api": lambda: api_test(make(), CYCLES),
            "seed": lambda: seed_test(make),
            "converted": lambda: parallel_api_test(aec_to_parallel(make()), CYCLES),
        }
        if not make().metadata.get("is_parallelizable"):
            del found["converted"]  # it says itself that it can't be
    found["check_env"] = lambda: gymnasium.utils.env_checker.check_env(make())
    return found


def said(test: Callable[[], object]) -> str | None:
    """What a test raises, or None."""

    def too_long(*_: object) -> None:
        raise TimeoutError(f"no end after {PATIENCE_S} s")

    signal.signal(signal.SIGALRM, too_long)
    signal.alarm(PATIENCE_S)
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            test()
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:100]}"
    finally:
        signal.alarm(0)
    return None


def audited(module: ModuleType, kwargs: dict[str, str]) -> dict[str, Any]:
    """The promises that `gamekeeper audit` calls broken, checks that failed, and its seconds."""
    begun_s = time.perf_counter()
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "gamekeeper",
            "audit",
            f"{module.__file__}:make",
            "--kwargs",
            json.dumps(kwargs),
            "--quick",
            "--json",
        ],
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 1):  # so that a failed audit isn't taken for a silent one
        raise RuntimeError(f"the audit exits with {done.returncode}: {done.stderr or done.stdout}")
    document = json.loads(done.stdout)
    by_outcome: dict[str, list[str]] = {}
    for verdict in document["verdicts"]:
        by_outcome.setdefault(verdict["outcome"], []).append(verdict["id"])
    return {
        "audit": ", ".join(by_outcome.get("failed", [])) or None,
        "audit_errors": by_outcome.get("error", []),
        "audit_not_exercised": len(by_outcome.get("not_exercised", [])),
        "audit_exit": done.returncode,
        "audit_s": round(time.perf_counter() - begun_s, 1),
    }


def environments(api: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Name and keyword arguments of each environment: the sound one, habits, faults."""
    module = MODULES[api]
    yield "sound", {}
    yield from ((name, {"habit": name}) for name in module.HABITS)
    yield from ((name, {"fault": name}) for name in module.FAULTS)


def line_of(api: str, name: str, kwargs: dict[str, str]) -> dict[str, Any]:
    """What each tester says of one environment."""
    module = MODULES[api]
    found = {
        tester: said(test) for tester, test in tests_of(api, lambda: module.make(**kwargs)).items()
    }
    kind = module.KNOWN[name] if name in module.KNOWN else type(module.make())
    return {
        "figure": FIGURE,
        "kind": api,
        "name": name,
        "fault": "fault" in kwargs,
        "what": (kind.__doc__ or "").splitlines()[0],
        **found,
        **audited(module, kwargs),
    }


def sums(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Faults found and false alarms, by tester and by PettingZoo's taken together."""
    together = ("api", "seed", "state", "converted")
    groups = {
        "api": ("api",),
        "api and seed": ("api", "seed"),
        "all of PettingZoo's": together,
        "check_env": ("check_env",),
        "audit": ("audit",),
    }
    faulty = [line for line in lines if line["fault"]]
    sound = [line for line in lines if not line["fault"]]
    return {
        "figure": FIGURE,
        "faults": len(faulty),
        "sound": len(sound),
        "found": {n: sum(any(x.get(c) for c in g) for x in faulty) for n, g in groups.items()},
        "alarms": {n: sum(any(x.get(c) for c in g) for x in sound) for n, g in groups.items()},
        "versions": {n: version(n) for n in ("pettingzoo", "gymnasium")},
    }


def table(lines: list[dict[str, Any]]) -> str:
    """The lines as a table in Markdown: what each tester says of each environment."""
    rows = ["| | what is wrong | PettingZoo's tests | audit |", "|---|---|---|---|"]
    for line in lines:
        theirs = ", ".join(name for name in COLUMNS[:4] if line.get(name))
        what = line["what"].removesuffix(".")
        what = what if line["fault"] else f"nothing. {what.removeprefix('A habit: ')}"
        rows.append(f"| {line['kind']} | {what} | {theirs} | {line['audit'] or ''} |")
    return "\n".join(rows)


def main() -> None:
    """Prints JSON lines, or the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--api", choices=list(MODULES), action="append")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    lines = []
    for api in options.api or MODULES:
        for name, kwargs in environments(api):
            if options.only and name not in options.only:
                continue
            lines.append(line_of(api, name, kwargs))
            if not options.table:
                print(json.dumps(lines[-1]), flush=True)
    if options.table:
        print(table(lines))
    print(json.dumps(sums(lines)), flush=True)


if __name__ == "__main__":
    main()
