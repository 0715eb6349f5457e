"""Policies that tests name: one that fails, and many that differ a little, as training runs do."""

from __future__ import annotations

from typing import Any


class Lucky:
    """Plays at random; now and then, as often as its number says, it stands still."""

    def __init__(self, number: int) -> None:
        self.number, self.version = number, f"run {number}"

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """A move, or none."""
        return 0 if rng.random() < 0.05 * self.number else int(rng.integers(3))


def failing(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
    """Raises as soon as it is asked."""
    raise RuntimeError("no idea")


RUNS = [Lucky(number) for number in range(12)]
"""Training runs of one method."""
run_0, run_1, run_2, run_3, run_4, run_5, run_6, run_7, run_8, run_9, run_10, run_11 = RUNS


def names(count: int) -> list[str]:
    """Runs as another process finds them."""
    return [f"tests.evaluate.policies:run_{number}" for number in range(count)]
