"""`gamekeeper video RUN`: an episode as mp4 and gif."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._options import (
    SILENCE_S,
    ImportOption,
    ReopenOption,
    RunArgument,
    TimeoutOption,
    episode_option,
)
from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 118

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="PATH",
        help="File, .mp4 or .gif, or a folder for both (default: both, beside the run).",
    ),
]
EpisodeOption = Annotated[
    int | None, episode_option("Episode to show (default: the first that has frames).")
]
FpsOption = Annotated[
    float | None,
    typer.Option(
        "--fps",
        metavar="X",
        min=0.1,
        max=240,
        help="Speed, in frames per second (default: the environment's render_fps, or 10).",
    ),
]
RenderOption = Annotated[
    bool, typer.Option("--render", help="Play the episode again, and render it.")
]
CaptionOption = Annotated[
    bool, typer.Option("--strip/--no-strip", help="Write actions and rewards below each frame.")
]


def command(
    screen: Screen,
    run: RunArgument,
    out: OutOption = None,
    episode: EpisodeOption = None,
    fps: FpsOption = None,
    render: RenderOption = False,
    strip: CaptionOption = True,
    env: ReopenOption = None,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> CommandResult:
    """Writes an episode as mp4 and gif, from recorded frames or by rendering it again.

    Actions and rewards of the turn stand below each frame. Earlier files are overwritten.
    Needs gamekeeper[video].

    Exit code 0: done. 1: the rendered episode differs from the run.

    Example: gamekeeper video runs/warehouse-1 --episode 3 --render
    """
    from gamekeeper.viewing.video_file import VideoRendering, film

    with screen.progress("writing video") as take:
        rendering = VideoRendering(env, allow_import, timeout, take) if render else None
        found = film(run, out, episode=episode, fps=fps, rendering=rendering, has_strip=strip)
    screen.show(f"Written  {found}")
    if found.divergence is not None:
        screen.error(f"the video shows a replay that differs from the run at {found.divergence}")
    return CommandResult(found.to_json(), 0 if found.divergence is None else 1)
