"""Episodes as films: mp4 and gif from recorded frames, or from a replay that renders."""

from __future__ import annotations

from gamekeeper.adapters.video.film import Film, film

__all__ = ["Film", "film"]
