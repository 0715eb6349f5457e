"""What the Ray executor says before Ray is asked for anything; it needn't be installed."""

import os
import socket
import sys

import pytest

from gamekeeper.errors import DependencyError, GamekeeperError
from gamekeeper.rollouts.executors import executor_of
from gamekeeper.rollouts.executors.ray_cluster import ours, reached


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray seems to be installed."""
    monkeypatch.setattr("gamekeeper.rollouts.executors.ray.find_spec", lambda name: object())


def test_ray_executor_names_the_extra_that_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Ray isn't installed, whoever asks for it is told how to come by it."""
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(DependencyError, match=r"pip install 'gamekeeper\[ray\]'"):
        executor_of("ray")


@pytest.mark.usefixtures("installed")
def test_ray_executor_refuses_no_workers() -> None:
    """Nobody would play."""
    with pytest.raises(GamekeeperError, match="number of workers"):
        executor_of("ray", 0)


@pytest.mark.parametrize("address", ["ray://127.0.0.1:10001", "127.0.0.1", "head:port", ""])
def test_ray_address_is_host_and_port(address: str) -> None:
    """Anything else is refused before Ray waits for it."""
    with pytest.raises(GamekeeperError, match="no address of a Ray cluster"):
        reached(address)


def test_ray_head_that_does_not_answer_is_told_at_once() -> None:
    """A port that nobody listens on: the fix says what to look at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    with pytest.raises(GamekeeperError, match="the Ray cluster doesn't answer") as caught:
        reached(address)
    assert "RAY_AUTH_MODE" in caught.value.fix


def test_ray_head_on_loopback_binds_the_driver_there() -> None:
    """A cluster on 127.0.0.1 can't reach a driver on the network card's address."""
    with socket.socket() as head:
        head.bind(("127.0.0.1", 0))
        head.listen()
        assert reached(f"127.0.0.1:{head.getsockname()[1]}")
    assert not reached("auto")


def test_ray_cluster_of_ours_has_a_token_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two have two; who has chosen a mode keeps it; nothing changes here by asking."""
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    monkeypatch.delenv("RAY_AUTH_TOKEN", raising=False)
    monkeypatch.delitem(sys.modules, "ray", raising=False)
    before = dict(os.environ)
    assert ours()["RAY_AUTH_MODE"] == "token"
    assert ours()["RAY_AUTH_TOKEN"] != ours()["RAY_AUTH_TOKEN"]
    assert before == dict(os.environ)
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    assert {"RAY_USAGE_STATS_ENABLED"} >= set(ours())
