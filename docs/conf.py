"""How Sphinx builds these pages: `make docs`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "src"))

project = "Gamekeeper"
author = "The Gamekeeper authors"
copyright = "the Gamekeeper authors; MIT licence"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.intersphinx"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "Gamekeeper"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_custom_sections = ["Source", ("Twins", "notes_style"), ("Facts", "notes_style")]

# The names that these pages refer to, kept here so that a build needs no network.
intersphinx_mapping = {
    "gymnasium": ("https://gymnasium.farama.org/", "inventories/gymnasium.inv"),
    "pettingzoo": ("https://pettingzoo.farama.org/", "inventories/pettingzoo.inv"),
    "python": ("https://docs.python.org/3/", "inventories/python.inv"),
}

LINK = re.compile(r"\]\(([\w./-]+)\.md[)#]")
ANY_LINK = re.compile(r"\[([^\]]*)\]\(([\w./-]+)(#[\w-]*)?\)")


def within(app: Sphinx, page: str, text: list[str]) -> None:
    """Names files of the repository that aren't pages here, where a page links to them."""
    folder = (HERE / page).parent

    def told(link: re.Match[str]) -> str:
        target = (folder / link[2]).resolve()
        if target.is_dir() or (target.exists() and not target.is_relative_to(HERE)):
            return f"{link[1]} (`{target.relative_to(HERE.parent)}`)"
        return link[0]

    text[0] = ANY_LINK.sub(told, text[0])


def with_contents(app: Sphinx, page: str, text: list[str]) -> None:
    """Adds what a browser's side bar is made of; pages that are read as files don't need it.

    The first page lists every page that it links to, in that order; the checks' page the checks.
    """
    if page == "index":
        linked = dict.fromkeys(LINK.findall(text[0]))
        listed = [each for each in linked if not each.startswith("..")]
        rest = sorted(app.env.found_docs - set(listed) - {"index"})
        listed += [each for each in rest if not each.startswith("checks/")]
        text[0] += _toctree(listed)
    elif page == "checks/index":
        text[0] += _toctree(sorted(set(re.findall(r"\((GK\d+)\.md\)", text[0]))))


def _toctree(pages: list[str]) -> str:
    return "\n".join(["", "```{toctree}", ":hidden:", "", *pages, "```", ""])


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.connect("source-read", within)
    app.connect("source-read", with_contents)
