"""Policies that tests name: one that fails, and many that differ a little, as training runs do."""

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


RUNS = {f"run_{number}": Lucky(number) for number in range(30)}
"""Training runs of one method."""
globals().update(RUNS)


def names(count: int) -> list[str]:
    """Runs as another process finds them."""
    return [f"tests.evaluation.policies:run_{number}" for number in range(count)]
