"""The player of one episode for a notebook or a page of one's own: one text, without a server."""

from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path
from typing import Final

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.plain_json import legible
from gamekeeper.reporting.page.composition import PLAYER, lead_of, shown
from gamekeeper.reporting.page.episode_list import entries_of, packed_of
from gamekeeper.reporting.page.packed_episode import deflated
from gamekeeper.reporting.page.page_data import Page, PageSection
from gamekeeper.reporting.page.page_html import render
from gamekeeper.runs.load_run import load
from gamekeeper.viewing.report_packer import Pictures

FRAMES_BYTES: Final = 4_000_000
"""Size of an episode's recorded frames."""
KEY: Final = "a"
DIGITS: Final = 12


@dataclass(frozen=True, slots=True)
class EpisodePlayer:
    """The player of one episode; a notebook shows it.

    Attributes:
        page: the whole page.
        height: of the frame that holds it, in pixels.
        caption: fingerprint and root digest of the run.
    """

    page: str
    height: int
    caption: str

    def __str__(self) -> str:
        return f"player of {len(self.page):,} characters; {self.caption}"

    def __repr__(self) -> str:
        return f"<{self}>"

    def _repr_html_(self) -> str:
        """An `<iframe>` that holds the page; its script can't reach what stands around it."""
        style = f"width:100%;height:{self.height}px;border:0"
        return (
            '<figure style="margin:0"><iframe title="Player of an episode" '
            f'sandbox="allow-scripts" style="{style}" srcdoc="{escape(self.page)}">'
            f"</iframe><figcaption><small>{escape(self.caption)}</small></figcaption></figure>"
        )


@legible
def player(
    evidence: Evidence | str | PathLike[str], episode: int = 0, *, height: int = 820
) -> EpisodePlayer:
    """Returns the player of one episode, as a notebook shows it.

    Args:
        evidence: of a run, or the run's folder.
        height: of the frame in a notebook, in pixels.
    Raises:
        EvidenceError: there is no such episode.
        RunError: there is no run, or it is damaged.
    """
    run = evidence if isinstance(evidence, Evidence) else load(evidence)
    folder = None if run.path is None else Path(run.path)
    name = "in memory" if folder is None else folder.resolve().name
    main = shown(run, key=KEY, path=str(folder or name), name=name)
    frames = None if folder is None else Pictures(folder).of(episode, FRAMES_BYTES)
    packed = packed_of(run, episode, run=KEY, roster=main.roster, frames=frames)
    entries = entries_of(run, run=KEY, figures=main.figures, failed=main.failed)
    page = Page(
        title=f"{name}, episode {episode}",
        lead=lead_of([main]),
        runs=(main.card,),
        sections=(PageSection(PLAYER, "Player"),),
        episodes=[{**each, "packed": True} for each in entries if each["episode"] == episode],
        packed={(KEY, episode): deflated(packed)},
    )
    root = "none, in memory" if run.root is None else run.root[:DIGITS]
    return EpisodePlayer(
        render(page), height, f"fingerprint {run.fingerprint[:DIGITS]}, root digest {root}"
    )
