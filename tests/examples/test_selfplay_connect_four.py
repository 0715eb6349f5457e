"""The example that plays itself: whose moves are learnt, what they earned, and that it replays."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk

pytestmark = pytest.mark.trainer


@pytest.fixture
def selfplay() -> Any:
    """The example, which imports torch."""
    pytest.importorskip("torch", reason="it learns with torch")
    from examples import selfplay_connect_four

    return selfplay_connect_four


def few(selfplay: Any, **given: Any) -> Any:
    """Settings of a short run in plain Python."""
    return selfplay.Args(engine="serial", games=6, length=60, moves=1_000, **given)


def test_every_move_has_what_its_player_got_in_the_end(selfplay: Any) -> None:
    """Undiscounted and with lambda 1: 1 of who won, -1 of who lost, whoever moved last."""
    args = replace(few(selfplay), gae_lambda=1.0, discount=1.0, weak=0.0, opening=0)
    moves = selfplay.SelfPlay(args, 0).play()
    env, looked = gk.make("connect_four"), {1.0: 0, -1.0: 0}
    for game in range(args.games):
        env.reset(seed=0)
        players: list[str] = []
        for t in range(args.length):
            players.append(env.agent_selection)
            env.step(int(moves.columns[t, game]))
            if not any(env.terminations.values()):
                continue
            for before, player in enumerate(reversed(players)):
                earned = float(env.rewards[player])
                assert moves.learnt[t - before, game]
                assert float(moves.returns[t - before, game]) == pytest.approx(earned, abs=1e-5)
                looked[earned] = looked.get(earned, 0) + 1
            env.reset(seed=0)
            players = []
        assert not moves.learnt[-1, game] or not players  # its sequel isn't known
    assert looked[1.0] > 20 < looked[-1.0]


def test_boards_are_seen_from_the_side_that_moves(selfplay: Any) -> None:
    """Both have as many tokens, or the other has one more; closed columns aren't chosen."""
    moves = selfplay.SelfPlay(few(selfplay), 1).play()
    own, other = moves.boards.sum((2, 3)).unbind(-1)
    assert {int(ahead) for ahead in (other - own).unique()} == {0, 1}
    assert moves.masks.gather(-1, moves.columns[..., None]).min() == 1


def test_only_own_choices_are_learnt(selfplay: Any) -> None:
    """Neither tokens that fell anywhere as a game began, nor those of weak sides."""
    learner = selfplay.SelfPlay(few(selfplay, opening=0, weak=1.0), 0)
    weak = learner.slips.reshape(-1, 2) > 0
    assert (weak.sum(1) == 1).all()
    learner.args = replace(learner.args, length=6)
    moves = learner.play()
    for t in range(4):
        np.testing.assert_array_equal(moves.learnt[t].numpy(), ~weak[:, t % 2])
    learner = selfplay.SelfPlay(few(selfplay, opening=4, weak=0.0), 0)
    opening = learner.opening.copy()
    learner.args = replace(learner.args, length=8)
    moves = learner.play()
    assert len(set(opening)) > 1
    for t in range(6):
        np.testing.assert_array_equal(moves.learnt[t].numpy(), t >= opening)


def test_run_learns_the_same_on_every_engine(selfplay: Any) -> None:
    """The same weights from one game at a time and from a batch, and others from another seed."""
    found = []
    for engine, seed in (("serial", 0), ("kernel", 0), ("kernel", 1)):
        learner = selfplay.SelfPlay(replace(few(selfplay), engine=engine, length=40), seed)
        told = [learner.update() for _ in range(2)]
        assert np.isfinite([list(one.values()) for one in told]).all()
        found.append(selfplay.Learnt(learner.network).version)
    assert found[0] == found[1] != found[2]


def test_judged_games_begin_anywhere(selfplay: Any) -> None:
    """Scripts play different games, and who wins is counted for the side that is judged."""
    sides = selfplay.judged(selfplay.greedy, selfplay.anywhere, 20)
    assert [side["as"] for side in sides] == ["player_0", "player_1"]
    assert all(10 < side["won"] <= 20 - side["drawn"] for side in sides)
    assert sides[0]["fingerprint"] != sides[1]["fingerprint"]


def test_quick_run_ends_in_evidence_that_replays(
    selfplay: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line of JSON names the evidence of every pairing."""
    assert selfplay.main(["--quick", "--out", str(tmp_path)]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert set(told) >= {
        "example",
        "trainer",
        "task",
        "seed",
        "steps",
        "seconds",
        "measure",
        "result",
        "wanted",
        "reached",
    }
    for opponent, found in told["games"].items():
        for side in found["sides"]:
            path = tmp_path / opponent / side["as"]
            assert gk.load(path).fingerprint == side["fingerprint"]
            assert gk.replay(path).verified
