"""Size and time of a base installation: the wheel and what it requires, in an empty environment.

    make dist && python benchmarks/installing.py [dist/*.whl]

Prints one JSON line: seconds of `pip install` (downloads included, unless pip's cache has them),
megabytes that it adds to the environment, the largest packages, and what `gamekeeper --version`
says there. It needs an index.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from time import perf_counter

MEGABYTE = 1_000_000


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(each.stat().st_size for each in folder.rglob("*") if each.is_file())


def main() -> None:
    """Installs, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", nargs="?", type=Path, help="the wheel (default: that in dist/)")
    wheel = parser.parse_args().wheel or next(Path("dist").glob("*.whl"))
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        venv.create(home, with_pip=True)
        before = size_of(home)
        python = home / "bin" / "python"
        start = perf_counter()
        subprocess.run(
            [python, "-m", "pip", "install", "--quiet", wheel.resolve()], check=True, cwd=home
        )
        seconds = perf_counter() - start
        added = size_of(home) - before
        site = next((home / "lib").glob("python*/site-packages"))
        parts = {each.name: size_of(each) for each in site.iterdir() if each.is_dir()}
        said = subprocess.run(
            [home / "bin" / "gamekeeper", "--version"], check=True, capture_output=True, text=True
        )
    largest = sorted(parts.items(), key=lambda pair: -pair[1])[:6]
    line = {
        "figure": "base installation",
        "seconds": round(seconds, 1),
        "megabytes": round(added / MEGABYTE),
        "largest_mb": {name: round(size / MEGABYTE) for name, size in largest},
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "version": said.stdout.strip(),
    }
    print(json.dumps(line))


if __name__ == "__main__":
    main()
