"""Damaged input: whatever is read, documented errors alone come out of it.

    python benchmarks/fuzz.py [--inputs 1000000] [--seed 0] [--only contract ...] [--corpus FOLDER]

Inputs are real ones, damaged: bits flipped, pieces cut out, doubled, moved from one file to
another, numbers and words put in that parsers trip over; where the input is JSON, Parquet or Arrow,
half of them are altered instead: other values, types, columns, rows in a form that is still right.
Of finalized runs the hashes are computed again after that, so that it isn't the checksums that
finds it.
An input that brings out anything but an error of `gamekeeper.errors` is kept in the corpus' folder
and printed; the exit code is 1 then. A process that dies (the input is in the corpus' folder too),
or takes more than two seconds of processor time over one input, counts too.

Prints a JSON line for each target: inputs, refused, read, seconds, and what else came out.
`tests/fuzz/corpus` keeps what was ever found; `tests/fuzz/test_corpus.py` plays it again.
"""

import argparse
import contextlib
import faulthandler
import hashlib
import io
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.fuzzing.damage import altered, damaged
from benchmarks.fuzzing.places import Places
from benchmarks.fuzzing.texts import PLAIN, TARGETS, inputs_of, reader
from gamekeeper.errors import GamekeeperError

SLOW_S: Final = 2.0
STUCK_S: Final = 120
"""Wall time after which a process is taken to hang, in seconds: machines are shared."""
REARMED_S: Final = 1.0
"""How long one input's time may count towards the next one's, in seconds."""
SHARES: Final = {
    "contract": 0.08,
    "contract-data": 0.08,
    "spec": 0.12,
    "spec-data": 0.12,
    "condition": 0.15,
    "options": 0.1,
    "manifest": 0.12,
    "space": 0.06,
    "notes": 0.03,
    "receipt": 0.04,
    "evaluation": 0.03,
    "footer": 0.039,
    "run-line": 0.006,
    "run-turns": 0.006,
    "run-games": 0.006,
    "run-open": 0.006,
    "commands": 0.003,
    "lines": 0.004,
}
"""Of all inputs; a run takes a hundred times as long as a contract."""

Sample = Callable[[], tuple[str, bytes, Callable[[], Any]]]
"""Gives a label, the damaged bytes, and what reads them."""


def sampler(target: str, places: Places, rng: random.Random) -> Sample:
    """What makes inputs of a target."""
    if target in TARGETS:
        inputs = inputs_of(target, places.finalized, places.evaluated)
        read = reader(target, places.of_texts())
        plain = [
            json.loads(data.split(b"\n")[0] if target == "notes" else data)
            for data in inputs
            if target in PLAIN
        ]

        def text() -> tuple[str, bytes, Callable[[], Any]]:
            if plain and rng.random() < 0.5:
                data = json.dumps(altered(rng.choice(plain), rng)).encode()
            else:
                data = damaged(rng.choice(inputs), inputs, rng)
            return "text", data, lambda: read(data)

        return text
    if target == "lines":
        return lambda: places.line(rng)
    if target == "commands":
        return lambda: places.command(rng)
    run_files = places.run_files(target.removeprefix("run-"))

    def file() -> tuple[str, bytes, Callable[[], Any]]:
        name, data = (run_files.damage if rng.random() < 0.5 else run_files.alter)(rng)
        with_hashes = rng.random() < 0.8
        return name, data, lambda: run_files.read(name, data, with_hashes=with_hashes)

    return file


def play_again(places: Places, found: Path) -> None:
    """Reads an input that a corpus keeps, as it was read when it was found."""
    target = max((name for name in SHARES if found.name.startswith(f"{name}-")), key=len)
    label = found.name[len(target) + 1 :].partition("-")[2]
    data = found.read_bytes()
    if target in TARGETS:
        reader(target, places.of_texts())(data)
    elif target == "lines":
        places.play(json.loads(data))
    elif target == "commands":
        places.command_again(label, data)
    else:
        places.run_files(target.removeprefix("run-")).read(label, data, with_hashes=True)


def told(error: BaseException) -> str:
    """What came out, without the numbers that differ each time."""
    return f"{type(error).__name__}: {str(error)[-300:]}"


class Corpus:
    """The folder that keeps finds; the input that is being read lies there too, until it was."""

    def __init__(self, folder: Path, target: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._target = folder, target
        self._now = (folder / f"{target}-last").open("wb")

    def begin(self, data: bytes) -> None:
        """What a process that dies over it leaves."""
        self._now.seek(0)
        self._now.write(data)
        self._now.truncate()
        self._now.flush()

    def keep(self, label: str, data: bytes) -> None:
        """A find."""
        digest = hashlib.blake2b(data, digest_size=6).hexdigest()
        (self._folder / f"{self._target}-{digest}-{label}").write_bytes(data)

    def end(self) -> None:
        """Nothing died."""
        self._now.close()
        Path(self._now.name).unlink()


def run(target: str, inputs: int, sample: Sample, corpus: Corpus) -> dict[str, Any]:
    """Reads so many inputs; what came of them."""
    begun_s, refused = time.process_time(), 0
    found: dict[str, int] = {}
    slowest_s = 0.0
    armed_s = -STUCK_S
    for _ in range(inputs):
        label, data, read = sample()
        corpus.begin(data)
        one_s = time.process_time()
        if time.monotonic() - armed_s > REARMED_S:  # not each time: it starts a thread
            faulthandler.dump_traceback_later(STUCK_S, exit=True)
            armed_s = time.monotonic()
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                read()
        except GamekeeperError:
            refused += 1
        except Exception as error:
            said = told(error)
            if said not in found:
                corpus.keep(label, data)
            found[said] = found.get(said, 0) + 1
        took_s = time.process_time() - one_s
        if took_s > SLOW_S:
            corpus.keep(label, data)
        slowest_s = max(slowest_s, took_s)
    faulthandler.cancel_dump_traceback_later()
    corpus.end()
    return {
        "target": target,
        "inputs": inputs,
        "refused": refused,
        "read": inputs - refused - sum(found.values()),
        "cpu_s": round(time.process_time() - begun_s, 1),
        "slowest_s": round(slowest_s, 2),
        "other_errors": found,
    }


def main() -> int:
    """Plays all targets, each with its share of the inputs."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--inputs", type=int, default=1_000_000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--only", nargs="*", choices=SHARES, default=())
    arguments.add_argument("--each", type=int, help="inputs of each target, whatever its share")
    arguments.add_argument("--corpus", type=Path, default=Path("build/fuzz"))
    asked = arguments.parse_args()
    is_clean = True
    with tempfile.TemporaryDirectory() as folder:
        places = Places(Path(folder))
        for target in asked.only or SHARES:
            # Each target has its own stream, so that it can be played again alone.
            rng = random.Random(f"{asked.seed} {target}")
            inputs = asked.each or max(int(asked.inputs * SHARES[target]), 1)
            done = run(target, inputs, sampler(target, places, rng), Corpus(asked.corpus, target))
            print(json.dumps({**done, "seed": asked.seed}), flush=True)
            is_clean &= not done["other_errors"] and done["slowest_s"] < SLOW_S
    return 0 if is_clean else 1


if __name__ == "__main__":
    sys.exit(main())
