"""A failure condition on what nothing measures is refused by whatever reads it."""

from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.episodes.outcome import failed, outcome_of
from gamekeeper.errors import ContractError, GamekeeperError
from gamekeeper.reporting.page.episode_figures import failing, figures_of
from tests.cli.lines import document, said
from tests.runs.walks import Walk

TERM = '[rewards.caught]\nkind = "individual"\n'
CAUGHT = f'{TERM}[failure]\nteam = "caught < 1"\n'
UNDECLARED = '[failure]\nteam = "return < 0 and caught < 1"\n'
TURN = '[failure]\nteam = "turn < 5"\n'
REFUSED = r"(?s)needs 'caught', which isn't measured.*expected: ending, is_over, length, return"


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes the walk with a contract beside it, and names it."""
    monkeypatch.chdir(tmp_path)
    text = Path(str(__import__("tests.runs.walks", fromlist=["x"]).__file__)).read_text()

    def write(contract: str) -> str:
        (tmp_path / "walk.py").write_text(text)
        (tmp_path / "walk.toml").write_text(contract)
        return "walk.py:Walk"

    return write


@pytest.mark.parametrize("contract", [CAUGHT, UNDECLARED])
def test_rollouts_refuse_after_the_first_episode(contract: str, tmp_path: Path) -> None:
    """In memory and into a folder, with the known names; nothing longer is played."""
    declared = gk.Contract.parse(contract)
    for out in (None, tmp_path / "run"):
        done: list[int] = []
        with pytest.raises(ContractError, match=REFUSED):
            gk.rollout(Walk, contract=declared, episodes=3, out=out, after_episode=done.append)
        assert done == []
    assert gk.load(tmp_path / "run").episode_table.num_rows == 1


def test_what_infos_measure_passes_and_cut_episodes_tell_nothing() -> None:
    """A field that agents are told is a figure; an episode that is cut may miss what ends it."""
    turn, caught = gk.Contract.parse(TURN), gk.Contract.parse(CAUGHT)
    assert gk.rollout(Walk, contract=turn, episodes=2).episode_table.num_rows == 2
    assert gk.rollout(Walk, contract=caught, episodes=2, most_turns=3).episode_table.num_rows == 2


def test_a_declared_term_is_no_zero_where_no_terms_are_told() -> None:
    """The column is there and empty: neither an outcome nor a report counts it as 0."""
    evidence = gk.rollout(Walk, contract=gk.Contract.parse(TERM), episodes=2)
    contract = gk.Contract.parse(CAUGHT)
    with pytest.raises(ContractError, match=REFUSED):
        failed(outcome_of(evidence.episodes[0]), contract.failure, contract)


def test_a_report_says_what_it_cannot_tell() -> None:
    """Episodes without the figure neither failed nor succeeded, and the text names it."""
    evidence = gk.rollout(
        Walk, contract=gk.Contract.parse(CAUGHT), episodes=2, most_turns=3
    )  # cut, so that it was recorded at all
    found, text = failing(evidence, figures_of(evidence))
    assert found == [None, None]
    assert "needs 'caught', which isn't measured; expected: ending, is_over" in text


def test_an_audit_refuses_what_nothing_measures() -> None:
    """The first episode that ends tells; a field of the infos passes."""
    with pytest.raises(ContractError, match=REFUSED):
        gk.audit(Walk, contract=gk.Contract.parse(CAUGHT), budget=300)
    assert gk.audit(Walk, contract=gk.Contract.parse(TURN), budget=300, select=["GK408"]).verdicts


def test_commands_refuse_with_the_known_names(walk: Any, capfd: pytest.CaptureFixture[str]) -> None:
    """`record` and `run` exit with 2; `contract`, which doesn't play, asks what measures it."""
    spec = walk(UNDECLARED)
    for line in (("rollout", spec), ("run", spec), ("rollout", spec, "--workers", "2")):
        code, _, err = said(capfd, *line, "--episodes", "3")
        assert code == 2, line
        assert "needs 'caught', which isn't measured" in err
        assert "return, turn" in err
    code, told = document(capfd, "contract", spec)
    asked = {each["key"]: each for each in told["questions"]}
    assert "failure.team asks for" in str(asked["infos.caught"])
    assert "known are return, length, is_over, ending" in str(asked["infos.caught"])


def test_a_diagnosis_refuses_before_it_plays() -> None:
    """The recorded episodes tell already."""
    evidence = gk.rollout(Walk, episodes=2)
    plays: list[Any] = []
    with pytest.raises(GamekeeperError, match="'caught', 'lost'"):
        gk.diagnose(evidence, failed="caught < 1 or lost > 2", on_message=plays.append)
    assert plays == []
