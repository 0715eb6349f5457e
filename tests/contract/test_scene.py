"""A scene is data: read, written and refused as the rest of a contract is."""

import pytest

from gamekeeper.contract import Contract
from gamekeeper.errors import ContractError

TEXT = """
[scene]
kind = "grid"
size = ["columns", 9]
arguments = { columns = 11 }
unless = ["layout"]
agents = { picker = { source = "infos.position", x = 0, y = 1 } }
cells = { floor = { last = 2, values = { wall = 1 } } }
actions = { all = ["north", "stay"] }
"""


def test_scene_is_read_and_written() -> None:
    """Written as TOML it reads back to an equal contract; a role without names has those of all."""
    contract = Contract.parse(TEXT)
    assert contract == Contract.parse(contract.to_toml())
    assert contract == Contract.from_json(contract.to_json())
    assert contract.scene.actions_of("picker") == ("north", "stay")


def test_scene_that_is_not_declared_is_not_written() -> None:
    """A contract without one is as it was."""
    assert "scene" not in Contract(name="a").to_json()


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ('kind = "round"', "round"),
        ('agents = { all = { source = "memory" } }', "memory"),
        ("cells = { floor = { last = 1 } }", "values"),
        ("colour = 3", "colour"),
    ],
)
def test_scene_names_its_mistakes(line: str, word: str) -> None:
    """A key that isn't there, or a value of another kind, is refused with its place."""
    with pytest.raises(ContractError, match=word) as error:
        Contract.parse(f"[scene]\n{line}\n")
    assert "line 2" in str(error.value)
