"""A page as HTML, from templates that escape all text; its provenance section."""

import base64
import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import GamekeeperError
from gamekeeper.interface.identity import spec_of
from gamekeeper.reporting.page.learning_section import profile_of
from gamekeeper.reporting.page.packed_episode import in_base64
from gamekeeper.reporting.page.page_data import Cell, Page, PageBlock, PageSection, PageTable
from gamekeeper.reporting.results_text import few, origin_facts
from gamekeeper.runs.standing import policy_words

# Each part may use what those before it put into `gk`.
PARTS: Final = (
    *("theme.js", "nodes.js", "episode.js", "difference.js", "pyramid.js", "load.js", "legend.js"),
    *("lanes.js", "lane_ink.js", "ruler.js", "scene.js", "map.js", "cells.js", "drawing.js"),
    *("table.js", "timeline.js", "deck.js", "gallery.js", "list.js", "charts.js"),
    *("icons.js", "fan.js", "play_on.js", "jumps.js", "player.js", "keys.js", "start.js"),
)


@cache
def style() -> str:
    """The page's style sheet, for the element `<style>`."""
    return _text("uplot/uPlot.min.css") + "\n" + _text("style.css")


@cache
def script() -> str:
    """The page's script, for the end of the body; it starts by itself.

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
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


DRAWN_BY_SCRIPT: Final = ("line", "bars")
ESCAPED: Final = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}
"""Characters of JSON that a browser might take for markup; U+2028 and U+2029 are ASCII already."""

PICTURES: Final = {
    **{code: chr(0x2400 + code) for code in range(0x20) if chr(code) not in "\t\n\r"},
    0x7F: "\u2421",
    **dict.fromkeys([*range(0x80, 0xA0), *range(0xD800, 0xE000)], "\ufffd"),
}
"""Substitutes of characters that HTML can't hold. Source: Unicode, Control Pictures."""


def render(page: Page) -> str:
    """The whole page in one text, which loads nothing from the network."""
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
    """The page's Content-Security-Policy: only its own script and style, without requests."""
    connect = "'self'" if is_view else "'none'"
    return (
        f"default-src 'none'; script-src {source_hash(code)}; style-src {source_hash(look)}; "
        f"img-src data:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )


def data_of(page: Page) -> dict[str, Any]:
    """The data that the page's script reads."""
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
    """JSON for a script element: ASCII, and without any character of markup."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign, escaped in ESCAPED.items():
        text = text.replace(sign, escaped)
    return Markup(text)


def without_controls(value: Any) -> Any:
    """Replaces control characters by pictures of them: in HTML they are errors."""
    if isinstance(value, str) and not isinstance(value, Markup) and not value.isprintable():
        return value.translate(PICTURES)
    return value


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("gamekeeper.reporting.page"),
        autoescape=True,
        finalize=without_controls,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


MOST_SEEDS: Final = 200
"""Episodes whose seeds are listed."""


def provenance_section(
    runs: Sequence[tuple[str, str, Evidence]], *, version: str, audit: Mapping[str, Any] | None
) -> PageSection:
    """Facts, versions, seeds and commands of every run.

    Args:
        runs: letter, folder as it was named, evidence.
        version: of gamekeeper, which writes the page.
        audit: adds its command.
    """
    blocks = []
    for key, path, evidence in runs:
        blocks.append(
            PageBlock(
                title=f"Run {key}: {path}" if len(runs) > 1 else "",
                facts=tuple(_facts(evidence)),
                snippets=(("Commands", "\n".join(commands(evidence, path, audit))),),
                anchor=f"again-{key}",
            )
        )
        blocks.append(
            PageBlock(title="Episodes and seeds", tables=(_seeds(evidence),), folded=True)
        )
    if len(runs) > 1:
        lines = [f"gamekeeper diff {quoted(runs[0][1])} {quoted(each[1])}" for each in runs[1:]]
        blocks.append(
            PageBlock(title="Compare", snippets=(("Compare", "\n".join(lines)),), anchor="compare")
        )
    blocks.append(PageBlock(notes=(f"Written by gamekeeper {version}.",)))
    return PageSection("provenance", "Provenance", tuple(blocks))


def _facts(evidence: Evidence) -> list[tuple[str, str]]:
    environment: Mapping[str, Any] = evidence.manifest.get("environment") or {}
    last = max(evidence.episode_table.num_rows - 1, 0)
    ends = [
        *evidence.episode_table.slice(0, 1).to_pylist(),
        *evidence.episode_table.slice(last).to_pylist(),
    ]
    policies = dict.fromkeys(text for header in ends for text in profile_of(header).values())
    return [
        ("environment", f"{environment.get('name')} ({environment.get('entry_point')})"),
        ("arguments", json.dumps(environment.get("kwargs") or {}, sort_keys=True)),
        ("source digest", str(environment.get("source_digest") or "none")),
        ("status", str(evidence.manifest.get("status", "in memory"))),
        ("policies", few(policies) or "not named"),
        *origin_facts(evidence),
    ]


def commands(evidence: Evidence, path: str, audit: Mapping[str, Any] | None) -> list[str]:
    """Lines that record the same again, replay it, verify it, audit its environment.

    Names from evidence are quoted, so that a line does only what it shows.
    """
    run, env = quoted(path), env_words(evidence)
    named = "" if env else " --env module:factory   # it was an object in memory"
    lines = [f"gamekeeper verify {run}", f"gamekeeper replay {run}{named}"]
    if env is None:
        return lines
    record = (
        f"gamekeeper rollout {env}"
        f"{''.join(f' {quoted(word)}' for word in policy_words(evidence))}"
        f" --episodes {evidence.episode_table.num_rows}"
    )
    seed = evidence.manifest.get("seed")
    if seed is not None:
        again = f"{path.rstrip('/')}-again"
        lines += [
            f"{record} --seed {seed} --out {quoted(again)}",
            f"gamekeeper diff {run} {quoted(again)}",
        ]
    audited = f" --seed {audit.get('seed')}" if audit is not None else ""
    return [*lines, f"gamekeeper audit {env}{audited}"]


def env_words(evidence: Evidence) -> str | None:
    """The environment and its arguments as commands name them; None of an object in memory."""
    try:
        spec = spec_of(evidence.manifest.get("environment") or {})
    except GamekeeperError:
        return None
    kwargs = evidence.manifest["environment"].get("kwargs") or {}
    given = f" --kwargs {quoted(json.dumps(kwargs, sort_keys=True))}" if kwargs else ""
    return f"{quoted(spec)}{given}"


def quoted(text: str) -> str:
    """Quotes one word of a shell; line ends would end it, so they are written out."""
    return shlex.quote(text.replace("\n", "\\n").replace("\r", "\\r"))


def _seeds(evidence: Evidence) -> PageTable:
    headers = evidence.episode_table.slice(0, MOST_SEEDS).to_pylist()
    # at level actions the rows of a finalized run tell them, and they aren't stored
    without = "none yet" if evidence.manifest.get("status") == "open" else "not stored"
    rows = tuple(
        (
            Cell(str(header["episode"]), "number"),
            Cell("-" if header["seed"] is None else str(header["seed"]), "number"),
            Cell("" if header["turns"] is None else str(header["turns"]), "number"),
            Cell(str(header["end"] or "open")),
            Cell(header["fingerprint"] or without, "code"),
        )
        for header in headers
    )
    more = evidence.episode_table.num_rows - len(headers)
    note = f"The first {MOST_SEEDS}; {more} more are in the run." if more > 0 else ""
    columns = ("episode", "seed", "steps", "end", "fingerprint")
    return PageTable("Episodes and seeds", columns, rows, note)
