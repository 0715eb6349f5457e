"""Evidence out of a bundle."""

from __future__ import annotations

from os import PathLike

from gamekeeper.core.evidence import Evidence
from gamekeeper.record.reading import read


def load(path: str | PathLike[str]) -> Evidence:
    """The evidence in a bundle, also of one that is still recorded or was killed, up to its last whole turn.

    Raises:
        BundleError: there is no bundle, it is damaged, or of a newer format.
    """
    bundle = read(path)
    return Evidence(
        manifest=bundle.manifest,
        episodes=bundle.episodes,
        steps=bundle.steps,
        states=bundle.states,
        timings=bundle.timings,
        path=bundle.path,
    )
