"""The render mode "human", tried in a process of its own that has no screen."""

import os
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final

from gamekeeper.auditing.other_process import hash_seeds, reason_against, worker_of
from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.auditing.source import own_packages
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.interface.opening import open_env

TASK: Final = f"{__name__}:render_task"
LIMIT_S: Final = 20.0
SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR")
"""Variables by which a program finds a screen; without them it opens no window on Linux."""
SCREENLESS: Final = {"SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy", "MPLBACKEND": "Agg"}


def left_out(session: ProbeSession) -> str | None:
    """The NotImplementedError of a first frame in mode "human"; None where there is none.

    What else is raised, such as for want of a screen, tells nothing; nor is it tried but on Linux.
    """
    if sys.platform != "linux" or reason_against(session) is not None:
        return None
    arguments: dict[str, Any] = {
        "spec": session.spec,
        "kwargs": dict(session.kwargs),
        "seed": session.seed,
    }
    worker = worker_of(session, hash_seeds(tuple(sorted(session.agents)))[0])
    outcome = worker.run(TASK, arguments, silence_s=LIMIT_S, limit_s=LIMIT_S)
    return outcome.value if isinstance(outcome.value, str) else None


def render_task(
    report: Callable[..., None], *, spec: str, kwargs: Mapping[str, Any], seed: int
) -> str | None:
    """Asks for a frame in this process, which was started for it."""
    for name in SCREENS:
        os.environ.pop(name, None)
    os.environ.update(SCREENLESS)
    own = own_packages(open_env(spec, **kwargs).env)
    try:
        env = open_env(spec, **{**kwargs, "render_mode": "human"}).env
        env.reset(seed=seed)
        env.render()
    except Exception as error:
        for each in (error, error.__cause__):
            if isinstance(each, NotImplementedError) and _package_of(each) in own:
                return said_by(each)
    return None


def _package_of(error: BaseException) -> str:
    """Package of the line that raised it."""
    at = error.__traceback__
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    name = "" if at is None else str(at.tb_frame.f_globals.get("__name__"))
    return name.partition(".")[0]
