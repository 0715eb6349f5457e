"""Programs of what only an instance shows that was used before."""

from collections.abc import Callable
from typing import Any, Final

from gamekeeper.auditing.holds import Hold


def reset_before(make: Callable[[], Any]) -> Callable[[], Any]:
    """Resets each instance three times before it is handed out."""

    def built() -> Any:
        env = make()
        for seed in range(3):
            env.reset(seed=seed)
        return env

    return built


USED: Final = Hold("an instance that was reset three times before", reset_before)
