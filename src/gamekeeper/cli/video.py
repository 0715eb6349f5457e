"""`gamekeeper video RUN`: an episode as mp4 and gif."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._options import (
    MOST,
    SILENCE_S,
    ImportOption,
    ReopenOption,
    RunArgument,
    TimeoutOption,
)
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 118

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="PATH",
        help="A file, .mp4 or .gif, or a folder for both; otherwise both, beside the run.",
    ),
]  # fmt: skip
EpisodeOption = Annotated[
    int | None,
    typer.Option(
        "--episode",
        metavar="N",
        min=0,
        max=MOST,
        help="Which; otherwise the first that has frames.",
    ),
]
FpsOption = Annotated[
    float | None,
    typer.Option(
        "--fps", metavar="X", min=0.1, max=240,
        help="Frames a second; otherwise the environment's own, or 10.",
    ),
]  # fmt: skip
RenderOption = Annotated[
    bool, typer.Option("--render", help="Play the episode again, and render what is seen.")
]
StripOption = Annotated[
    bool, typer.Option("--strip/--no-strip", help="Actions and rewards below each frame.")
]


def command(
    screen: Screen,
    run: RunArgument,
    out: OutOption = None,
    episode: EpisodeOption = None,
    fps: FpsOption = None,
    render: RenderOption = False,
    strip: StripOption = True,
    env: ReopenOption = None,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Writes an episode as mp4 and gif, from recorded frames or by rendering it again.

    Below each frame stands who did what and was paid. Nothing that exists is written over. Exit
    code 1: what was rendered differs from the run. Needs gamekeeper[video].
    """
    from gamekeeper.adapters.video import film

    with screen.progress("filming") as take:
        found = film(
            run, out, episode=episode, fps=fps, render=render, has_strip=strip, env=env,
            allow_import=allow_import, timeout_s=timeout, on_message=take,
        )  # fmt: skip
    screen.show(f"Filmed  {found}")
    if found.divergence is not None:
        screen.error(f"the film shows a replay that differs from the run at {found.divergence}")
    return Answer(found.to_json(), 0 if found.divergence is None else 1)
