"""Damaged input: whatever bytes are read, documented errors alone come out of it.

    python benchmarks/fuzz.py [--inputs 1000000] [--seed 0] [--only bundle] [--corpus FOLDER]

Inputs are real ones, damaged: bits flipped, pieces cut out, doubled, moved from one file to
another, numbers and words put in that parsers trip over. Of sealed bundles the hashes are computed
again after the damage, so that it isn't the seal that finds it. An input that brings out anything
but an error of `gamekeeper.errors` is kept in the corpus' folder and printed; the exit code is 1
then. A process that dies, or takes more than two seconds over one input, counts too.

Prints a JSON line for each target: inputs, refused, read, seconds, and what else came out.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import hashlib
import io
import json
import random
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gamekeeper as gk
from gamekeeper.cli._options import json_object
from gamekeeper.core.contract import Contract
from gamekeeper.errors import GamekeeperError
from gamekeeper.game.policy import parse_choices
from gamekeeper.record.files.folder import digest_file
from gamekeeper.record.files.manifest import MANIFEST, manifest_digest, render
from gamekeeper.record.files.notes import read_notes

SLOW_S = 2.0
WORDS = [
    b"", b"\0", b"\n", b"-1", b"0", b"1e999", b"NaN", b"null", b"true", b"[[[[[[[[", b"{" * 64,
    b"..", b"/", b"../../x", b"C:\\x", b"\xff\xfe", b"\xe2\x80\xae", b"9" * 40, b'"', b"'",
    b"\\u0000", b"PAR1", b"ARROW1", (2**31 - 1).to_bytes(4, "little"),
    (2**63 - 1).to_bytes(8, "little"), b"\xff" * 8, b"\x80" * 16,
]  # fmt: skip


def damaged(data: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """One to four damages, one after the other."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(out) + 1)
        size = min(rng.choice((1, 2, 4, 8, 64, 1000)), max(len(out) - at, 0))
        kind = rng.randrange(7)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            out[at : at + size] = b""
        elif kind == 2:
            out[at:at] = out[at : at + size]
        elif kind == 3:
            out[at : at + size] = rng.choice(WORDS)
        elif kind == 4:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            out[at : at + size] = other[start : start + size]
        elif kind == 5:
            del out[at:]
        else:
            out[at : at + size] = rng.randbytes(size)
    return bytes(out)


