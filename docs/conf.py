"""How Sphinx builds these pages: `make docs`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from docutils import nodes
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
html_static_path = ["_static"]
html_js_files = ["landmarks.js"]
html_search_scorer = str(HERE / "_static/scorer.js")  # a page whose title was asked for comes first
highlight_language = "none"  # a block without a language is output
smartquotes_action = "qe"  # quotes and ellipses; `--out` isn't a dash
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"
default_role = "code"  # one backtick in a docstring means what it means in Markdown
napoleon_custom_sections = ["Source", ("Counterfactuals", "notes_style"), ("Facts", "notes_style")]

# The names that these pages refer to, kept here so that a build needs no network.
intersphinx_mapping = {
    "gymnasium": ("https://gymnasium.farama.org/", "inventories/gymnasium.inv"),
    "pettingzoo": ("https://pettingzoo.farama.org/", "inventories/pettingzoo.inv"),
    "python": ("https://docs.python.org/3/", "inventories/python.inv"),
}

LINK = re.compile(r"\[([^\]]+)\]\(([\w./-]+)\.md[)#]")
HOMES = {"checks/GK": "checks/index", "findings/": "zoo"}
"""Pages of which there are too many for a side bar, by how their names begin: the page of all."""
suppress_warnings = ["toc.not_included"]  # these pages; a test holds that all others are listed
ENTRIES = "All pages"
"""The heading of the first page under which the entries of the side bar stand."""
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

    The first page lists its entries, and each of these that has pages of its own the pages that it
    links to, by the link's text up to a colon.
    """
    entries = _links((HERE / "index.md").read_text(encoding="utf-8").partition(ENTRIES)[2])
    if page == "index":
        text[0] += _toctree([f"{_short(title)} </{x}>" for x, title in entries.items()])
    elif page in entries and "/" not in page:
        pages = {x: title for x, title in _links(text[0]).items() if x in app.env.found_docs}
        others = [x for x in pages if x not in entries]
        text[0] += _toctree([f"{_short(pages[x])} </{x}>" for x in others])
    for names, home in HOMES.items():
        if page.startswith(names):
            text[0] += f"\n\nBack to [all of them](/{home}.md).\n"


def _links(text: str) -> dict[str, str]:
    """The pages that a text links to, each with the words of its first link."""
    found: dict[str, str] = {}
    for title, to in LINK.findall(text):
        found.setdefault(to, title)
    return found


def _short(title: str) -> str:
    """A title for the side bar: up to its colon, without marks; a name stays as it is."""
    title = title.partition(":")[0].replace("`", "")
    return title[:1].upper() + title[1:] if " " in title and "_" not in title else title


def _toctree(pages: list[str]) -> str:
    if not pages:
        return ""
    return "\n".join(["", "```{toctree}", ":hidden:", "", *pages, "```", ""])


def in_rest(app: Sphinx, *about: object) -> None:
    """Writes the tables and samples of a docstring, which are Markdown, as autodoc reads them."""
    lines = about[-1]
    assert isinstance(lines, list)
    rest: list[str] = []
    is_sample = is_table = False
    for line in lines:
        if line.startswith("```"):
            is_sample = not is_sample
            rest += [f".. code-block:: {line[3:]}", ""] if is_sample else [""]
        elif is_sample:
            rest.append(f"   {line}")
        elif line.startswith("|"):
            rest += _table_row(line, is_first=not is_table)
        else:
            rest.append(line)
        is_table = not is_sample and line.startswith("|")
    lines[:] = rest


def _table_row(line: str, *, is_first: bool) -> list[str]:
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    row = [f"   {'-' if place else '* -'} {cell}" for place, cell in enumerate(cells)]
    row[1:] = [f"  {cell}" for cell in row[1:]]
    if is_first:
        return [".. list-table::", *(["   :header-rows: 1", "", *row] if any(cells) else [""])]
    return [] if set(line) <= set("|- ") else row


def in_both_schemes(app: Sphinx, page: nodes.document) -> None:
    """Puts the dark picture beside each named `…-light.png`; the theme shows one of them."""
    folder = Path(app.env.doc2path(app.env.docname)).parent
    for image in list(page.findall(nodes.image)):
        dark = image["uri"].replace("-light.png", "-dark.png")
        if dark != image["uri"] and (folder / dark).exists():
            other = image.deepcopy()
            other["uri"] = dark
            image["classes"].append("only-light")
            other["classes"].append("only-dark")
            image.parent.insert(image.parent.index(image) + 1, other)


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.connect("doctree-read", in_both_schemes, priority=400)  # before images are collected
    app.connect("autodoc-process-docstring", in_rest, priority=400)  # before napoleon
    app.connect("source-read", within)
    app.connect("source-read", with_contents)
