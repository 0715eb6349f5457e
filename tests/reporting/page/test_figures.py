"""The sums of a run are those of its episodes, one by one, and failures those of its outcomes."""

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.contract.failure import Failure
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import failed, failures, outcome_of
from gamekeeper.episodes.tables import MemoryTables
from gamekeeper.reporting.page.episode_figures import failing, figures_of
from tests.reporting.page.games import recorded


@pytest.mark.parametrize("spec", ["warehouse", "handover", "aec:connect_four"])
def test_figures_are_those_of_outcomes(spec: str) -> None:
    """Returns, terms and failures of every episode equal those of its outcome."""
    evidence = gk.rollout(spec, episodes=3, seed=1, most_turns=60)
    figures = figures_of(evidence)
    found, _ = failing(evidence, figures)
    conditions = failures(evidence.contract)
    for place, episode in enumerate(evidence.episodes):
        outcome = outcome_of(episode)
        for column, agent in enumerate(figures.agents):
            assert figures.present[place, column] == (agent in outcome.returns)
            if agent in outcome.returns:
                assert outcome.returns[agent] == pytest.approx(figures.returns[place, column])
                for term, value in outcome.terms.get(agent, {}).items():
                    assert value == pytest.approx(figures.terms[term][place, column])
        assert outcome.team_return == pytest.approx(figures.team[place])
        assert any(failed(outcome, conditions, evidence.contract).values()) == found[place]


def test_means_are_those_of_the_summary() -> None:
    """Means over the episodes of an agent are what `gamekeeper rollout` prints."""
    evidence = gk.rollout("warehouse", episodes=4, seed=2)
    figures, summary = figures_of(evidence), evidence.summary
    for column, agent in enumerate(figures.agents):
        mine = figures.present[:, column]
        told = summary.agents[agent]
        assert told.return_mean == pytest.approx(figures.returns[mine, column].mean())
        assert told.length_mean == pytest.approx(figures.lengths[mine, column].mean())


def test_without_a_condition_nothing_is_called_failed() -> None:
    """What isn't declared isn't judged."""
    evidence = recorded(failure=None)
    found, text = failing(evidence, figures_of(evidence))
    assert found == [None, None, None]
    assert "declares no [failure]" in text


def test_a_condition_that_was_given_counts_in_place_of_the_contracts() -> None:
    """A page judges by the condition of its diagnosis, else by the contract's."""
    evidence, declared = recorded(failure=None), recorded(failure="length > 1000")
    found, text = failing(evidence, figures_of(evidence), "length >= 0")
    assert (found, text) == ([True, True, True], "length >= 0")
    assert failing(declared, figures_of(declared), "length >= 0")[0] == [True, True, True]
    assert failing(declared, figures_of(declared))[0] == [False, False, False]


@pytest.mark.parametrize(
    "condition", ["one_0.gain > one_1.gain", "one.return < 11", "ending == 'word'", "length > 9"]
)
def test_failures_are_those_of_the_core(condition: str) -> None:
    """What is read from columns fails by the same conditions as what is read turn by turn."""
    evidence = recorded(failure=condition)
    found, _ = failing(evidence, figures_of(evidence))
    conditions = {"team": Failure(condition)}
    outcomes = [outcome_of(episode) for episode in evidence.episodes]
    expected = [failed(each, conditions, evidence.contract)["team"] for each in outcomes]
    assert expected == found


def test_a_figure_that_nothing_measures_is_told() -> None:
    """A condition that can't be worked out leaves the question open, with the reason."""
    evidence = recorded(failure=None)  # a recording refuses such a condition
    contract = {**evidence.manifest["contract"], "failure": {"team": "apples < 1"}}
    evidence = Evidence({**evidence.manifest, "contract": contract}, evidence.tables)
    found, text = failing(evidence, figures_of(evidence))
    assert found == [None, None, None]
    assert "apples" in text


def test_a_run_without_rows_has_no_figures() -> None:
    """A run that ended before its first turn can be shown."""
    empty = Evidence(recorded(episodes=1).manifest, MemoryTables({}))
    figures = figures_of(empty)
    assert (len(figures.headers), figures.agents) == (0, ())
    assert np.size(figures.team) == 0
