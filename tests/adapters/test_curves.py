"""Evidence as curves: TensorBoard, W&B and MLflow are given each agent's figures at a step."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.adapters import curves
from gamekeeper.errors import DependencyError

Calls = list[tuple[Any, ...]]


@pytest.fixture(scope="module")
def evidence() -> Any:
    """Episodes of two roles."""
    return gk.rollout("two_robot_line", episodes=2, seed=0, most_turns=20)


class Writer:
    """TensorBoard's `SummaryWriter`, as far as its public methods are called."""

    def __init__(self) -> None:
        self.calls: Calls = []

    def add_scalar(self, tag: str, scalar_value: float, global_step: int) -> None:
        self.calls.append((tag, scalar_value, global_step))

    def add_text(self, tag: str, text_string: str, global_step: int) -> None:
        self.calls.append((tag, text_string, global_step))

    def flush(self) -> None:
        self.calls.append(("flush",))


def test_figures_are_those_of_the_evidence(evidence: Any) -> None:
    """Returns by agent, and the team's, which is their sum."""
    found = dict(curves.figures(evidence))
    parts = {a: part.to_json()["return_mean"] for a, part in evidence.summary.agents.items()}
    assert parts == {agent: found[f"{agent}/return"] for agent in parts}
    assert found["team/return"] == pytest.approx(sum(parts.values()))


def test_roles_of_several_agents_have_a_mean() -> None:
    """The mean over the agents of a role, beside each of them."""
    evidence = gk.rollout("warehouse", episodes=1, seed=0, most_turns=5, policies="random")
    found = dict(curves.figures(evidence))
    pickers = [v for name, v in found.items() if name.startswith("picker_") and "/return" in name]
    assert found["picker/return"] == pytest.approx(sum(pickers) / len(pickers))


def test_tensorboard_is_given_scalars_at_the_step(evidence: Any) -> None:
    """Every figure as a scalar, the fingerprint as text."""
    writer = Writer()
    curves.tensorboard(writer)(evidence, step=7)
    scalars = [(name, value, 7) for name, value in curves.figures(evidence)]
    assert [*scalars, ("fingerprint", evidence.fingerprint, 7), ("flush",)] == writer.calls


def test_wandb_is_given_one_row(evidence: Any) -> None:
    """All figures in one call, so that they share a step."""
    rows: Calls = []

    class Run:
        def log(self, data: dict[str, Any], step: int) -> None:
            rows.append((data, step))

    curves.wandb(Run())(evidence, step=3)
    expected = {**dict(curves.figures(evidence)), "fingerprint": evidence.fingerprint}
    assert [(expected, 3)] == rows


def test_mlflow_is_given_metrics(evidence: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Metrics of the active run or of the one that is named."""
    calls: Calls = []
    stub: Any = ModuleType("mlflow")
    stub.log_metrics = lambda metrics, step=None, run_id=None: calls.append((metrics, step, run_id))
    stub.set_tags = lambda tags: calls.append((tags,))
    monkeypatch.setitem(sys.modules, "mlflow", stub)
    curves.mlflow()(evidence, step=5)
    curves.mlflow("abc")(evidence, step=6)
    metrics = dict(curves.figures(evidence))
    tags = {"fingerprint": evidence.fingerprint}
    assert [(metrics, 5, None), (tags,), (metrics, 6, "abc")] == calls


def test_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install."""
    for name in ("mlflow", "torch.utils.tensorboard", "tensorboardX"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(DependencyError, match="pip install mlflow"):
        curves.mlflow()
    with pytest.raises(DependencyError, match="pip install tensorboardX"):
        curves.tensorboard("logs")
