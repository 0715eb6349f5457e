import json

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract import Contract, Question
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.reporting.card import card_json, card_text, card_toml

CONTRACT = Contract.parse(
    """
name = "warehouse_v0"
api = "parallel"
why = "all robots move once a tick; the tick resolves their joint action"
[schedule]
stages = [["picker"], ["carrier"]]
order = "none"
observe = "after tick"
conflicts = "joint rule"
horizon = 200
[roles.picker]
agents = "picker_*"
symmetric = true
may_join = true
may_leave = false
noop = 4
mask = "infos.action_mask"
messages = []
[rewards]
after_end = "forbidden"
[rewards.delivery]
kind = "shared"
earner = "carrier"
payee = "all"
[rewards.grasp]
kind = "individual"
earner = "picker"
payee = "earner"
[endings]
battery = { kind = "truncation", owner = "agent" }
cleared = { kind = "termination", owner = "all" }
broken = { kind = "termination", owner = "picker" }
[seeds]
deterministic = true
[infos]
position = { dtype = "int64", shape = [2] }
wall_s = { volatile = true }
[knobs]
sensor_noise = { label = "perception", ideal = 0.0 }
[failure]
team = "deliveries < 3"
[waivers]
GK503 = "battery death is announced one tick late on purpose"
"""
)
BOX = spaces.Box(0, 1, (3,), np.float32)
AGENTS = tuple(
    AgentSpec(
        name=name, role=name.split("_")[0], observation_space=BOX, action_space=spaces.Discrete(5)
    )
    for name in ("picker_0", "picker_1", "picker_2", "carrier_0")
)


def test_card_text_shows_the_whole_game_form():
    """Every declaration is on the card, in words."""
    text = card_text(CONTRACT, AGENTS)
    for line in (
        "warehouse_v0 (Parallel)",
        "  picker_0 to picker_2 (3)  picker   Box(0 to 1, [3], float32)  Discrete(5)",
        "  carrier_0                 carrier  Box(0 to 1, [3], float32)  Discrete(5)",
        "  stages     picker, then carrier",
        "  delivery       earned by carrier, paid to all, each the same",
        "  grasp          earned by picker, paid to the earner",
        "  after the end  rewards are forbidden once an agent has ended",
        "  battery  truncation of one agent",
        "  broken   termination of all agents of role picker",
        "  horizon  after 200 ticks: truncation of all agents",
        "  deterministic  equal seeds and actions give the same rollout",
        "  position  int64, shape [2]",
        "  wall_s    any type, differs between equal runs",
        "  sensor_noise  perception, ideally 0.0",
        "  team  deliveries < 3",
        "  GK503  battery death is announced one tick late on purpose",
    ):
        assert line in text.splitlines()
    for words in ("interchangeable", "may join", "stay until they end", "noop 4"):
        assert words in text


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_card_text_stays_in_its_width(width):
    """No line is wider than asked, whatever is declared, and nothing but text is in it."""
    text = card_text(CONTRACT, AGENTS, width=width)
    assert max(map(len, text.splitlines())) <= width
    assert "\x1b" not in text
    assert not any(line.endswith(" ") for line in text.splitlines())


@given(st.text(max_size=200).filter(str.strip), st.integers(40, 90))
def test_card_text_stays_in_its_width_for_any_words(words, width):
    """Long words and control characters break no line and command no terminal."""
    try:
        contract = Contract(name=words, why=words, waivers={"GK101": words}, roles={words: {}})
    except ValueError:
        return
    specs = [AgentSpec(name=words, role=words, action_space=spaces.Discrete(2))]
    text = card_text(contract, specs, width=width)
    assert max(map(len, text.splitlines())) <= width
    assert all(char.isprintable() or char == "\n" for char in text)
    json.dumps(card_json(contract, specs))


def test_card_asks_what_is_open():
    """What nobody declared is said to be so, with its question and key."""
    text = card_text(CONTRACT, AGENTS)
    asked = open_questions(CONTRACT, AGENTS)
    assert f"Not declared, so not checked ({len(asked)})" in text
    flat = " ".join(text.split())
    assert "which action of role 'carrier' does nothing? -> roles.carrier.noop = N" in flat


def test_card_asks_only_the_questions_it_is_given():
    """The caller may ask more exactly, or nothing."""
    assert "Not declared" not in card_text(CONTRACT, AGENTS, questions=())
    question = Question(("why",), "why so?", '"…"')
    assert 'why so? -> why = "…"' in card_text(CONTRACT, questions=(question,))


def test_card_of_nothing_is_still_a_card():
    """An empty contract and an unknown roster have a card of questions."""
    text = card_text(Contract())
    assert text.startswith("an environment without a name (API not declared)\n")
    assert "Roles" not in text
    assert card_json(Contract())["agents"] == []


def test_card_toml_is_the_contract_with_its_questions():
    """The TOML form reads back equal and carries the questions as comments."""
    text = card_toml(CONTRACT, AGENTS)
    assert Contract.parse(text) == CONTRACT
    assert "# which action of role 'carrier' does nothing? (N in 0 to 4" in text


def test_card_json_is_plain_data_that_holds_the_contract():
    """The JSON form survives a JSON round trip and gives the contract back."""
    data = card_json(CONTRACT, AGENTS)
    assert json.loads(json.dumps(data)) == data
    assert Contract.from_json(data["contract"]) == CONTRACT
    assert data["agents"][0] == {
        "name": "picker_0",
        "role": "picker",
        "observation_space": "Box(0 to 1, [3], float32)",
        "action_space": "Discrete(5)",
    }
    assert {"key", "ask", "answer", "hint", "measured", "why"} == set(data["questions"][0])


@pytest.mark.parametrize(
    ("declared", "row"),
    [
        ("[schedule]\nhorizon = 9", "after 9 ticks: truncation of all agents"),
        (
            "[endings]\nhorizon = { kind = 'truncation', owner = 'agent' }",
            "truncation of one agent",
        ),
        (
            "[schedule]\nhorizon = 9\n[endings]\nhorizon = { kind = 'truncation', owner = 'all' }",
            "after 9 ticks: truncation of all agents",
        ),
    ],
)
def test_card_tells_the_horizon_once(declared: str, row: str) -> None:
    """Scheduled, named as an ending, or both: one row with all that is known of it."""
    card = card_text(Contract.parse(declared), questions=())
    assert card.count("horizon") == 1
    assert row in card
