"""What holds for every test: no window, no network, and the same draws in every run."""

import itertools
import os
import signal
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from gymnasium.spaces import Space
from hypothesis import HealthCheck, settings

# pygame reads these when it is first imported, so they stand before any environment can be.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

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


@pytest.fixture(autouse=True, scope="session")
def interrupts_are_heard() -> Iterator[None]:
    """Ctrl-C comes through, also where a shell started this in the background, ignoring it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


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
