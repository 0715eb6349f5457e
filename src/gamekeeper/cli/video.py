"""`gamekeeper video RUN`: an episode as mp4 and gif."""

from pathlib import Path
from typing import Annotated, Final

from gamekeeper.cli._options import SILENCE_S, Accepted, Number
from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 118


def command(
    screen: Screen,
    run: Path,
    out: Path | None = None,
    episode: Number | None = None,
    fps: Annotated[float, Accepted(0.1, 240)] | None = None,
    render: bool = False,
    strip: bool = True,
    env: str | None = None,
    allow_import: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Writes an episode as mp4 and gif, from recorded frames or by rendering it again.

    Actions and rewards of the turn stand below each frame. Earlier files are overwritten.
    Needs gamekeeper[video].

    Exit code 0: done. 1: the rendered episode differs from the run.

    Example: gamekeeper video runs/warehouse-1 --episode 3 --render

    Args:
        out (--out PATH): File, .mp4 or .gif, or a folder for both (default: both, beside the run).
        episode (--episode N): Episode to show (default: the first that has frames).
        fps (--fps X): Speed, in frames per second (default: the environment's render_fps, or 10).
        render (--render): Play the episode again, and render it.
        strip (--strip/--no-strip): Write actions and rewards below each frame.
    """
    from gamekeeper.viewing.video_file import VideoRendering, film

    with screen.progress("writing video") as take:
        rendering = VideoRendering(env, allow_import, timeout, take) if render else None
        found = film(run, out, episode=episode, fps=fps, rendering=rendering, has_strip=strip)
    screen.show(f"Written  {found}")
    if found.divergence is not None:
        screen.error(f"the video shows a replay that differs from the run at {found.divergence}")
    return CommandResult(found.to_json(), 0 if found.divergence is None else 1)
