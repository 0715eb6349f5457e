"""The page's own style and script: each one text, put together from the readable files beside it.

There is no build step and no bundler: the script is its files in a fixed order inside one function,
so that nothing but `gamekeeper` reaches the page's global names; the style is uPlot's and ours.
Both stand in the page itself, and a page's security policy names them by their hash.
"""

import base64
import hashlib
from functools import cache
from importlib.resources import files
from typing import Final

# Each part may use what those before it put into `gk`.
PARTS: Final = (
    "theme.js",
    "nodes.js",
    "episode.js",
    "difference.js",
    "pyramid.js",
    "load.js",
    "lanes.js",
    "lane_ink.js",
    "ruler.js",
    "map.js",
    "cells.js",
    "drawing.js",
    "table.js",
    "deck.js",
    "list.js",
    "charts.js",
    "player.js",
    "keys.js",
    "start.js",
)


@cache
def style() -> str:
    """The page's style sheet, to stand between `<style>` and `</style>` as it is."""
    return _text("uplot/uPlot.min.css") + "\n" + _text("style.css")


@cache
def script() -> str:
    """The page's script, to stand last in the body as it is; it starts by itself.

    Its data are the JSON text of the element `gk-data` and of the elements `gk-episode-RUN-K`.
    """
    licence = "/*! uPlot\n" + _text("uplot/LICENSE").strip() + "\n*/\n"
    parts = "\n".join(f"// {name}\n{{\n{_text(f'player/{name}')}}}" for name in PARTS)
    opening = '(() => {\n"use strict";\nconst gk = {};\nwindow.gamekeeper = gk;\n'
    return f"{licence}{_text('uplot/uPlot.iife.min.js')}\n{opening}{parts}\n}})();\n"


def source_hash(text: str) -> str:
    """The name of an inline style or script in a Content-Security-Policy: `'sha256-…'`.

    Source: W3C Content Security Policy Level 3, 2.3.1 (hash-source).
    """
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _text(name: str) -> str:
    """One file of the folder `assets`."""
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")
