"""Compares what trainers' own buffers hold with a log worked out by hand, cell by cell.

A cell is a form of observations, with or without masks, one role or two, agents that end together,
one by one or join late, in one of the two interfaces: 192 cells. Prints a row for each buffer and
form: cells that hold the log, cells that are refused, with the reason, and cells that differ.

    python benchmarks/trainer_matrix.py vector gymnasium epymarl
    python benchmarks/trainer_matrix.py sb3_on_policy sb3_off_policy   # where it is installed
    python benchmarks/trainer_matrix.py tianshou       # likewise; torchrl, benchmarl, rllib
"""

import argparse
import importlib
import json
import os
import sys
from collections import Counter
from pathlib import Path
from typing import Final

os.environ.setdefault("OMP_NUM_THREADS", "1")  # networks are small: more threads only wait
sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.adapters import ledger

BUFFERS: Final = {
    "vector": ("vector_books", "arrays"),
    "gymnasium": ("gymnasium_books", "single"),
    "sb3_on_policy": ("sb3_books", "on_policy"),
    "sb3_off_policy": ("sb3_books", "off_policy"),
    "epymarl": ("epymarl_books", "episodes"),
    "benchmarl": ("benchmarl_books", "buffer"),
    "rllib": ("rllib_ledger", "episodes"),
    "tianshou": ("tianshou_books", "buffer"),
    "torchrl": ("torchrl_books", "batches"),
}


def outcome(buffer: str, cell: ledger.Cell) -> str:
    """Returns "held", why the cell is refused, or "differs" with the first difference."""
    module, function = BUFFERS[buffer]
    compare = getattr(importlib.import_module(f"tests.adapters.{module}"), function)
    try:
        return compare(cell) or "held"
    except Exception as error:
        first = next((line for line in str(error).splitlines() if line.strip()), "")
        return f"differs: {type(error).__name__}: {first}"


def main() -> int:
    """Prints a JSON line for each buffer and form of observations; 1 if a cell differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("buffers", nargs="+", choices=BUFFERS)
    asked = parser.parse_args().buffers
    differs = False
    for buffer in asked:
        for form in ledger.SEEN:
            cells = [cell for cell in ledger.CELLS if cell.seen == form]
            counts = Counter(outcome(buffer, cell) for cell in cells)
            differs |= any(said.startswith("differs") for said in counts)
            print(json.dumps({"buffer": buffer, "observations": form, **counts}), flush=True)
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
