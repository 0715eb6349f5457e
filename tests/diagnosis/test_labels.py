"""Failure labels beside the evidence."""

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.labels import label, labels, propose
from gamekeeper.errors import EvidenceError
from gamekeeper.viewing.report_documents import documents_of


@pytest.fixture(name="run")
def _run(tmp_path: Path) -> Path:
    """A failing run."""
    path = tmp_path / "r"
    gk.rollout("handover", policies="reference", episodes=3, out=path, env_kwargs={"latency": 3})
    return path


def test_labels_are_kept_in_order_and_found_again(run: Path) -> None:
    """By whom, where and why; the checksums and the fingerprint don't know of them."""
    label(run, "control", agent="giver_0", episode=1, turn=0, why="slow", by="ann")
    label(run, "state-estimation", by="bob")
    every = labels(run)
    assert [(each.label, each.agent, each.episode, each.by) for each in every] == [
        ("control", "giver_0", 1, "ann"),
        ("state estimation", None, None, "bob"),
    ]
    assert not any(each.proposed for each in every)
    assert labels(run, agent="giver_0") == every[:1]
    assert labels(run, name="state estimation") == every[1:]
    assert gk.replay(run).verified


def test_labels_outside_the_vocabulary_are_refused(run: Path) -> None:
    """Also agents, episodes and turns that aren't there; nothing is written."""
    with pytest.raises(EvidenceError, match="no failure label 'controll'") as caught:
        label(run, "controll")
    assert "write 'control'" in str(caught.value)
    with pytest.raises(EvidenceError, match="no failure label 'battery'"):
        label(run, "battery")
    with pytest.raises(EvidenceError, match="the run has no agent 'bob'") as caught:
        label(run, "control", agent="bob")
    assert caught.value.expected == "one of giver_0, receiver_0"
    with pytest.raises(EvidenceError, match="no episode 9"):
        label(run, "control", episode=9)
    with pytest.raises(EvidenceError, match="a turn needs its episode") as caught:
        label(run, "control", turn=1)
    assert caught.value.fix == "name the episode too"
    with pytest.raises(EvidenceError, match="episode 1 has no turn 999") as caught:
        label(run, "control", episode=1, turn=999)
    assert (caught.value.fix or "").startswith("name a turn from 0 to ")
    assert labels(run) == ()


def test_a_diagnosis_proposes_labels_once(run: Path) -> None:
    """They say that nobody but the diagnosis has said so."""
    found = gk.diagnose(run, perturbations=False, episodes=300)
    assert [each.label for each in propose(run, found, by="test")] == ["timing", "timing"]
    assert propose(run, found, by="test") == ()
    assert all(each.proposed and each.by == "test" for each in labels(run))
    told = documents_of(run).diagnosis
    assert told is not None
    assert told["fingerprint"] == found.fingerprint  # a report finds it there
