"""Folders of recorded line-ups, as a person finds them."""

from gamekeeper.evaluation.worker_tasks import folder_names


def test_folders_are_named_by_environment_and_line_up() -> None:
    """No two alike, also where a disk doesn't tell cases apart; no sign that a disk refuses."""
    lineups = [
        ("line", "random"),
        ("line", "picker=mappo#0 carrier=random"),
        ("line", "Random"),
        ("line", "pol.py:chase"),
        ("line", "../x" * 99),
    ]
    found = folder_names(lineups)
    assert found[:4] == [
        "line-random",
        "line-picker=mappo_0-carrier=random",
        "line-Random-2",
        "line-pol.py_chase",
    ]
    assert len(found[4]) <= 102
    assert "/" not in found[4]
