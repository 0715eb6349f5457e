"""Base install from a wheel into an empty environment: seconds, megabytes, and the largest parts.

    python benchmarks/installing.py [WHEEL]

WHEEL: what `make dist` built (default: the one in dist/). Prints one JSON line: seconds of
`pip install`, downloads included where pip has kept none; seconds of the environment itself; and
the size of what was installed, as pip compiles it, without pip.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

MEGABYTE = 1_000_000
SHOWN = 5
PIP = ("pip", "setuptools")
"""Packages that are there before the install."""


def size_of(folder: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = [folder] if folder.is_file() else folder.rglob("*")
    return sum(each.stat().st_size for each in files if each.is_file() and not each.is_symlink())


def main() -> None:
    """Installs, measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", nargs="?", help="the wheel (default: dist/*.whl)")
    named = parser.parse_args().wheel
    wheel = Path(named) if named else next(Path("dist").glob("*.whl"))
    with tempfile.TemporaryDirectory() as folder:
        start = time.monotonic()
        builder = venv.EnvBuilder(with_pip=True)
        builder.create(folder)
        made = time.monotonic()
        python = builder.ensure_directories(folder).env_exe
        subprocess.run([python, "-m", "pip", "install", "--quiet", wheel], check=True)
        done = time.monotonic()
        code = "import sysconfig; print(sysconfig.get_path('purelib'))"
        site = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
        sizes = {
            each.name: size_of(each)
            for each in Path(site.stdout.strip()).iterdir()
            if not each.name.startswith(PIP)
        }
    largest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:SHOWN]
    line = {
        "figure": "base install",
        "python": sys.version.split()[0],
        "install_s": round(done - made, 1),
        "venv_s": round(made - start, 1),
        "size_mb": round(sum(sizes.values()) / MEGABYTE),
        "largest_mb": {name: round(sizes[name] / MEGABYTE) for name in largest},
        "load": round(os.getloadavg()[0], 1),
    }
    print(json.dumps(line))


if __name__ == "__main__":
    main()
