"""Message fields are read as they are written, and lead somewhere or nowhere."""

import pytest
from gymnasium.spaces import Box, Dict, Discrete, Tuple

from gamekeeper.episodes.message_field import MessageField, message_field, path_in
from gamekeeper.errors import ContractError

SPACE = Dict({"word": Discrete(3), "pair": Tuple((Box(0, 1, (4,)), Discrete(2)))})


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("action", MessageField("action")),
        ("observation", MessageField("observation")),
        ("word", MessageField("observation", ("word",))),
        ("observation.pair.0[1:3]", MessageField("observation", ("pair", "0"), slice(1, 3))),
        ("observation[-3:]", MessageField("observation", (), slice(-3, None))),
        ("observation[-1]", MessageField("observation", (), slice(-1, None))),
        ("action[:2]", MessageField("action", (), slice(None, 2))),
    ],
)
def test_message_field_is_read(text: str, field: MessageField) -> None:
    """Side, keys and numbers; what it says of itself reads as the same."""
    assert message_field(text) == field
    assert message_field(str(field)) == field


@pytest.mark.parametrize("text", ["", "observation[", "observation[a]", "a..b", "a b", "[1:2]"])
def test_message_field_of_another_form_is_refused(text: str) -> None:
    """What names no field is an error."""
    with pytest.raises(ContractError, match="no field"):
        message_field(text)


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("observation", ()),
        ("word", ("word",)),
        ("pair.0[1:]", ("pair", 0)),
        ("pair.2", None),
        ("word[0]", None),
        ("word.letter", None),
        ("elsewhere", None),
    ],
)
def test_message_field_leads_to_a_part(text: str, path: tuple[object, ...] | None) -> None:
    """By keys and positions; nowhere where the space hasn't got it."""
    assert path_in(SPACE, message_field(text)) == path
