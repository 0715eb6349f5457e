"""A Rerun recording (.rrd): series, images and logs, turn by turn."""

from gamekeeper.adapters.rerun import export

__all__ = ["export"]
