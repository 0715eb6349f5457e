"""Each trainer from nothing: its environment, its version, its example with seeds, what it keeps.

For every list in requirements/trainers: a fresh virtual environment, its packages (locked ones
where there is a lock), seconds and MB of both, the trainer's version; then `examples/NAME_*.py`
with each seed, one by one, and in Tianshou's environment the examples that need torch alone; with a
checkout of EPyMARL (`--epymarl epymarl/src`) its example too.
What is kept and lost stands in the docstrings of the adapter, and is taken from there.

    python benchmarks/trainers.py --only sb3 [--examples sb3_own] [--seeds 0 1 2] [--quick]

One JSON line a run and one a trainer, {"figure", "trainer", "version", "mb", "seconds", "examples",
"kept", "changed", "lost", "refused"}; after the last the rows of docs/trainers.md. Several
gigabytes with torch, and minutes for each example and seed.
"""

import argparse
import ast
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

FIGURE: Final = "trainers"
ROOT: Final = Path(__file__).parent.parent
LISTS: Final = ROOT / "requirements" / "trainers"
ADAPTERS: Final = ROOT / "src" / "gamekeeper" / "adapters"
DISTRIBUTION: Final = {"sb3": "stable-baselines3", "rllib": "ray", "rerun": "rerun-sdk"}
"""What a trainer is called on the index, where its list is called otherwise."""
TORCH_ALONE: Final = ("mappo_warehouse", "ppo_parallel", "selfplay_connect_four")
WAYS: Final = {"sb3_own": (["--way", "dict"], ["--way", "image"])}
"""Arguments of an example that is run in more than one way."""
FIELDS: Final = ("kept", "changed", "lost", "refused")


def names() -> list[str]:
    """Trainers that have a list of packages; Ray alone is an executor."""
    return sorted(path.stem for path in LISTS.glob("*.in") if path.stem != "ray")


def tables(name: str) -> dict[str, list[str]]:
    """The tables in the docstrings of an adapter: by row, one text for each function."""
    files = [ADAPTERS / f"{name}.py", *sorted((ADAPTERS / name).glob("*.py"))]
    found: dict[str, list[str]] = {field: [] for field in FIELDS}
    for path in files:
        if not path.exists():
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef):
                continue
            for line in (ast.get_docstring(node) or "").splitlines():
                cells = [cell.strip() for cell in line.split("|")]
                if len(cells) == 4 and cells[1] in found:
                    found[cells[1]].append(cells[2])
    return found


def installed(name: str, folder: Path) -> dict[str, Any]:
    """A fresh environment with what the list says; its size, how long it took, the version."""
    lock = LISTS / f"{name}.txt"
    wanted = lock if lock.exists() else lock.with_suffix(".in")
    setup, venv = ROOT / "requirements" / "setup.sh", folder / name
    began_s = time.perf_counter()
    for step in (("make", str(venv)), ("install", str(venv), str(wanted))):
        subprocess.run(["sh", str(setup), *step], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - began_s
    asked = f"import importlib.metadata as m; print(m.version({DISTRIBUTION.get(name, name)!r}))"
    told = subprocess.run(
        [str(venv / "bin" / "python"), "-c", asked], capture_output=True, text=True, check=True
    )
    files = (path for path in venv.rglob("*") if path.is_file() and not path.is_symlink())
    size = sum(path.stat().st_size for path in files)
    return {"version": told.stdout.strip(), "mb": round(size / 1e6), "seconds": round(seconds)}


def commands(name: str, only: list[str] | None, epymarl: Path | None) -> list[list[str]]:
    """Examples, with arguments, that are run in a trainer's environment; `only`: of these names."""
    folder = ROOT / "examples"
    found = [
        [str(path), *way] for path in sorted(folder.glob(f"{name}_*.py")) for way in ways(path)
    ]
    if name == "tianshou":
        found += [[str(folder / f"{example}.py")] for example in TORCH_ALONE]
        found += [[str(folder / "epymarl_own.py"), str(epymarl)]] if epymarl else []
    return [command for command in found if only is None or Path(command[0]).stem in only]


def ways(script: Path) -> tuple[list[str], ...]:
    """Arguments of each way in which an example is run."""
    return WAYS.get(script.stem, ([],))


def examples(
    found: list[list[str]], python: Path, seeds: list[int], *, quick: bool
) -> Iterator[dict[str, Any]]:
    """What each of these examples prints last, seed by seed; `error` where it prints nothing."""
    for script in found:
        for seed in seeds:
            command = [str(python), *script, "--seed", str(seed)] + ["--quick"] * quick
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
            if lines:
                yield json.loads(lines[-1])
            else:
                yield {"example": Path(script[0]).stem, "seed": seed, "error": done.stderr[-500:]}


def reached(one: dict[str, Any]) -> str:
    """What one run of an example reached."""
    told = f"seed {one['seed']}"
    if one.get("interval"):
        told = f"{one['interval'][0]:g} to {one['interval'][1]:g}, {told}"
    replayed = {None: "", True: ", replayed", False: ", not replayed"}[one.get("replayed")]
    return f"{figure(one['result'])} ({told}{replayed})"


def figure(value: float | dict[str, float]) -> str:
    """A number, or one for each opponent."""
    if isinstance(value, dict):
        return " and ".join(f"{each:g} against {name}" for name, each in value.items())
    return f"{value:g}"


def row(found: dict[str, Any]) -> str:
    """A trainer's row of docs/trainers.md."""
    by_example: dict[str, list[dict[str, Any]]] = {}
    for one in found["examples"]:
        by_example.setdefault(" ".join([one["example"], one.get("way", "")]).strip(), []).append(
            one
        )
    results = []
    for name, runs in by_example.items():
        good = [one for one in runs if "result" in one]
        if not good:
            results.append(f"`{name}`: didn't run")
            continue
        values, about = ", ".join(map(reached, good)), good[0]
        results.append(f"`{name}`, {about['measure']}: {values}; wanted {figure(about['wanted'])}")
    cells = [
        f"{found['trainer']} {found['version']}",
        f"{found['mb']:,} MB, {found['seconds']} s",
        *("; ".join(found[field][:1]) for field in ("kept", "lost")),
        "; ".join(results),
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Measures the trainers that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=names(), default=names())
    parser.add_argument("--examples", nargs="+", help="of these names alone; default all")
    parser.add_argument("--epymarl", type=Path, help="the folder src of a checkout of EPyMARL")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--quick", action="store_true", help="examples take a few steps")
    parser.add_argument("--keep", type=Path, help="where the environments stay")
    given = parser.parse_args()
    rows = []
    for name in given.only:
        with tempfile.TemporaryDirectory() as scratch:  # gigabytes, so one at a time
            folder = given.keep or Path(scratch)
            found = {"figure": FIGURE, "trainer": name, **installed(name, folder), "examples": []}
            python, runs = (
                folder / name / "bin" / "python",
                commands(name, given.examples, given.epymarl),
            )
            for one in examples(runs, python, given.seeds, quick=given.quick):
                print(json.dumps({"figure": FIGURE, **one}), flush=True)
                found["examples"].append(one)
        found |= tables(name)
        print(json.dumps(found), flush=True)
        rows.append(row(found))
    print("\n| trainer | installed | kept | lost | its example |\n|---|---|---|---|---|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
