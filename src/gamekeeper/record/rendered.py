"""Environments whose frames are kept: opened with a render mode, or refused in time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.game.open import Opened, open_env
from gamekeeper.record.frames import require_pillow

PICTURES: Final = "rgb_array"
MODES: Final = (PICTURES, "ansi")
"""Render modes that give something to keep, the better first."""


def open_rendered(spec: object, env_kwargs: Mapping[str, Any]) -> Opened:
    """Opens an environment so that it renders; a mode that nobody chose is chosen and recorded.

    The mode becomes one of the environment's arguments, so a replay opens it in the same way. An
    object is taken as it was made, and so is what doesn't list its modes.

    Raises:
        EvidenceError: it has none of the modes that give frames, or can't be made with one.
        SpecError: nothing can be opened under that name.
        DependencyError: it gives pictures, and nothing is installed to write them.
    """
    opened = open_env(spec, **env_kwargs)
    modes = opened.env.metadata.get("render_modes")
    mode = getattr(opened.env, "render_mode", None)
    if opened.make is None or mode is not None or "render_mode" in env_kwargs or modes is None:
        if mode == PICTURES:
            require_pillow()
        return opened
    opened.env.close()
    chosen = next((one for one in MODES if one in modes), None)
    if chosen == PICTURES:
        require_pillow()  # before the run begins: an unfinished one would be in the next one's way
    seen = f"render_modes {list(modes)}"
    if chosen is not None:
        try:
            return open_env(spec, **{**env_kwargs, "render_mode": chosen})
        except SpecError as error:
            seen = error.what
    raise EvidenceError(
        "no frames can be taken of the environment",
        where=opened.spec,
        expected=f"a render mode: {' or '.join(MODES)}",
        seen=seen,
        mend="record it without frames, or give its factory a render_mode",
    )
