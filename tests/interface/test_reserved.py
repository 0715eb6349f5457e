"""An author's own names never take the place of the base's in silence."""

from typing import Any

import pytest

from gamekeeper.errors import ContractError
from gamekeeper.interface.authoring import reserved_names
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.randomness.stream import Stream
from tests.interface.relays import TickRelay, TurnRelay

BASES = pytest.mark.parametrize("base", [TurnRelay, TickRelay])


def test_reserved_names_are_the_base_s_private_ones() -> None:
    """Hooks that an author writes, PettingZoo's names and mangled ones stay free."""
    for base in (TurnEnv, TickEnv):
        names = reserved_names(base)
        assert {"_end", "_enter", "_info_of", "_limit", "_view", "_masks"} <= set(names)
        assert {"observe", "_cumulative_rewards"}.isdisjoint(names)
        assert not [name for name in names if "__" in name]


@BASES
@pytest.mark.parametrize("name", ["_end", "_enter", "_view", "_judge", "_limit", "_masks"])
def test_method_with_a_name_of_the_base_is_refused(base: Any, name: str) -> None:
    """As the class is made, naming the class, the method and what to do."""
    with pytest.raises(ContractError, match=f"Mine has a {name} of its own") as caught:
        type("Mine", (base,), {name: lambda self: None})
    assert f"rename it: {name[1:]}" in caught.value.fix


@BASES
def test_mixin_with_a_name_of_the_base_is_refused(base: Any) -> None:
    """A name that comes in with another class clashes as well, and that class is named."""

    class Show:
        def _absent(self) -> None:
            """Something of the author's."""

    with pytest.raises(ContractError, match="Show has a _absent of its own"):
        type("Mine", (Show, base), {})


@BASES
def test_subclass_of_a_task_is_no_clash(base: Any) -> None:
    """What the base itself puts on a class isn't taken for the author's."""
    first = type("First", (base,), {"mask": lambda self, agent: None})
    second = type("Second", (first,), {"observe": lambda self, agent: base.observe(self, agent)})
    second().reset(seed=0)


@BASES
@pytest.mark.parametrize("name", ["_enter", "_masks", "_limit"])
@pytest.mark.parametrize("where", ["__init__", "start"])
def test_attribute_with_a_name_of_the_base_is_refused(base: Any, name: str, where: str) -> None:
    """In the first reset, whether it was set as the task was built or in the first state."""

    class Mine(base):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            if where == "__init__":
                setattr(self, name, {})

        def start(self, rng: Stream, options: dict[str, Any]) -> None:
            super().start(rng, options)
            if where == "start":
                setattr(self, name, {})

    with pytest.raises(ContractError, match=f"Mine has a {name} of its own"):
        Mine().reset(seed=0)


@BASES
def test_names_are_looked_at_once_for_an_instance(base: Any) -> None:
    """Copies and later episodes go on; own names without a clash are nobody's business."""
    env = base()
    env._mine = 1
    env.reset(seed=0)
    held = env.snapshot()
    env.reset()
    env.restore(held)
    env.reset()
    assert env._mine == 1
