"""Plots of evidence and evaluations in matplotlib, one line each: `gk.plot.returns(evidence)`.

Every function takes `ax=`, the axes to draw on, and returns the axes. Needs `gamekeeper[plot]`.
"""

from gamekeeper.viewing.plot.evaluation_plots import crossplay, curves, intervals, profiles
from gamekeeper.viewing.plot.run_plots import heatmap, returns

__all__ = ["crossplay", "curves", "heatmap", "intervals", "profiles", "returns"]
