"""The Ray cluster that tasks are played on: one that runs already, or one of this machine alone.

Source: Ray 2.60, `ray.init`, token authentication, scheduling by node.
"""

from __future__ import annotations

import os
import secrets
import socket
import sys
import time
from typing import Any, Final

from gamekeeper.errors import DependencyError, GamekeeperError

LOOPBACK: Final = "127.0.0.1"
OBJECTS_BYTES: Final = 100_000_000
"""Room for Ray's objects in a cluster of ours: outcomes are small and never go there."""
REACH_S: Final = 5.0
"""How long the head of a cluster may take to answer at all, in seconds; Ray waits for minutes."""
AHEAD: Final = 2
"""Tasks in flight for each core: one is played, the other waits for its place."""
FRESH_S: Final = 5.0
"""How old the number of cores may be, in seconds: nodes come and go."""
ALONE_S: Final = 300.0
"""How long a cluster may be without any core, in seconds: a node that is replaced takes a while."""


class Cluster:
    """A connection to Ray, with the number of its cores, closed only if it was opened here.

    Args:
        address: `host:port` of the head, `auto`, or None for a cluster of this machine alone, whose
            every port is bound to 127.0.0.1; a connection that this process has already is taken.
        workers: cores of a cluster of ours; None: as many as there are.

    Raises:
        DependencyError: Ray isn't installed.
        GamekeeperError: the cluster doesn't answer, or can't be one.
    """

    def __init__(self, address: str | None, workers: int | None) -> None:
        self._variables = ours() if address is None else {}
        os.environ.update(self._variables)  # Ray reads some of them when it is imported
        self.ray = the_ray()
        self._is_ours = not self.ray.is_initialized()
        self._is_alone = self._is_ours and address is None  # then Ray itself keeps to `workers`
        self._cores, self._seen_s = 0, -FRESH_S
        self._alone_s: float | None = None
        if self._is_ours:
            self._connect(address, workers)
        elif address not in (None, "auto", self.ray.get_runtime_context().gcs_address):
            raise GamekeeperError(
                "this process is connected to another cluster",
                where="address", expected=self.ray.get_runtime_context().gcs_address, seen=address,
                mend="call ray.shutdown() first, or leave the address out",
            )  # fmt: skip

    def _connect(self, address: str | None, workers: int | None) -> None:
        if address is None:
            how: dict[str, Any] = {
                "address": "local", "num_cpus": workers, "include_dashboard": False,
                "object_store_memory": OBJECTS_BYTES, "_node_ip_address": LOOPBACK,
            }  # fmt: skip
        else:
            how = {"address": address}
            if reached(address):
                how["_node_ip_address"] = LOOPBACK  # else Ray binds the network card's address
        try:
            self.ray.init(**how, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, OSError, RuntimeError, ValueError) as error:
            self.close()
            raise _unreachable(address, _told(error)) from error

    def cores(self) -> int:
        """How many tasks of one core find room now.

        Raises:
            GamekeeperError: there has been none for `ALONE_S`.
        """
        now_s = time.monotonic()
        if now_s - self._seen_s >= FRESH_S:
            self._cores, self._seen_s = int(self.ray.cluster_resources().get("CPU", 0)), now_s
        if self._cores:
            self._alone_s = None
        elif self._alone_s is None:
            self._alone_s = now_s
        elif now_s - self._alone_s > ALONE_S:
            raise GamekeeperError(
                f"the cluster has had no core for {ALONE_S:g} s",
                expected="a node with at least one",
                mend="start a node (ray start --address=...); the same command goes on from what "
                "was kept",
            )
        return self._cores

    def room(self, asked: int | None) -> int:
        """How many tasks may be in flight, where `asked` may be played at a time.

        Raises:
            GamekeeperError: there has been no core for long.
        """
        ahead = AHEAD * max(self.cores(), 1)
        return ahead if asked is None or self._is_alone else asked

    def nodes(self) -> list[str]:
        """The ids of the nodes that are alive and play tasks."""
        return [
            node["NodeID"]
            for node in self.ray.nodes()
            if node["Alive"] and node["Resources"].get("CPU", 0) >= 1
        ]

    def on(self, node: str) -> Any:
        """How a task is bound to a node."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return NodeAffinitySchedulingStrategy(node, soft=False)

    def close(self) -> None:
        """Lets the cluster go, if this process joined it here; ends it, if it is ours."""
        if self._is_ours and self.ray.is_initialized():
            self.ray.shutdown()
        for name in self._variables:
            os.environ.pop(name, None)
        self._variables = {}


def the_ray() -> Any:
    """Ray itself.

    Raises:
        DependencyError: it isn't installed.
    """
    try:
        import ray
    except ImportError as error:
        raise DependencyError(
            "Ray isn't installed", where="executor ray", seen=str(error),
            mend="pip install 'gamekeeper[ray]', on every node",
        ) from error  # fmt: skip
    return ray


def reached(address: str) -> bool:
    """Whether the head of a cluster is on this machine; looks first whether it is there at all.

    Raises:
        GamekeeperError: nobody answers there, or it is no address of a head.
    """
    if address == "auto":
        return False
    host, colon, port = address.rpartition(":")
    if "://" in address or not colon or not port.isdecimal():
        raise GamekeeperError(
            "no address of a Ray cluster", where="address", expected="HOST:PORT of its head, auto",
            seen=address,
            mend="run on a node of the cluster, with the head's address (ray://, for machines "
            "outside, is another protocol)",
        )  # fmt: skip
    try:
        socket.create_connection((host.strip("[]"), int(port)), REACH_S).close()
    except OSError as error:
        raise _unreachable(address, str(error)) from error
    return host == "localhost" or host.startswith("127.")


def ours() -> dict[str, str]:
    """Environment variables for a cluster that is started here.

    Nobody is told of it. And nobody else on this machine may hand tasks to it: Ray's own default is
    one token in the user's home for all clusters; ours have one each, which nobody writes down. Who
    has set a mode of authentication, or has imported Ray already, keeps what they have.
    """
    wanted = {"RAY_USAGE_STATS_ENABLED": "0"}
    if "RAY_AUTH_MODE" not in os.environ and "ray" not in sys.modules:
        wanted |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    return {name: value for name, value in wanted.items() if name not in os.environ}


def _unreachable(address: str | None, seen: str) -> GamekeeperError:
    if address is None:
        return GamekeeperError(
            "no Ray cluster can be started here", where="executor ray", seen=seen,
            mend="Ray's own logs (session_latest/logs in its temporary folder) say more; `local` "
            "needs no Ray",
        )  # fmt: skip
    return GamekeeperError(
        "the Ray cluster doesn't answer", where=address, seen=seen,
        mend="check that it runs (ray status) and that this process is on one of its nodes; where "
        "it asks for a token, set RAY_AUTH_MODE and RAY_AUTH_TOKEN_PATH as its head has them",
    )  # fmt: skip


def _told(error: BaseException) -> str:
    """What an error of Ray's came from, in one line."""
    cause: BaseException = error
    while cause.__cause__ is not None:
        cause = cause.__cause__
    lines = str(cause).strip().splitlines() or [type(cause).__name__]
    return lines[-1][:300]
