"""rliable's aggregates of score matrices: JSON in, JSON out (benchmarks/rliable_same.py asks).

Reads `[[a, b], ...]`, two matrices [runs, environments] each time, and prints rliable's figures of
each pair in the same order.
"""

import json
import sys

import numpy as np
from rliable import metrics


def figures(one, two):
    """The five of one pair."""
    a, b = np.array(one), np.array(two)
    return {
        "iqm": float(metrics.aggregate_iqm(a)),
        "mean": float(metrics.aggregate_mean(a)),
        "median": float(metrics.aggregate_median(a)),
        "optimality_gap": float(metrics.aggregate_optimality_gap(a)),
        "improvement": float(metrics.probability_of_improvement(a, b)),
    }


if __name__ == "__main__":
    print(json.dumps([figures(*pair) for pair in json.load(sys.stdin)]))