def reseal(folder: Path, name: str) -> None:
    """Makes a sealed manifest fit what lies there."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_bytes())
        files = manifest["seal"]["files"]
        if name != MANIFEST:
            size, digest = digest_file(folder / name)
            files[name] = {"digest": digest, "size": size}
        manifest["seal"]["manifest"] = manifest_digest(manifest)
        path.write_bytes(render(manifest))
    except Exception:  # the damage was such that nothing can be sealed: it is read as it is
        return


def read_all(folder: Path) -> None:
    """Reads a bundle as every command does."""
    evidence = gk.load(folder)
    evidence.summary.to_json()
    for trace in evidence.traces:
        for turn in trace.turns:
            for name in ("rewards", "infos", "ended", "observations", "actions"):
                getattr(turn, name)
    read_notes(folder)


class Bundle:
    """A bundle in a folder of its own, one file of it damaged."""

    def __init__(self, source: Path, place: Path) -> None:
        self._source, self._folder = source, place / "bundle"
        self._names = sorted(path.name for path in source.iterdir() if path.is_file())
        self._bytes = {name: (source / name).read_bytes() for name in self._names}
        shutil.copytree(source, self._folder)

    def sample(self, rng: random.Random) -> tuple[str, bytes]:
        """A file and what it holds now."""
        name = rng.choice(self._names)
        return name, damaged(self._bytes[name], list(self._bytes.values()), rng)

    def read(self, name: str, data: bytes, *, with_hashes: bool) -> None:
        """Puts the damaged file there, reads, and mends it again."""
        path = self._folder / name
        path.write_bytes(data)
        try:
            if with_hashes:
                reseal(self._folder, name)
            read_all(self._folder)
        finally:
            path.write_bytes(self._bytes[name])
            (self._folder / MANIFEST).write_bytes(self._bytes[MANIFEST])


def texts(target: str) -> list[bytes]:
    """Real inputs of a parser of texts."""
    root = Path(gk.__file__).parent
    if target == "contract":
        return [path.read_bytes() for path in sorted((root / "envs").glob("*.toml"))]
    if target == "spec":
        return [path.read_bytes() for path in sorted((root / "evaluate").glob("suites/*.toml"))]
    if target == "condition":
        return [
            b"return < 0.5",
            b"deliveries >= 3 and not is_over",
            b"picker.grasp == 'lost' or length > 20",
        ]
    return [
        b"random",
        b"picker=reference",
        b"a=module:callable",
        b'{"n": 3, "x": [1, {"y": null}]}',
    ]


def parser(target: str) -> Callable[[bytes], Any]:
    """What reads an input of a target; bytes that are no text are replaced."""
    from gamekeeper.core.contract.failure import Failure

    def text(data: bytes) -> str:
        return data.decode("utf-8", "replace")

    if target == "contract":
        return lambda data: Contract.parse(text(data), source="fuzz.toml")
    if target == "spec":
        from gamekeeper.evaluate.reading import read_spec

        return lambda data: read_spec(_toml(text(data)), source="fuzz.toml")
    if target == "condition":
        return lambda data: Failure(text(data)).holds({"return": 0.0, "length": 3.0})
    return lambda data: (
        _refusing(parse_choices, [text(data)]),
        json_object(text(data), option="--kwargs"),
    )


def _toml(text: str) -> Any:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise GamekeeperError("not TOML") from error


def _refusing(read: Callable[..., Any], *arguments: Any) -> None:
    with contextlib.suppress(GamekeeperError):
        read(*arguments)


def make_bundles(place: Path) -> dict[str, Path]:
    """Small bundles of several kinds: both APIs, both levels, images, infos, one still open."""
    made = {}
    for name, spec, options in (
        ("line", "two_robot_line", {}),
        ("turns", "handover", {"level": "digest"}),
        ("games", "tictactoe", {}),
    ):
        made[name] = place / f"source-{name}"
        gk.rollout(spec, episodes=2, seed=1, out=made[name], most_turns=6, **options)
    made["open"] = place / "source-open"
    opened = gk.record(gk.make("two_robot_line"), place / "recording")
    opened.reset(seed=0)
    for _ in range(3):
        opened.step({agent: opened.action_space(agent).sample() for agent in opened.agents})
    time.sleep(0.2)  # until the recorder's thread has written
    shutil.copytree(place / "recording", made["open"])
    opened.close()
    return made


def told(error: BaseException) -> str:
    """What came out, without the numbers that differ each time."""
    return f"{type(error).__name__}: {str(error)[:120]}"


def run(
    name: str,
    inputs: int,
    rng: random.Random,
    sample: Callable[[], tuple[str, bytes, Callable[[], Any]]],
    corpus: Path,
) -> bool:
    """Reads so many inputs and prints a line; whether nothing came out but documented errors."""
    begun_s, refused, found = time.monotonic(), 0, {}
    slowest_s = 0.0
    for _ in range(inputs):
        label, data, read = sample()
        one_s = time.monotonic()
        faulthandler.dump_traceback_later(30, exit=True)
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                read()
        except GamekeeperError:
            refused += 1
        except Exception as error:
            said = told(error)
            if said not in found:
                digest = hashlib.blake2b(data, digest_size=8).hexdigest()
                corpus.mkdir(parents=True, exist_ok=True)
                (corpus / f"{name}-{digest}-{label}").write_bytes(data)
            found[said] = found.get(said, 0) + 1
        slowest_s = max(slowest_s, time.monotonic() - one_s)
    faulthandler.cancel_dump_traceback_later()
    seconds = time.monotonic() - begun_s
    told_of = {
        "target": name, "inputs": inputs, "refused": refused,
        "read": inputs - refused - sum(found.values()), "seconds": round(seconds, 1),
        "slowest_s": round(slowest_s, 2), "other_errors": found,
    }  # fmt: skip
    print(json.dumps(told_of), flush=True)
    return not found and slowest_s < SLOW_S


def main() -> int:
    """Plays all targets, each with its share of the inputs."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--inputs", type=int, default=1_000_000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--only")
    arguments.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    asked = arguments.parse_args()
    rng = random.Random(asked.seed)
    is_clean = True
    with tempfile.TemporaryDirectory() as place:
        sources = make_bundles(Path(place))
        shares = {"contract": 0.3, "spec": 0.2, "condition": 0.2, "options": 0.15}
        shares |= dict.fromkeys((f"bundle-{name}" for name in sources), 0.15 / len(sources))
        for target, share in shares.items():
            if asked.only and not target.startswith(asked.only):
                continue
            if target.startswith("bundle-"):
                kind = target.removeprefix("bundle-")
                home = Path(place) / f"work-{kind}"
                home.mkdir()
                bundle = Bundle(sources[kind], home)

                def sample(bundle: Bundle = bundle) -> tuple[str, bytes, Callable[[], Any]]:
                    name, data = bundle.sample(rng)
                    with_hashes = rng.random() < 0.8
                    return name, data, lambda: bundle.read(name, data, with_hashes=with_hashes)

            else:
                inputs, read = texts(target), parser(target)

                def sample(
                    inputs: list[bytes] = inputs, read: Callable[[bytes], Any] = read
                ) -> tuple[str, bytes, Callable[[], Any]]:
                    data = damaged(rng.choice(inputs), inputs, rng)
                    return "text", data, lambda: read(data)

            is_clean &= run(target, max(int(asked.inputs * share), 1), rng, sample, asked.corpus)
    return 0 if is_clean else 1


if __name__ == "__main__":
    sys.exit(main())
