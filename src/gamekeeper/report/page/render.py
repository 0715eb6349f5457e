"""A page as HTML: templates that escape by themselves, data that no reader takes for markup."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gamekeeper.report.page.assets import script, source_hash, style
from gamekeeper.report.page.data import Page
from gamekeeper.report.page.pack import in_base64

DRAWN_BY_SCRIPT: Final = ("line", "bars")
ESCAPED: Final = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}
"""What a browser might take for markup, in a JSON text; U+2028 and U+2029 are ASCII already."""

PICTURES: Final = {
    **{code: chr(0x2400 + code) for code in range(0x20) if chr(code) not in "\t\n\r"},
    0x7F: "\u2421",
    **dict.fromkeys([*range(0x80, 0xA0), *range(0xD800, 0xE000)], "\ufffd"),
}
"""What stands for a sign that HTML can't hold. Source: Unicode, Control Pictures."""


def render(page: Page) -> str:
    """The whole page in one text: nothing in it asks for anything from anywhere.

    Args:
        page: what it shows. In `is_view` the script may ask where the page came from.
    """
    template = _environment().get_template("page.html.j2")
    look, code = style(), script()
    return template.render(
        page=page,
        policy=policy_of(look, code, is_view=page.is_view),
        style=Markup(look),
        script=Markup(code),
        data=json_text(data_of(page)),
        packed=[
            (f"gk-episode-{run}-{episode}", in_base64(data))
            for (run, episode), data in page.packed.items()
        ],
        episodes=page.episodes,
        runs=[run.to_json() for run in page.runs],
    )


def policy_of(look: str, code: str, *, is_view: bool) -> str:
    """The page's Content-Security-Policy: its own script and style, and no request."""
    connect = "'self'" if is_view else "'none'"
    return (
        f"default-src 'none'; script-src {source_hash(code)}; style-src {source_hash(look)}; "
        f"img-src data:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )


def data_of(page: Page) -> dict[str, Any]:
    """What the page's script reads."""
    charts = {
        chart["id"]: chart
        for section in page.sections
        for block in section.shown
        for chart in block.charts
        if chart["kind"] in DRAWN_BY_SCRIPT
    }
    return {
        "title": page.title,
        "runs": [run.to_json() for run in page.runs],
        "episodes": list(page.episodes),
        "charts": charts,
        **page.extra,
    }


def json_text(value: Mapping[str, Any]) -> Markup:
    """JSON that may stand in a script element: ASCII, and without any sign of markup."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign, escaped in ESCAPED.items():
        text = text.replace(sign, escaped)
    return Markup(text)


def without_controls(value: Any) -> Any:
    """A text's control characters as pictures of them: in HTML they are errors, NUL first."""
    if isinstance(value, str) and not isinstance(value, Markup) and not value.isprintable():
        return value.translate(PICTURES)
    return value


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("gamekeeper.report.page"),
        autoescape=True,
        finalize=without_controls,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
