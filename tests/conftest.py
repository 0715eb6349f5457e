"""What holds for every test: no window, no network, and the same draws in every run."""

import gc
import itertools
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Space
from hypothesis import HealthCheck, settings

from tests.tiers import LIMIT_S, ROOT, measured, pytest_addoption, pytest_configure

__all__ = ["pytest_addoption", "pytest_configure"]  # hooks, found by their names here

# pygame reads these when it is first imported, so they stand before any environment can be.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

# Runs that tests record are never among those of whoever runs the tests.
STATE = tempfile.TemporaryDirectory(prefix="gamekeeper-tests-")
os.environ["XDG_STATE_HOME"] = STATE.name

# No deadline: speed is measured in benchmarks/. `--hypothesis-profile=explore` looks further.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile(
    "explore", max_examples=2_000, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("same")


def refuse_network(event: str, arguments: tuple[object, ...]) -> None:
    """Raises where a test would connect to anything but this machine."""
    if event != "socket.connect" or not isinstance(arguments[1], tuple):
        return  # an address that is no tuple is a path on this machine
    host = str(arguments[1][0])
    if host not in {"localhost", "::1"} and not host.startswith("127."):
        raise RuntimeError(f"a test connects to {host}; tests use no network")


sys.addaudithook(refuse_network)


PAGES = ("tests/surface/test_docs_run.py", "tests/surface/test_tutorials_run.py")
"""Files whose tests share nothing, take long, and would leave a core idle at the end as a whole."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `--dist loadfile` a file's tests stay in one process; each page is work of its own.

    What takes longest by `seconds.json` is handed out first, so that all processes end at about the
    same time; a test that isn't in there counts as a tenth of one that just is.
    """
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFileOrPage(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file: str = super()._split_scope(nodeid)
            return nodeid if file in PAGES else file

        def _assign_work_unit(self, node: Any) -> None:
            if not lengths:
                for unit, tests in self.workqueue.items():
                    lengths[unit] = sum(seconds.get(test, LIMIT_S / 10) for test in tests)
            self.workqueue.move_to_end(max(self.workqueue, key=lengths.__getitem__), last=False)
            super()._assign_work_unit(node)

    seconds, lengths = measured(), dict[str, float]()
    return ByFileOrPage(config, log)


def pytest_sessionstart() -> None:
    """Collecting makes a million objects that stay: looking for garbage among them finds none."""
    gc.disable()


def pytest_collection_finish() -> None:
    """No later search looks through them either, which took a sixth of the tests' time."""
    gc.freeze()
    gc.enable()


def pytest_make_parametrize_id(val: object) -> str | None:
    """A test has the same id in every checkout: a path of this one begins at its root."""
    return val.replace(f"{ROOT}/", "") if isinstance(val, str) and str(ROOT) in val else None


@pytest.fixture(autouse=True, scope="session")
def interrupts_are_heard() -> Iterator[None]:
    """Ctrl-C comes through, also where a shell started this in the background, ignoring it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def nothing_is_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """No run is remembered as this user's own: all count as somebody else's."""
    monkeypatch.setenv("XDG_STATE_HOME", os.devnull)


SPACES_SEEDED = itertools.count()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Each test begins with the same seed for spaces, whatever ran before it."""
    global SPACES_SEEDED
    SPACES_SEEDED = itertools.count()


@pytest.fixture(autouse=True, scope="session")
def unseeded_spaces_draw_the_same() -> Iterator[None]:
    """A space that nobody seeded takes the next of a test's seeds instead of the system's noise."""
    shipped = Space.np_random

    def np_random(space: Space) -> np.random.Generator:
        if space._np_random is None:
            Space.seed(space, next(SPACES_SEEDED))
        return shipped.fget(space)

    Space.np_random = property(np_random)
    yield
    Space.np_random = shipped
