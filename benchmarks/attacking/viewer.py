"""Attacks on `gamekeeper view`: idle connections, little memory, a locale without UTF-8."""

import http.cookiejar
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.attacking.attack import Attack, Found

ADDRESS_BYTES: Final = 400_000_000
IDLE: Final = 100
ANSWER_S: Final = 20.0
ADDRESSES: Final = ("/index.json", "/episode/a/0")


def viewers() -> list[Attack]:
    """A visitor with the token gets page, index and an episode all the same."""
    bare = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    ways: dict[str, Callable[[Path], Found]] = {
        f"{IDLE} idle connections": partial(_visit, idle=IDLE),
        f"{ADDRESS_BYTES // 10**6} MB of addresses": partial(_visit, address_bytes=ADDRESS_BYTES),
        "LC_ALL=C": partial(_visit, variables=bare),
    }
    return [Attack(f"viewer: {name}", act=act, codes=frozenset({0})) for name, act in ways.items()]


def _visit(
    work: Path,
    *,
    idle: int = 0,
    address_bytes: int | None = None,
    variables: Mapping[str, str] | None = None,
) -> Found:
    """Starts a viewer, visits it, and ends it with Ctrl-C."""

    def limit() -> None:
        if address_bytes is not None:
            resource.setrlimit(resource.RLIMIT_AS, (address_bytes, address_bytes))

    with subprocess.Popen(
        [sys.executable, "-P", "-m", "gamekeeper", "view", "line", "--no-browser", "--json"],
        cwd=work,
        env={**os.environ, **(variables or {})},
        preexec_fn=limit,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        first, said = process.stdout.readline(), ""
        waiting: list[socket.socket] = []
        try:
            document = json.loads(first)
            port = document["port"]
            waiting = [socket.create_connection(("127.0.0.1", port)) for _ in range(idle)]
            _ask(document["url"], port)
        except (OSError, ValueError, KeyError) as error:
            said = f"the visitor was refused: {error}\n"
        process.send_signal(signal.SIGINT)
        said += first + process.communicate(timeout=60)[0]
        for connection in waiting:
            connection.close()
        return Found(process.returncode if "refused" not in said else -1, said)


def _ask(url: str, port: int) -> None:
    """Opens the page with its token, then what the page asks for."""
    jar = urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar())
    opener = urllib.request.build_opener(jar)
    for address in (url, *(f"http://127.0.0.1:{port}{each}" for each in ADDRESSES)):
        with opener.open(address, timeout=ANSWER_S) as answer:
            answer.read()


KINDS: Final = {"viewer": viewers}
