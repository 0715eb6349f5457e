"""`gamekeeper expand RUN OUT`: plays a small run again into full evidence."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._options import SILENCE_S
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.rollout import show_recorded
from gamekeeper.errors import DivergenceError

ORDER: Final = 43


def command(
    screen: Screen,
    run: Path,
    out: str,
    env: str | None = None,
    allow_import: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Replays a run of level actions or digest, and records it in full.

    Every reward, flag and stored digest is compared with the recorded one; observations without a
    digest can't be. The fingerprint is that of the same run recorded in full. Volatile infos,
    timings and frames aren't restored.

    Exit code 0: expanded. 1: the replay differs; OUT isn't written.

    Example: gamekeeper expand runs/small runs/full

    Args:
        out (OUT): Folder of the full run; it must not exist yet.
    """
    from gamekeeper.reporting.results_text import diverged_text
    from gamekeeper.runs.expanding import expand

    try:
        with screen.progress("expanding") as take:
            evidence = expand(
                run, out, env=env, allow_import=allow_import, timeout_s=timeout, on_message=take
            )
    except DivergenceError as error:
        screen.verdict(diverged_text(error.divergence, width=screen.width), "bad")
        screen.show("Nothing was written. `gamekeeper replay RUN` looks for the cause.")
        divergence = error.divergence.to_json()
        return CommandResult({"run": str(run), "out": None, "divergence": divergence}, 1)
    screen.verdict(f"expanded into {out}: rewards, flags and stored digests as recorded", "good")
    show_recorded(screen, evidence)
    return CommandResult({**evidence.to_json(), "expanded": str(run), "divergence": None})
