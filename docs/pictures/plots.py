"""Draws the pictures of docs/plots.md with `gk.plot`, of runs and evaluations made for it.

    python docs/pictures/plots.py [--folder docs/pictures/plots]

Checkpoints of training are played by policies that walk to the middle of a line, and stay where
they are at a rate that falls with the step.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import matplotlib.style
import numpy as np

import gamekeeper as gk

DPI: Final = 100
GROUNDS: Final = ("figure.facecolor", "axes.facecolor", "savefig.facecolor")
DARK: Final = dict.fromkeys(GROUNDS, "#14181c") | {"grid.color": "#3a434d"}
STYLES: Final[dict[str, Any]] = {"light": "default", "dark": ["dark_background", DARK]}
MIDDLE, STAY = 7, 1
RUNS: Final = 12
"""Training runs, as many as the interval of an interquartile mean asks for."""
RATES: Final = {
    "independent": {10_000: 0.8, 20_000: 0.6, 30_000: 0.5, 40_000: 0.45},
    "shared critic": {10_000: 0.7, 20_000: 0.4, 30_000: 0.2, 40_000: 0.1},
}
"""By method and step, how often its policies stay."""
LINE: Final = {"n": 15, "held_out": 1.0}


class Checkpoint:
    """Walks to the middle, but stays at a rate of its run."""

    def __init__(self, rate: float, run: int) -> None:
        """Spreads the rates of runs around that of the method."""
        self.rate = rate * (0.7 + 0.6 * (5 * run % RUNS) / RUNS)
        self.version = f"stays {self.rate}"

    def __call__(self, observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
        """Down, stay or up."""
        cell = int(observation[0])
        return STAY if rng.random() < self.rate else STAY + (cell < MIDDLE) - (cell > MIDDLE)


def training() -> gk.Evaluation:
    """Two methods, each of twelve training runs, at four steps on two lines."""
    spec = {
        "name": "training",
        "environments": {
            "short": {"spec": "two_robot_line", "kwargs": {**LINE, "horizon": 7}, "score": [0, 2]},
            "long": {"spec": "two_robot_line", "kwargs": {**LINE, "horizon": 10}, "score": [0, 2]},
        },
        "policies": {
            f"{name} {step}": {
                "curve": name,
                "step": step,
                "runs": [Checkpoint(rate, run) for run in range(RUNS)],
            }
            for name, rates in RATES.items()
            for step, rate in rates.items()
        },
    }
    return gk.evaluate(spec, episodes=40)


def board() -> gk.Evaluation:
    """Three policies of tictactoe, each in both seats."""
    spec = {
        "name": "board",
        "environments": {"board": {"spec": "tictactoe"}},
        "policies": {name: {"policy": name} for name in ("greedy", "lazy", "random")},
        "crossplay": {"enabled": True},
    }
    return gk.evaluate(spec, episodes=100)


def pictures() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Each picture's name and what draws its axes."""
    evidence = gk.rollout(
        "warehouse", policies={"picker_1": "lazy", "*": "reference"}, episodes=100, seed=0
    )
    yield "returns", lambda: gk.plot.returns(evidence)
    yield "heatmap", lambda: gk.plot.heatmap(evidence)
    yield "places", lambda: gk.plot.heatmap(evidence, of="places")
    trained = training()
    yield "curves", lambda: gk.plot.curves(trained)
    yield "profiles", lambda: gk.plot.profiles(trained)
    yield "intervals", lambda: gk.plot.intervals(trained, environment="short", statistic="iqm")
    played = board()
    yield "crossplay", lambda: gk.plot.crossplay(played)


def main() -> None:
    """Writes two PNGs for each picture, a light and a dark one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent / "plots")
    options = parser.parse_args()
    options.folder.mkdir(exist_ok=True)
    mpl.use("Agg")
    for name, draw in pictures():
        for scheme, style in STYLES.items():
            with mpl.style.context(style):
                draw().figure.savefig(options.folder / f"{name}-{scheme}.png", dpi=DPI)


if __name__ == "__main__":
    main()
