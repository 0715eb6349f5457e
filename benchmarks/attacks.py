"""Attacks on evidence, on consent, on whoever records and on the viewer: tried, and survived.

Each attack is one command in a fresh copy of a few runs, prepared as an attacker would prepare them
(`attacking/`). It is survived if all of this holds:

    code    the exit code is one of those that are right
    quiet   no traceback of ours, no "fault of gamekeeper", no control character in what is said
    kept    no file outside of the named output was written, changed or removed
    unrun   no code ran that nobody allowed to run
    finalized  (of what is recorded) the run verifies; where the environment failed, its status
    says so gone    (of what starts daemons) no process is left

One JSON line a kind of attack: {"figure": "attacks", "kind", "tried", "survived"}; what didn't
hold goes to stderr, and the exit code is 1 then. Kinds: `query` (SQL that writes), `consent` (code
beside evidence), `forged` (evidence changed, its hashes made to fit), `notes` (annotations
changed), `hostile` (environments that attack whoever records them), `viewer`.

    python benchmarks/attacks.py [--kind query ...] [--only WORD]
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.attacking import evidence, hostile, viewer
from benchmarks.attacking.attack import MARK, Attack, Found
from gamekeeper.diagnosis.labels import label
from gamekeeper.runs.recording import rollout

TIMEOUT_S: Final = 300.0
KINDS: Final = {**evidence.KINDS, **hostile.KINDS, **viewer.KINDS}


def main() -> int:
    """Tries all attacks, or those that are asked for; 1 if one wasn't survived."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--only", default="", help="attacks whose name has this word")
    given = parser.parse_args()
    is_whole = True
    with tempfile.TemporaryDirectory(prefix="attacks-") as folder:
        base = Path(folder)
        make_ready(base / "ready")
        for kind in given.kind or KINDS:
            attacks = [each for each in KINDS[kind]() if given.only in each.name]
            lost = [each.name for each in attacks if not survives(each, base)]
            figures = {"kind": kind, "tried": len(attacks), "survived": len(attacks) - len(lost)}
            print(json.dumps({"figure": "attacks", **figures}), flush=True)
            is_whole = is_whole and not lost
    return 0 if is_whole else 1


def make_ready(folder: Path) -> None:
    """The runs that are attacked."""
    rollout("two_robot_line", episodes=2, seed=0, out=folder / "line")
    for why in ("first", "second"):
        label(folder / "line", "planning", episode=0, why=why)


def survives(attack: Attack, base: Path) -> bool:
    """Whether an attack comes to nothing; what didn't hold goes to stderr."""
    work = base / "work"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(base / "ready", work)
    attack.prepare(work)
    before = contents(work)
    found = attack.act(work) if attack.act else command(attack, work)
    wrong = {
        "code": found.code in attack.codes,
        "quiet": is_quiet(found.said),
        "passed": strays(before, contents(work), attack.out) == [],
        "unrun": not (work.parent / MARK).exists(),
        **attack.more(work, found),
    }
    (work.parent / MARK).unlink(missing_ok=True)
    broken = [name for name, holds in wrong.items() if not holds]
    if broken:
        where = strays(before, contents(work), attack.out)
        sys.stderr.write(f"{attack.name}: not {broken}, code {found.code}, {where}\n")
        sys.stderr.write(f"{found.said[-1500:]}\n")
    return not broken


def command(attack: Attack, work: Path) -> Found:
    """Runs the attack's command line, as a shell starts it."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parents[1] / "src"), *sys.path]))
    surroundings = {**os.environ, "PYTHONPATH": path, "HOME": str(work), **attack.variables}
    try:
        done = subprocess.run(
            [sys.executable, *attack.flags, "-m", "gamekeeper", *attack.words],
            cwd=work / attack.cwd,
            env=surroundings,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return Found(-1, f"not done after {TIMEOUT_S} s\n{error.output!r}")
    return Found(done.returncode, done.stdout.decode(errors="surrogateescape"))


def is_quiet(said: str) -> bool:
    """Whether a terminal can show what was said, and it is no fault of ours."""
    steers = any((ord(sign) < 32 and sign not in "\n\t") or 127 <= ord(sign) < 160 for sign in said)
    return not steers and "fault of gamekeeper" not in said


def contents(folder: Path) -> dict[str, str]:
    """Digests of all that lies in a folder, but for what Python and Gamekeeper cache."""
    return {
        str(path.relative_to(folder)): _digest(path)
        for path in sorted(folder.rglob("*"))
        if not {"__pycache__", ".cache", ".local"} & set(path.relative_to(folder).parts)
    }


def strays(before: Mapping[str, str], after: Mapping[str, str], out: Sequence[str]) -> list[str]:
    """What came, went or changed outside of the named outputs."""
    changed = [name for name in before.keys() | after.keys() if before.get(name) != after.get(name)]
    return sorted(name for name in changed if not any(f"{name}/".startswith(f"{o}/") for o in out))


def _digest(path: Path) -> str:
    if path.is_symlink() or not path.is_file():
        return f"{path.lstat().st_mode}"
    return hashlib.blake2b(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
