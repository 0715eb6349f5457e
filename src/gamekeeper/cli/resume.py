"""`gamekeeper resume RUN --episode 3 --turn 57`: a live environment at a recorded turn."""

from __future__ import annotations

import code
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import Number
from gamekeeper.cli._screen import CommandResult, Screen

if TYPE_CHECKING:
    from gamekeeper.runs.resuming import Resumed

ORDER: Final = 45


def command(
    screen: Screen,
    run: Path,
    episode: Number = 0,
    turn: Number = 0,
    env: str | None = None,
    allow_import: bool = False,
) -> CommandResult:
    """Opens a recorded episode at one of its turns, in IPython or Python's own console.

    Plays the episode again up to the turn, compares every turn on the way with the recorded one
    (of level actions: rewards, flags and witnesses, to the episode's end), says what it compared,
    and hands over `env`, live, `policies` as they were then, and `observations` and `infos` of a
    ParallelEnv. Nothing is written.

    Exit code 0: resumed. 2: the replay up to there differs.

    Example: gamekeeper resume runs/warehouse-1 --episode 3 --turn 57

    Args:
        episode (--episode N): Number of the episode.
        turn (--turn N): Turn at which the episode is opened; 0: after the reset.
    """
    from gamekeeper.runs.resuming import resume

    resumed = resume(run, episode=episode, turn=turn, env=env, allow_import=allow_import)
    names: dict[str, Any] = {
        "env": resumed.env,
        "policies": resumed.policies,
        "observations": resumed.observations,
        "infos": resumed.infos,
    }
    live = list(map(str, resumed.env.agents))
    document = {
        "run": str(run),
        "episode": episode,
        "turn": turn,
        "agents": live,
        "compared": resumed.compared,
    }
    try:
        if not screen.is_json:
            _console(names, _banner(str(run), resumed, live))
    finally:
        resumed.env.close()
    return CommandResult(document)


def _banner(run: str, resumed: Resumed, live: list[str]) -> str:
    has_policies = resumed.policies is not None
    act = "policies.act(agent, observation, info)" if has_policies else "none that the run names"
    return (
        f"{run}, episode {resumed.episode}, turn {resumed.turn}: {resumed.compared}.\n"
        f"  env           live agents: {', '.join(live) or 'none, it is over'}\n"
        f"  policies      {act}\n"
        "  observations, infos: as a ParallelEnv returned them last; env.last() of an AECEnv"
    )


def _console(names: dict[str, Any], banner: str) -> None:
    """Reads lines in IPython where it is installed, else in Python's own console."""
    try:
        from IPython import start_ipython
        from traitlets.config import Config
    except ImportError:
        code.interact(banner=banner, local=names, exitmsg="")
        return
    config = Config()
    config.TerminalInteractiveShell.banner1 = f"{banner}\n"
    config.HistoryManager.enabled = False
    start_ipython(argv=[], user_ns=names, config=config)
