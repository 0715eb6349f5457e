"""Curves in TensorBoard, W&B or MLflow: callbacks that take evidence while a learner learns.

    log = curves.tensorboard("logs/warehouse")     # or curves.wandb(run), curves.mlflow()
    log(gk.rollout("warehouse", policies=mine, episodes=20), step=10_000)

| | |
|---|---|
| kept | each agent's, each role's and the team's mean return, each agent's mean length, share and idle turns, at the learner's step; the fingerprint as text |
| changed | episodes become their mean |
| lost | everything else: keep the run (`out=`), and log its folder as an artifact |
"""  # noqa: E501  # a row of a table is one line

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from statistics import fmean
from typing import Any, TypeAlias

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import role
from gamekeeper.errors import DependencyError

Log: TypeAlias = Callable[..., None]
"""Called with evidence and `step=`, the learner's step; logs its figures."""


def figures(evidence: Evidence) -> Iterator[tuple[str, float]]:
    """Names and values of a run's figures: `picker_0/return`, `picker/return`, `team/return`."""
    by_role: dict[str, list[float]] = {}
    returns: list[float] = []
    for agent, part in evidence.summary.agents.items():
        values = part.to_json()
        for key, name in (("return_mean", "return"), ("length_mean", "length")):
            if values.get(key) is not None:
                yield f"{agent}/{name}", float(values[key])
        for key in ("share", "idle"):
            if values.get(key) is not None:
                yield f"{agent}/{key}", float(values[key])
        if values.get("return_mean") is not None:
            returns.append(float(values["return_mean"]))
            by_role.setdefault(evidence.contract.role_of(agent) or role(agent), []).append(
                returns[-1]
            )
    for name, found in by_role.items():
        if name not in evidence.summary.agents:
            yield f"{name}/return", fmean(found)
    if returns:
        yield "team/return", sum(returns)


def tensorboard(writer: Any) -> Log:
    """A callback that writes TensorBoard's files.

    Args:
        writer: a folder, or a `SummaryWriter` of torch or tensorboardX.
    Raises:
        DependencyError: a folder is given, and neither torch nor tensorboardX is installed.
    """
    to = writer if hasattr(writer, "add_scalar") else _summary_writer(str(writer))

    def log(evidence: Evidence, *, step: int) -> None:
        for name, value in figures(evidence):
            to.add_scalar(name, value, step)
        to.add_text("fingerprint", evidence.fingerprint, step)
        to.flush()

    return log


def wandb(run: Any) -> Log:
    """A callback that logs to a run of Weights & Biases, as `wandb.init()` returns it."""

    def log(evidence: Evidence, *, step: int) -> None:
        run.log({**dict(figures(evidence)), "fingerprint": evidence.fingerprint}, step=step)

    return log


def mlflow(run_id: str | None = None) -> Log:
    """A callback that logs to MLflow.

    Args:
        run_id: a run of MLflow's; None: the active one.
    Raises:
        DependencyError: MLflow isn't installed.
    """
    try:
        package = import_module("mlflow")
    except ImportError as error:
        raise _missing("mlflow") from error

    def log(evidence: Evidence, *, step: int) -> None:
        package.log_metrics(dict(figures(evidence)), step=step, run_id=run_id)
        if run_id is None:
            package.set_tags({"fingerprint": evidence.fingerprint})

    return log


def _summary_writer(folder: str) -> Any:
    for package in ("torch.utils.tensorboard", "tensorboardX"):
        try:
            module = import_module(package)
        except ImportError:
            continue
        return module.SummaryWriter(folder)
    raise _missing("tensorboardX")


def _missing(package: str) -> DependencyError:
    return DependencyError(f"{package} isn't installed", fix=f"pip install {package}")
