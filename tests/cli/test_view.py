"""`gamekeeper view`: what it says first, how it ends."""

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from gamekeeper.cli import view as command
from gamekeeper.viewing.viewer import Viewer
from tests.cli.lines import SURROUNDINGS, document, said

PATIENCE_S = 60.0


@contextmanager
def viewing(*words: object) -> Iterator[subprocess.Popen[str]]:
    """`gamekeeper view` in a process of its own."""
    line = [sys.executable, "-m", "gamekeeper", "view", *map(str, words)]
    process = subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=SURROUNDINGS
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("number", "as_json"), [(signal.SIGINT, True), (signal.SIGTERM, False)], ids=["json", "text"]
)
def test_view_says_its_address_serves_and_ends(line_run: Path, number: int, as_json: bool) -> None:
    """The one document, or the address, comes at the start; Ctrl-C and kill end it with 0."""
    with viewing(line_run, *(["--json"] if as_json else [])) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        url = json.loads(first)["url"] if as_json else first.split()[1]
        connection = HTTPConnection(urlsplit(url).netloc, timeout=PATIENCE_S)
        connection.request("GET", f"/?{urlsplit(url).query}")
        reply = connection.getresponse()
        assert reply.status == 200
        assert reply.headers["Set-Cookie"]
        process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    assert out == ""
    assert "Traceback" not in err
    if as_json:
        found = json.loads(first)
        assert found == {"url": url, "port": urlsplit(url).port, "runs": [str(line_run)]}


def test_view_of_no_run_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Before any port is taken: exit code 2, with what to do."""
    code, found = document(capfd, "view", tmp_path)
    assert code == 2
    assert found["error"]["what"] == "there is no run here"
    assert said(capfd, "view")[0] == 2


def test_view_of_a_taken_port_is_refused(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, with what to do."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, _, err = said(capfd, "view", line_run, "--port", taken.getsockname()[1])
    assert code == 2
    assert "give another --port" in err
    assert said(capfd, "view", line_run, "--port", 70_000)[0] == 2


@pytest.mark.parametrize(
    ("is_terminal", "more", "surroundings", "opens"),
    [
        (True, [], {"DISPLAY": ":0"}, True),
        (True, ["--no-browser"], {"DISPLAY": ":0"}, False),
        (False, [], {"DISPLAY": ":0"}, False),
        (True, ["--json"], {"DISPLAY": ":0"}, False),
        (True, [], {}, False),
        (True, [], {"DISPLAY": ":0", "SSH_CONNECTION": "1 2 3 4"}, False),
    ],
    ids=["terminal", "unwanted", "pipe", "json", "no display", "ssh"],
)
def test_view_opens_a_browser_where_somebody_sits(
    line_run: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    is_terminal: bool,
    more: list[str],
    surroundings: dict[str, str],
    opens: bool,
) -> None:
    """On a terminal with a display, unless told not to; over SSH it says how to come by it."""
    opened: list[str] = []
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    for name, value in surroundings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(command, "is_at_terminal", lambda screen: is_terminal)
    monkeypatch.setattr(command, "open_browser", opened.append)
    monkeypatch.setattr(sys, "platform", "linux")

    def interrupted(self: Viewer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Viewer, "serve", interrupted)
    try:
        said(capsys, "view", line_run, *more)
    except SystemExit as end:
        assert end.code == 0  # noqa: PT017  # only --json ends this way
    assert bool(opened) == opens
    assert all("token=" in url for url in opened)
