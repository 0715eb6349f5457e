import json
from dataclasses import replace

import numpy as np
import pytest

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.episodes.summary import AgentSummary, Summary
from gamekeeper.reporting.results_text import (
    brief_card,
    divergence_text,
    summary_text,
    table_lines,
    versions_text,
)


def summary_of(agents: int) -> Summary:
    """A summary of a run with this many agents."""
    one = AgentSummary(-12.5, 40.0, None, 0.25, {"battery": 3, "cleared": 17, "terminated": 2})
    return Summary(20, 400, 800, 1.5, {f"picker_{number}": one for number in range(agents)})


def test_summary_has_a_row_for_each_agent() -> None:
    """Return, length, share, idle part and endings stand in columns; unknown is a dash."""
    expected = [
        "  agent      return  length  share  idle  endings",
        "  picker_0  -12.500    40.0      -   25%  battery 3, cleared 17, terminated 2",
        "  return, length in actions: mean over the episodes that the agent was in;",
        "  share: of the team's return over all episodes; idle: share of noops in its",
        "  actions; endings: number of episodes; share -: undefined, as a return is",
        "  negative or their sum is 0",
    ]
    assert summary_text(summary_of(1), width=80).splitlines() == expected


def test_summary_counts_the_agents_that_it_leaves_out() -> None:
    """Of a crowd those furthest from the median come first, the rest is counted, never averaged."""
    crowd = summary_of(200)
    odd = replace(crowd.agents["picker_7"], return_mean=9.0)
    near = replace(odd, return_mean=-12.0)
    crowd = replace(crowd, agents={**crowd.agents, "picker_7": odd, "picker_8": near})
    lines = summary_text(crowd, width=80).splitlines()
    assert lines[1].split()[:2] == ["picker_7", "9.000"]
    assert lines[2].split()[:2] == ["picker_8", "-12.000"]
    assert lines[17].split() == ["184", "others", "-12.500"]
    assert max(map(len, lines)) <= 80


def test_summary_without_agents_says_so() -> None:
    """A run that ended before anybody acted has no empty table."""
    assert summary_text(summary_of(0), width=80) == "  no agent has acted"


@pytest.mark.parametrize("width", [60, 80, 110])
def test_table_keeps_to_its_width(width: int) -> None:
    """The last column is broken under itself where a line would be longer."""
    rows = [("name", "what " * 40), ("longer name", "")]
    lines = list(table_lines(rows, width=width))
    assert max(map(len, lines)) <= width
    assert lines[1].startswith(" " * len("  longer name  what"[:15]))
    assert lines[-1] == "  longer name"


def test_divergence_names_the_place_and_both_values() -> None:
    """The first line is the place; small arrays are shown whole, with their dtype."""
    one, two = np.array([0.0, 1.0]), np.array([0.0, 1.5])
    text = divergence_text(Divergence(3, 7, "picker", "obs.cell", one, two), width=80)
    assert text.splitlines() == [
        "episode 3, turn 7, agent picker: obs.cell",
        "  recorded  float64 [2]: [0.0, 1.0]",
        "  replayed  float64 [2]: [0.0, 1.5]",
    ]


def test_divergence_reads_values_that_came_as_json() -> None:
    """A value that crossed from another process is shown as the value that it was."""
    one = json.loads(to_json(np.array([1, 2], np.int8)))
    text = divergence_text(Divergence(0, None, None, "state", one, None), width=80)
    assert text.splitlines()[1:] == ["  recorded  int8 [2]: [1, 2]", "  replayed  null"]


def test_divergence_of_large_arrays_shows_the_first_element_that_differs() -> None:
    """An image isn't printed: place, both elements and how many differ are."""
    one = np.zeros((40, 30, 3), np.uint8)
    two = one.copy()
    two[3, 5, 1], two[8, 0, 0] = 17, 1
    lines = divergence_text(Divergence(0, 2, "a", "obs", one, two), width=100).splitlines()
    assert lines[1] == "  recorded  uint8 [40, 30, 3] at [3, 5, 1]: 0  (2 of 3,600 elements differ)"
    assert lines[2] == "  replayed  uint8 [40, 30, 3] at [3, 5, 1]: 17"


def test_divergence_in_nan_alone_is_none() -> None:
    """NaN is the same as NaN; where only one side has it, that element is the first."""
    one, two = np.full(20, np.nan), np.full(20, np.nan)
    two[4] = 0.0
    lines = divergence_text(Divergence(0, 2, "a", "obs", one, two), width=100).splitlines()
    assert "at [4]: nan  (1 of 20 elements differ)" in lines[1]


def test_divergence_of_long_texts_shows_where_they_part() -> None:
    """Long values are cut around the first sign in which they differ."""
    one = {"log": "x" * 5_000 + "left" + "y" * 5_000}
    two = {"log": "x" * 5_000 + "right" + "y" * 5_000}
    text = divergence_text(
        Divergence(1, 2, "a", "info", one, two), sides=("runs/a", "runs/b"), width=80
    )
    assert len(text) < 1_000
    assert "xleft" in text.replace("\n", "").replace(" ", "")
    assert "xright" in text.replace("\n", "").replace(" ", "")
    assert "runs/a" in text


def test_control_characters_never_reach_the_terminal() -> None:
    """A name out of a run can't move the cursor or colour the screen."""
    text = divergence_text(Divergence(0, 0, "\033[2Jagent", "obs\033[1m", "\033[31m", 0), width=80)
    assert "\033" not in text


def test_versions_stand_side_by_side() -> None:
    """What differs is named with both versions; nothing is said where nothing differs."""
    assert versions_text({}, width=80) == ""
    text = versions_text({"numpy": ["2.0.0", "2.4.6"], "source": [None, "ab"]}, width=80)
    assert text.splitlines()[1:] == [
        "  numpy   2.0.0 when recorded, 2.4.6 now",
        "  source  none when recorded, ab now",
    ]


def test_brief_card_has_the_sections_of_a_first_look() -> None:
    """Rewards and endings are shown, seeds and knobs are left to the whole card."""
    contract = Contract.parse(
        'api = "aec"\nwhy = "turns"\n'
        '[rewards.met]\nkind = "shared"\nearner = "all"\npayee = "all"\n'
        '[seeds]\ndeterministic = true\n[endings]\nmet = { kind = "termination", owner = "all" }\n'
    )
    text = brief_card(contract, (), name="line_v0", width=80)
    assert text.splitlines()[:2] == ["line_v0 (AEC)", "  turns"]
    assert "Rewards\n  met" in text
    assert "Endings\n  met" in text
    assert "Seeds" not in text
