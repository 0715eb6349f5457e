"""Columns are named after who differs from whom; tags don't know about others."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete

from gamekeeper.episodes.layout import Layout, agent_name, group_names, role, spaces_json
from gamekeeper.episodes.spaces import Codec

SMALL, WIDE, TALL = (Codec(Box(0, 1, shape, np.float32)) for shape in ((2,), (3,), (4,)))
ACT = Codec(Discrete(3))


def layout_of(spaces: dict[Any, Codec]) -> Layout:
    """A layout with these agents announced."""
    layout = Layout()
    layout.announce(list(spaces), lambda agent: (spaces[agent], ACT))
    return layout


def names(layout: Layout, agent: Any) -> list[str]:
    """The names of the columns that an agent observes by."""
    side = layout.agents[agent].observation
    assert side is not None
    return [column.name for column in side.columns]


def test_agents_of_one_space_share_plain_columns() -> None:
    """Equal layouts of different space objects too."""
    layout = layout_of({"a_0": SMALL, "a_1": Codec(Box(-5, 5, (2,), np.float32))})
    assert [column.name for column in layout.columns("obs")] == ["obs"]
    assert [column.name for column in layout.columns("action")] == ["action"]


def test_groups_are_named_after_their_own_prefix_else_their_first_agent() -> None:
    """`obs@picker`; `obs@b_0` where the prefix is shared."""
    layout = layout_of({"picker_0": SMALL, "picker_1": SMALL, "carrier_0": WIDE})
    assert names(layout, "picker_1") == ["obs@picker"]
    assert names(layout, "carrier_0") == ["obs@carrier"]
    layout = layout_of({"b_0": SMALL, "b_1": WIDE, "c_0": SMALL})
    assert names(layout, "c_0") == names(layout, "b_0") == ["obs@b_0"]
    assert names(layout, "b_1") == ["obs@b_1"]


def test_leaves_that_groups_share_are_one_column() -> None:
    """Only where a path's leaves differ the group is in the name."""
    with_mask = Codec(Dict({"x": SMALL.space, "m": Discrete(2)}))
    other = Codec(Dict({"x": WIDE.space, "m": Discrete(2)}))
    layout = layout_of({"a_0": with_mask, "b_0": other})
    assert names(layout, "a_0") == ["obs.m", "obs.x@a"]
    assert names(layout, "b_0") == ["obs.m", "obs.x@b"]
    assert [column.tag for column in layout.columns("obs")] == ["obs.m", "obs.x", "obs.x"]


def test_unannounced_agents_get_the_columns_they_fit_else_new_ones() -> None:
    """Columns only grow, and none changes its leaf."""
    layout = layout_of({"a_0": SMALL, "a_1": WIDE})
    before = layout.columns("obs")
    late, tall = (layout.add(*each, ACT).observation for each in (("late", SMALL), ("tall", TALL)))
    assert late is not None
    assert tall is not None
    assert late.columns[0] is before[0]
    assert tall.columns[0].name == "obs@tall"
    assert before == layout.columns("obs")[: len(before)]


def test_agent_that_is_called_like_a_group_gets_a_column_of_its_own() -> None:
    """`picker` beside `picker_0` and `picker_1`, with another space."""
    layout = layout_of({"picker_0": SMALL, "picker_1": SMALL, "carrier_0": WIDE})
    seat = layout.add("picker", TALL, ACT)
    assert seat.observation is not None
    column = seat.observation.columns[0]
    assert column.leaf == TALL.leaves[0]
    assert column.name not in ("obs@picker", "obs@carrier")
    assert len({each.name for each in layout.columns("obs")}) == 3


def test_agents_need_not_be_texts() -> None:
    """Their canonical JSON is their name."""
    layout = layout_of({0: SMALL, ("a", 1): SMALL})
    assert [seat.name for seat in layout.order] == ["0", '{"$":"tuple","v":["a",1]}']


def test_agents_without_a_space_have_a_seat() -> None:
    """Nobody declared them; their values are kept as odd."""
    layout = Layout()
    seat = layout.add("ghost", None, None)
    assert seat.observation is None
    assert spaces_json(layout) == {"ghost": {"observation": None, "action": None}}


@pytest.mark.parametrize(
    ("agent", "name"), [("picker_0", "picker"), ("a_b_12", "a_b"), ("wolf", "wolf"), ("_1", "_1")]
)
def test_role_is_the_name_without_its_number(agent: str, name: str) -> None:
    """What draws no number stays."""
    assert name == role(agent)


def test_group_names_are_distinct() -> None:
    """An agent that has a prefix for its name doesn't take the group's."""
    groups = group_names([("a_0", SMALL), ("a", WIDE), ("b_0", TALL)])
    assert {"a_0", "a", "b"} == set(groups.values())


@pytest.mark.parametrize(("agent", "name"), [("a", "a"), ("", '""'), (3, "3")])
def test_agent_name_is_never_blank(agent: Any, name: str) -> None:
    """What is no text, or an empty one, is named by its JSON."""
    assert agent_name(agent) == name
