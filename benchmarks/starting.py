"""How long it takes until something happens: the import, and the command line's help.

Prints a JSON line each: {"figure": "starting", "what", "seconds", "low", "high", "cpu_s"}: wall
seconds of the import by itself within a fresh process, and of a whole `gamekeeper --help`; medians,
the least and the most. `numba` and `llvmlite` are the same for the compiler that kernels are loaded
with, and for its linker alone, without which no machine code can be loaded.

    python benchmarks/starting.py [--repeats 11]
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Final

IMPORT: Final = (
    "import time; began = time.perf_counter(); import {module}; print(time.perf_counter() - began)"
)


def imported(module: str) -> float:
    """Seconds of an import, the interpreter's own start apart."""
    code = IMPORT.format(module=module)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout)


def helped() -> float:
    """Seconds of the whole command."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "gamekeeper", "--help"]
    subprocess.run(command, capture_output=True, check=True)
    return time.perf_counter() - began


def children_s() -> float:
    """Processor seconds of the processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Prints both figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=11)
    repeats = parser.parse_args().repeats
    figures: dict[str, Callable[[], float]] = {
        "import": partial(imported, "gamekeeper"),
        "help": helped,
        "numba": partial(imported, "numba"),
        "llvmlite": partial(imported, "llvmlite.binding"),
    }
    for what, measure in figures.items():
        measure()  # compiles, and reads the files once
        before_s = children_s()
        seconds = [measure() for _ in range(repeats)]
        line = {
            "figure": "starting",
            "what": what,
            "seconds": round(statistics.median(seconds), 3),
            "low": round(min(seconds), 3),
            "high": round(max(seconds), 3),
            "cpu_s": round((children_s() - before_s) / repeats, 3),
        }
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
