"""The script and the style of the page: whole, fit to stand inline, and nobody else's."""

import base64
import hashlib
import re
from importlib.resources import files

import pytest

from gamekeeper.reporting.page import page_html

FOLDER = files("gamekeeper.reporting.page").joinpath("assets")
# Of the package uplot 1.6.32, unchanged; the same figures stand in assets/README.md.
UPLOT = {
    "LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
    "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}


@pytest.mark.parametrize("name", UPLOT)
def test_uplot_is_the_pinned_one(name: str) -> None:
    """Each file of uPlot is, byte for byte, the one that the folder's page names."""
    digest = hashlib.sha256(FOLDER.joinpath("uplot", name).read_bytes()).hexdigest()
    assert UPLOT[name] == digest
    assert digest in FOLDER.joinpath("README.md").read_text(encoding="utf-8")


def test_script_holds_every_part_and_the_licence() -> None:
    """Every file of the player is part of it, and uPlot's licence goes along."""
    there = {path.name for path in FOLDER.joinpath("player").iterdir()}
    assert there == set(page_html.PARTS)
    assert "Copyright (c) 2022 Leon Sorokin" in page_html.script()


@pytest.mark.parametrize("text", [page_html.script(), page_html.style()], ids=["script", "style"])
def test_text_stays_inside_its_element(text: str) -> None:
    """Neither text ends its element or opens a comment in the page."""
    assert re.search(r"</(script|style)|<!--|<script", text, re.IGNORECASE) is None


def test_assets_ask_nobody_and_make_no_code() -> None:
    """No address, no markup from text, no code from text stands in our parts or in the style."""
    forbidden = "|".join(
        [
            r"https?://(?!www\.w3\.org/2000/svg)",
            r"innerHTML|outerHTML|insertAdjacent|document\.write",
            r"\beval\(|new Function|@import|url\(",
        ]
    )
    parts = {
        name: FOLDER.joinpath("player", name).read_text(encoding="utf-8")
        for name in page_html.PARTS
    }
    found = {
        name: re.findall(forbidden, text)
        for name, text in [*parts.items(), ("style", page_html.style())]
    }
    assert {name: words for name, words in found.items() if words} == {}


def test_parts_are_short_enough_to_read() -> None:
    """No part of the player is longer than 400 lines."""
    counts = {
        name: len(FOLDER.joinpath("player", name).read_text(encoding="utf-8").splitlines())
        for name in page_html.PARTS
    }
    assert {name: lines for name, lines in counts.items() if lines > 400} == {}


def test_source_hash_is_what_a_browser_computes() -> None:
    """A hash source is the base64 of the SHA-256 of the UTF-8 text, in quotes."""
    digest = base64.b64encode(hashlib.sha256("ä".encode()).digest()).decode()
    assert f"'sha256-{digest}'" == page_html.source_hash("ä")
