"""A learner's first mistake, an action that the mask forbids, is named with the mask and a fix."""

import numpy as np
import pytest

from gamekeeper.adapters.epymarl import multi_agent_env
from gamekeeper.adapters.gymnasium import single_agent
from gamekeeper.errors import ActionError, EnvError
from gamekeeper.vector import make
from tests.vector.doors import SAYS, SPEC, Doors


@pytest.mark.parametrize("engine", ["serial", "process"])
def test_forbidden_action_is_blamed_before_the_environment(engine: str) -> None:
    """The second copy's second agent chooses a closed door in the second step."""
    with make(SPEC, 2, engine=engine, workers=1) as venv:
        venv.reset()
        venv.step(np.ones((2, 2), np.int64))
        with pytest.raises(ActionError, match=SAYS) as caught:
            venv.step(np.array([[1, 2], [2, 0]]))
    assert "env 1" in caught.value.where


def test_environment_is_blamed_where_all_that_was_done_was_allowed() -> None:
    """An action out of its space, or a reset that raises, is no fault of a mask."""

    class Stuck(Doors):
        def reset(self, seed: int | None = None, options: object = None) -> object:
            if hasattr(self, "time") and self.time == 6:
                raise RuntimeError("stuck")
            return super().reset(seed, options)

    with make(Stuck, 1) as venv:
        venv.reset()
        for _ in range(5):
            venv.step(np.ones((1, 2), np.int64))
        with pytest.raises(EnvError, match=r"RuntimeError: stuck"):
            venv.step(np.ones((1, 2), np.int64))


def test_gymnasium_and_epymarl_name_the_mask() -> None:
    """One agent as Gymnasium's environment; in EPyMARL's form the action isn't even handed on."""
    env = single_agent(SPEC, "right", others="random")
    env.reset(seed=0)
    env.step(1)
    with pytest.raises(ActionError, match=SAYS):
        env.step(0)
    whole = multi_agent_env(SPEC, check=None, time_limit=6)
    whole.reset()
    with pytest.raises(ActionError, match=r"(?s)'right'.*one of \[1, 2\].*get_avail_actions"):
        whole.step([1, 0])
