"""The kernel engine: what the serial engine gives over a kernel's environments, from one batch."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.episodes.canonical import to_json
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.vector import make
from gamekeeper.vector.final_rows import FinalRows
from tests.vector import rulebooks, worlds
from tests.vector.test_vector import legal, same

HERE = rulebooks.__file__
PLAIN = {"debug": True}
ENVS = 4
STEPS = 70


def history(venv: Any, steps: int = STEPS) -> list[Any]:
    """All that a vector environment says, step by step, under legal actions."""
    venv.action_space.seed(3)
    found = [venv.reset(seed=11)]
    for step in range(steps):
        found.append(venv.step(legal(found[-1][-1], venv.action_space.sample(), step)))
    return found


def text(value: Any) -> Any:
    """Arrays to the bit, one NaN, dictionaries in any order."""
    if isinstance(value, FinalRows):
        value = np.asarray(value)
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [to_json(part) for part in value]
    return to_json(value)


@pytest.mark.parametrize("infos", [False, True])
@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
@pytest.mark.parametrize("name", ["windy", "camp", "ring", "glide"])
def test_kernel_gives_what_serial_gives(name: str, autoreset: Any, infos: bool) -> None:
    """Every array, every info, ends, joins, final observations, step by step."""
    options: dict[str, Any] = {"autoreset": autoreset, "infos": infos, "env_kwargs": PLAIN}
    with (
        make(f"{HERE}:{name}", ENVS, **options) as serial,
        make(f"{HERE}:{name}", ENVS, engine="kernel", **options) as kernel,
    ):
        assert serial.action_space == kernel.action_space
        finals = 0
        for step, (one, two) in enumerate(zip(history(serial), history(kernel), strict=True)):
            assert one[-1].keys() == two[-1].keys()
            for key, value in one[-1].items():
                assert text(value) == text(two[-1][key]), (step, key)
            for place, (a, b) in enumerate(zip(one[:-1], two[:-1], strict=True)):
                assert same(a, b), (step, place)
            finals += "final_obs" in one[-1]
        assert finals > 3


def test_illegal_action_changes_nothing() -> None:
    """It is named with copy and agent, and the next step goes on from where it was."""
    with make(f"{HERE}:ring", 3, engine="kernel", env_kwargs=PLAIN) as venv:
        _, infos = venv.reset(seed=1)
        actions = infos["action_mask"].argmax(1)
        wrong = actions.copy()
        wrong[2] = infos["action_mask"][2].argmin()
        before = venv._engine._batch.snapshot()
        with pytest.raises(ActionError, match="copy 2, agent 'a'"):
            venv.step(wrong)
        assert before == venv._engine._batch.snapshot()
        venv.step(actions)


@pytest.mark.parametrize("wrong", [1.5, np.nan])
def test_action_out_of_bounds_changes_nothing(wrong: float) -> None:
    """Of a live agent; those of the dead are passed over."""
    with make(f"{HERE}:glide", 3, engine="kernel", env_kwargs=PLAIN) as venv:
        venv.reset(seed=1)
        actions = np.zeros((3, 2, 2), np.float32)
        actions[1, 1, 1] = wrong
        before = venv._engine._batch.snapshot()
        with pytest.raises(ActionError, match="copy 1, agent 'b'"):
            venv.step(actions)
        assert before == venv._engine._batch.snapshot()
        venv._engine.arrays["live"][1, 1] = False
        venv.step(actions)


@pytest.mark.parametrize("spec", [f"{worlds.__file__}:Walk", f"aec:{HERE}:windy"])
def test_environment_without_a_kernel_is_told_so(spec: str) -> None:
    """The fix names the engines that take it."""
    with pytest.raises(SpecError, match=r"no kernel(.|\n)*'serial' or 'process'"):
        make(spec, 2, engine="kernel")


def test_environment_that_is_not_its_kernel_says_why() -> None:
    """A batch would play it otherwise."""
    with pytest.raises(SpecError, match="knob"):
        make("two_robot_line", 2, engine="kernel", env_kwargs={"actuator_slip": 0.5})
