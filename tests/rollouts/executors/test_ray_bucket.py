"""Parts in a bucket: an S3 server on loopback, and what is played by way of it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from pyarrow import fs

import gamekeeper as gk
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.ray import RayExecutor
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.load_run import load
from gamekeeper.runs.parts.fan_out import record_apart
from gamekeeper.runs.parts.part_plan import claim
from gamekeeper.runs.parts.part_tasks import part_task
from tests.cli.lines import said

# What holds of every storage is tried here with the one below.
from tests.rollouts.executors.test_storage import (  # noqa: F401
    test_folders_go_there_and_come_back,
    test_names_that_leave_the_storage_are_refused,
    test_storage_gives_back_what_was_put,
)

pytest.importorskip("ray")
moto = pytest.importorskip("moto.server")
pytestmark = pytest.mark.trainer

KEY, SECRET = "owner", "nobodys-business"  # the server asks for no others
PLAN = RolloutPlan(spec="two_robot_line", episodes=12, seed=3)


@dataclass
class Bucket:
    """A bucket of a server on loopback.

    Attributes:
        requests: methods and paths that were asked for.
        on_request: called with them first, in a thread of the server's.
    """

    port: int = 0
    requests: list[tuple[str, str]] = field(default_factory=list)
    on_request: Callable[[str, str], None] = lambda method, path: None

    def url(self, bucket: str = "parts") -> str:
        """Where a run's parts go, with all that it takes to get there."""
        options = f"scheme=http&endpoint_override=127.0.0.1:{self.port}&region=us-east-1"
        return f"s3://{KEY}:{SECRET}@{bucket}/runs/a?{options}"

    def objects(self) -> dict[str, int]:
        """The sizes of what lies in it, by name."""
        files, _ = fs.FileSystem.from_uri(self.url())
        found = files.get_file_info(fs.FileSelector("parts", recursive=True))
        return {each.path: each.size for each in found if each.type == fs.FileType.File}


@pytest.fixture
def bucket() -> Iterator[Bucket]:
    """An empty one, for one test."""
    from werkzeug.serving import make_server

    s3 = moto.DomainDispatcherApplication(moto.create_backend_app)
    made = Bucket()

    def app(environ: dict[str, Any], start: Any) -> Any:
        asked = environ["REQUEST_METHOD"], environ["PATH_INFO"]
        made.requests.append(asked)
        made.on_request(*asked)
        return s3(environ, start)

    server = make_server("127.0.0.1", 0, app, threaded=True)
    made.port = server.port
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        with urlopen(f"http://127.0.0.1:{made.port}/moto-api/reset", b""):  # else it remembers
            pass
        fs.S3FileSystem(
            access_key=KEY,
            secret_key=SECRET,
            region="us-east-1",
            scheme="http",
            endpoint_override=f"127.0.0.1:{made.port}",
            allow_bucket_creation=True,
        ).create_dir("parts")
        yield made
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def storage(bucket: Bucket) -> Storage:
    """A storage in the bucket."""
    return Storage.at(bucket.url())


def plain(folder: Path) -> str:
    """The fingerprint of the run that one process records."""
    return gk.rollout(
        str(PLAN.spec), policies="random", episodes=PLAN.episodes, seed=PLAN.seed, out=folder
    ).fingerprint


@pytest.mark.parametrize("players", [LocalExecutor, RayExecutor])
def test_parts_in_a_bucket_make_the_run_of_one_process(
    players: Callable[..., AbstractContextManager[Any]], bucket: Bucket, tmp_path: Path
) -> None:
    """Each part went there, those that lay there aren't played again, and none stays."""
    storage = Storage.at(bucket.url())
    claim(storage, PLAN)
    for each in islice(PLAN.ranges(), 3):
        part_task(
            lambda **fields: None,
            storage=storage.place,
            plan=PLAN.to_json(),
            first=each.start,
            stop=each.stop,
        )
    with players(workers=2) as executor:
        found = record_apart(PLAN, tmp_path / "run", executor=executor, storage=storage)
    assert (found.error, found.parts, found.found, found.deaths) == (None, 12, 3, 0)
    assert load(tmp_path / "run").fingerprint == plain(tmp_path / "plain")
    written = {path for method, path in bucket.requests if method == "PUT"}
    assert sum(path.endswith("/agent_steps.parquet") for path in written) == 12
    assert bucket.objects() == {}


def test_record_puts_parts_into_a_bucket(
    bucket: Bucket, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """As it is typed, and nothing secret of the URL is said."""
    line = ("rollout", str(PLAN.spec), "--episodes", 12, "--seed", 3, "--workers", 2)
    code, out, err = said(capfd, *line, "--storage", bucket.url(), "--out", tmp_path / "run")
    assert code == 0
    assert plain(tmp_path / "plain") in out
    assert SECRET not in out + err
    code, out, err = said(
        capfd, *line, "--storage", bucket.url("nosuch"), "--out", tmp_path / "other"
    )
    assert code != 0
    assert "NO_SUCH_BUCKET" in err
    assert "s3://nosuch/runs/a" in err
    assert SECRET not in out + err


def test_interrupted_put_leaves_the_whole_object(bucket: Bucket, storage: Storage) -> None:
    """Ctrl-C while an upload begins: what shows is what was to be put, not its beginning."""

    def interrupt(method: str, path: str) -> None:
        if method == "POST" and path.endswith("/plan.json"):
            bucket.on_request = lambda method, path: None
            os.kill(os.getpid(), signal.SIGINT)

    bucket.on_request = interrupt
    with pytest.raises(KeyboardInterrupt):
        storage.put("plan.json", b"the plan")
    assert storage.get("plan.json") == b"the plan"
