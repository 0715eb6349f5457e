"""Draws the docs' moving pictures: an episode of each task by its reference policy, as SVG.

    python docs/pictures/tasks.py [--folder docs/pictures/tasks] [TASK ...]

A picture is the scene of the task's contract as the player draws it, with CSS animations: it moves
as an image of a page, stands still where a reader asked for that, and is dark on a dark page.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

TASKS: Final = {
    "warehouse": "reference",
    "foraging": "reference",
    "handover": "reference",
    "pursuit": "reference",
    "robotic_warehouse": "reference",
    "spread": "reference",
    "tag": "reference",
    "reference": "reference",
    "speaker_listener": "reference",
    "warehouse_turns": "reference",
    "two_robot_line": "reference",
    "connect_four": "reference",
    "tictactoe": "reference",
}
SECONDS_A_TURN: Final = 0.35
MOST_TURNS: Final = 60
SIDE: Final = 420
CELL: Final = 40
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#b0578d", "#b87d00", "#2a9fd6", "#6b5b95")
SOLID: Final = ("wall", "rock")
STYLE: Final = """
svg { --ground: #f5f7f9; --line: #d0d7de; --grey: #57606a; --band: #e4e9ee; --ink: #1b1f24; }
@media (prefers-color-scheme: dark) {
  svg { --ground: #1d2329; --line: #3a434d; --grey: #a3adb8; --band: #2a323a; --ink: #e6e9ec; }
}
@media (prefers-reduced-motion: reduce) { * { animation: none !important; } }
text { font: 13px system-ui, sans-serif; fill: var(--grey); text-anchor: middle; }
.move { animation-timing-function: linear; animation-iteration-count: infinite; }
.flash { animation-timing-function: step-end; animation-iteration-count: infinite; }
"""

Point = tuple[float, float]


class Picture:
    """The elements and animations of one episode's scene."""

    def __init__(self, packed: Mapping[str, Any]) -> None:
        """Reads the drawing of a packed episode."""
        self.drawing = packed["drawing"]
        self.scene = self.drawing["scene"]
        self.turns = min(packed["turns"], MOST_TURNS)
        self.rules: list[str] = []
        self.roles = {member["name"]: member["role"] for member in packed["agents"]}
        x0, x1, y0, y1 = self.drawing["extent"]
        is_grid = self.scene["grid"]
        across, up = (x1 - x0 + 1, y1 - y0 + 1) if is_grid else (x1 - x0 or 1, y1 - y0 or 1)
        self.per = min(SIDE / across, SIDE / up, CELL if is_grid else SIDE)
        self.edge = self.per / 2 if is_grid else 16.0
        self.origin = (x0, y0)
        self.width = across * self.per + (0 if is_grid else 2 * self.edge)
        self.height = up * self.per + (0 if is_grid else 2 * self.edge)
        self.radius = max(5.0, min(13.0, self.per * 0.32)) if is_grid else 7.0

    def at(self, x: float, y: float) -> Point:
        """A place of the scene in the picture."""
        down = self.edge + (y - self.origin[1]) * self.per
        return self.edge + (x - self.origin[0]) * self.per, (
            down if self.scene["down"] else self.height - down
        )

    def text(self) -> str:
        """The whole picture."""
        body = [*self._cells(), *self._things(), *self._agents()]
        rules = "\n".join(self.rules)
        size = f"{self.width:.0f} {self.height:.0f}"
        lines = "".join(self._lines())
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" '
            f'width="{self.width:.0f}" height="{self.height:.0f}">\n<style>{STYLE}{rules}</style>\n'
            f'<rect width="100%" height="100%" rx="6" fill="var(--ground)"/>\n{lines}\n'
            + "\n".join(body)
            + "\n</svg>\n"
        )

    def _lines(self) -> Iterator[str]:
        if not self.scene["grid"] or not self.scene["size"]:
            return
        columns, rows = self.scene["size"]
        ways = [f"M{k * self.per:.1f} 0V{self.height:.1f}" for k in range(1, columns)]
        ways += [f"M0 {k * self.per:.1f}H{self.width:.1f}" for k in range(1, rows)]
        yield f'<path d="{"".join(ways)}" stroke="var(--line)" stroke-width=".6" fill="none"/>'

    def _cells(self) -> Iterator[str]:
        for layer in self.scene["cells"]:
            history: dict[int, list[tuple[int, int]]] = {}
            for cell, value in enumerate(layer["base"]):
                history[cell] = [(0, value)]
            for turn, cell, value in layer["changes"]:
                if turn <= self.turns:
                    history[cell].append((turn, value))
            for cell, values in history.items():
                for number, word in layer["values"].items():
                    shown = [(turn, value == int(number)) for turn, value in values]
                    if any(is_shown for _, is_shown in shown):
                        place = self.at(cell % layer["columns"], cell // layer["columns"])
                        yield self._flashing(self._cell(word, *place), shown)

    def _cell(self, word: str, x: float, y: float) -> str:
        if word in self.roles:
            return self._sign(word, x, y)
        half = self.per / 2
        if word == "item":
            side = self.per * 0.3
            return _rectangle(x + half - side - 1, y - half + 1, side, "var(--ink)")
        fill = "var(--grey)" if word in SOLID else "var(--band)"
        found = _rectangle(x - half + 0.5, y - half + 0.5, self.per - 1, fill)
        if word not in SOLID:
            found += f'<text x="{x:.1f}" y="{y + 4.5:.1f}">{escape(word[0].upper())}</text>'
        return found

    def _things(self) -> Iterator[str]:
        for thing in self.scene["things"]:
            letter = escape(thing["name"][0].upper())
            sign = (
                f'<circle r="{self.radius + 2:.1f}" fill="none" stroke="var(--grey)"/>'
                f'<text y="4.5">{letter}</text>'
            )
            yield self._moving(sign, thing["track"])

    def _agents(self) -> Iterator[str]:
        for name, track in self.drawing["tracks"].items():
            sign = self._sign(name, 0, 0)
            carried = self.scene["carries"].get(name)
            if carried:
                side = self.radius * 0.8
                square = _rectangle(-side / 2, -side / 2, side, "var(--ink)")
                values = [(int(turn), bool(value)) for turn, value in carried]
                sign += self._flashing(square, values)
            yield self._moving(f"<g><title>{escape(name)}</title>{sign}</g>", track)

    def _sign(self, name: str, x: float, y: float) -> str:
        """An agent in its colour and its role's shape, as the player has them."""
        names, roles = list(self.roles), list(dict.fromkeys(self.roles.values()))
        colour, r = COLOURS[names.index(name) % len(COLOURS)], self.radius
        is_round = roles.index(self.roles[name]) % 2 == 0
        if len(roles) == 1 and not self.drawing["tracks"]:
            is_round = names.index(name) % 2 == 0  # on a board players differ in shape
        if is_round:
            return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" fill="{colour}"/>'
        return _rectangle(x - r, y - r, 2 * r, colour)

    def _animated(self, kind: str, frames: Sequence[tuple[float, str]], inside: str) -> str:
        """An element whose style goes through frames, each at its part of the episode."""
        name = f"k{len(self.rules)}"
        steps = "".join(f"{100 * part:.2f}%{{{style}}}" for part, style in frames)
        self.rules.append(f"@keyframes {name}{{{steps}}}")
        seconds = (self.turns + 4) * SECONDS_A_TURN
        style = f"{frames[0][1]};animation-name:{name};animation-duration:{seconds:.1f}s"
        return f'<g class="{kind}" style="{style}">{inside}</g>'

    def _part(self, turn: float) -> float:
        return turn / (self.turns + 4)

    def _flashing(self, inside: str, shown: Sequence[tuple[int, bool]]) -> str:
        """What is there at some turns only."""
        if len(shown) == 1:
            return inside if shown[0][1] else ""
        words = {True: "opacity:1", False: "opacity:0"}
        frames = [(self._part(turn), words[is_shown]) for turn, is_shown in shown]
        return self._animated("flash", [*frames, (1.0, frames[-1][1])], inside)

    def _moving(self, inside: str, track: Sequence[Sequence[Any]]) -> str:
        """What moves a way in the last turn before it is elsewhere, and may come and go."""
        track = [each for each in track if each[0] <= self.turns]
        there = [(int(turn), x is not None) for turn, x, _ in track]
        places = [(turn, self.at(x, y)) for turn, x, y in track if x is not None]
        if not places:
            return ""
        frames: list[tuple[float, str]] = []
        before = places[0]
        for turn, place in places:
            style = f"transform:translate({place[0]:.1f}px,{place[1]:.1f}px)"
            if frames and turn - before[0] > 1:
                frames.append((self._part(turn - 1), frames[-1][1]))
            frames.append((self._part(turn) if frames else 0.0, style))
            before = (turn, place)
        moved = self._animated("move", [*frames, (1.0, frames[-1][1])], inside)
        if all(is_there for _, is_there in there):
            return moved
        return self._flashing(moved, [(0, there[0][1]), *there[1:]])


def _rectangle(x: float, y: float, side: float, fill: str) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{side:.1f}" height="{side:.1f}" rx="1.5" '
        f'fill="{fill}"/>'
    )


def picture_of(task: str, policy: str) -> str:
    """The moving picture of a task's episode with seed 0."""
    import gamekeeper as gk
    from gamekeeper.reporting.page.episode_list import packed_of

    run = gk.rollout(task, policies=policy, episodes=1, seed=0)
    return Picture(packed_of(run, 0)).text()


def main() -> None:
    """Writes TASK.svg of each task."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*", default=list(TASKS))
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent / "tasks")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for task in options.tasks:
        text = picture_of(task, TASKS.get(task, "random"))
        (options.folder / f"{task}.svg").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
