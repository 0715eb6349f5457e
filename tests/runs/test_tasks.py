from pathlib import Path
from threading import Event
from typing import Any

import pytest

from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.load_run import load
from gamekeeper.runs.worker_tasks import record_task
from tests.runs.plays import write_env


def recorded(folder: Path, report: Any, **options: Any) -> dict[str, Any]:
    """What the recording task returns for three short episodes."""
    settings = {"spec": f"{write_env(folder)}:Walk", "episodes": 3, **options}
    plan = RolloutPlan(**settings)
    return record_task(report, plan=plan.to_json(), out=str(folder / "run"))


def test_record_task_reports_episodes(tmp_path: Path) -> None:
    """Progress knows how many episodes there will be and how many are done."""
    said: list[dict[str, Any]] = []

    assert recorded(tmp_path, lambda **fields: said.append(fields)) == {"error": None}

    assert said[0] == {"turns": 0, "episodes": 3}
    assert [fields["episode"] for fields in said if "episode" in fields] == [1, 2, 3]


def test_record_task_is_alive_while_it_finalizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that takes long to finalize isn't taken for an environment that hangs."""
    is_alive, finalize = Event(), RunStore.finalize

    def slowly(*given: Any) -> None:
        is_alive.clear()
        assert is_alive.wait(30.0)
        finalize(*given)

    monkeypatch.setattr(RunStore, "finalize", slowly)

    assert recorded(tmp_path, lambda **fields: is_alive.set()) == {"error": None}
    assert load(tmp_path / "run").manifest["status"] == "finalized"


@pytest.mark.parametrize(
    ("edit", "kind", "what"),
    [
        ({"spec": "no/such-v0"}, "SpecError", "no/such-v0"),
        ({"env_kwargs": {"turns": "many"}}, "EnvError", "raised TypeError"),
    ],
)
def test_record_task_returns_errors_as_data(
    tmp_path: Path, edit: dict[str, Any], kind: str, what: str
) -> None:
    """What went wrong on purpose, or in the environment, crosses to the parent as text."""
    error = recorded(tmp_path, lambda **fields: None, **edit)["error"]
    assert error["kind"] == kind
    assert what in error["what"]
