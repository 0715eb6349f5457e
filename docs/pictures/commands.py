"""Draws what commands print in a terminal of 80 columns, as SVG: the pictures of their reference.

    python docs/pictures/commands.py [--folder docs/pictures/commands]

Every command is typed in one empty folder, in an order in which each finds what it needs.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from html import escape
from pathlib import Path
from typing import Final

FIRST, LAST = 22, 4
"""Lines of a picture of a longer output."""
TYPED: Final = (
    "run two_robot_line --policy reference --out runs/first",
    "new my-task",
    "audit two_robot_line --quick",
    "explain GK402",
    "list envs",
    "contract two_robot_line",
    "rollout two_robot_line --policy reference --policy picker=noop --episodes 20 --out runs/stuck",
    "replay runs/stuck",
    "label runs/stuck planning --agent picker --why 'it never moves' --by reviewer",
    "diff runs/first runs/stuck",
    "verify runs/stuck",
    "recover runs/stuck",
    "diagnose runs/stuck --episodes 300 --workers 0",
    "pivots runs/stuck --episode 0 --budget 3000",
    "attribute runs/stuck --episodes 20 --action-episodes 10",
    "evaluate two_robot_line --policy reference --policy random",
    "report runs/stuck --out stuck.html",
    "view runs/stuck --no-browser --port 8765",
    "resume runs/stuck --episode 0 --turn 3",
    "rollout my_task/src/my_task/env.py:MyTask --policy reference --episodes 3 --out runs/mine",
    "bisect runs/mine --repo my_task",
    "show runs/stuck",
    'query runs/stuck "SELECT agent, max(return) FROM returns GROUP BY 1"',
    "video runs/stuck --render --out stuck.mp4",
    "export runs/stuck --to numpy --out stuck.npz",
    "rollout two_robot_line --level actions --episodes 3 --out runs/small",
    "expand runs/small runs/whole",
    "pack runs/first --out claim",
    "reproduce claim",
)
COMMIT: Final = "git -C my_task -c user.name=me -c user.email=me commit -qam"
AROUND: Final = {
    "view": "timeout -s INT 20 {} | sed 's/token=.*/token=.../'",
    "resume": "printf 'env.agents\nobservations\n' | {} 2>&1",
    "bisect": f"(cd my_task; git init -q; git add .); {COMMIT} rules; "
    f"echo >> my_task/README.md; {COMMIT} words; "
    f"sed -i 's/each, 1.0/each, 2.0/' my_task/src/my_task/env.py; {COMMIT} 'pay twice'; "
    f"echo >> my_task/README.md; {COMMIT} 'more words'; {{}}",
}
"""What the shell does around a command that needs it: a console, an end, commits."""
STYLE: Final = """
svg { --ground: #f5f7f9; --ink: #1b1f24; --typed: #0b5cad; }
@media (prefers-color-scheme: dark) {
  svg { --ground: #1d2329; --ink: #e6e9ec; --typed: #6cb6ff; }
}
rect { fill: var(--ground); }
text { font: 13px ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace;
       fill: var(--ink); white-space: pre; }
.typed { fill: var(--typed); }
"""


def picture(command: str, output: str) -> str:
    """A terminal with a command and the first lines of its output."""
    every = output.strip("\n").splitlines()
    lines = every if len(every) <= FIRST + LAST else [*every[:FIRST], "...", *every[-LAST:]]
    height = 17 * (len(lines) + 1) + 20
    texts = [f'<text class="typed" x="12" y="24">$ gamekeeper {escape(command)}</text>']
    texts += [
        f'<text x="12" y="{24 + 17 * place}">{escape(line)}</text>'
        for place, line in enumerate(lines, start=1)
    ]
    longest = max(map(len, [f"$ gamekeeper {command}", *lines]))
    width = max(660, 8 * longest + 24)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}">'
        f'<style>{STYLE}</style><rect width="{width}" height="{height}" rx="6"/>'
        f"{''.join(texts)}</svg>\n"
    )


def main() -> None:
    """Types all commands and writes a picture for each; names those that didn't go well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("docs/pictures/commands"))
    parser.add_argument(
        "--only", nargs="*", default=[], help="commands that are typed (default: all)"
    )
    given = parser.parse_args()
    folder, needed = given.folder.resolve(), {*given.only, "run", "new", "rollout"}
    folder.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    around = {**os.environ, "PATH": path, "COLUMNS": "80", "PYTHONIOENCODING": "utf-8"}
    with tempfile.TemporaryDirectory() as here:
        for command in TYPED:
            name = command.split()[0]
            if given.only and name not in needed:
                continue
            done = subprocess.run(
                AROUND.get(name, "{}").format(f"gamekeeper {command}"),
                shell=True,
                cwd=here,
                env=around,
                capture_output=True,
                text=True,
                check=False,
            )
            sys.stdout.write(f"{name}: exit code {done.returncode}\n")
            if done.returncode == 2 and not done.stdout:
                sys.stderr.write(done.stderr)
            elif name != "rollout" or "stuck" in command:
                (folder / f"{name}.svg").write_text(picture(command, done.stdout), encoding="utf-8")


if __name__ == "__main__":
    main()
