"""What `metadata` says, and whether it says the same once the environment was used."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.canon import to_json
from gamekeeper.run.episode import Play

SHARE: Final = 0.2
MOST_TURNS: Final = 20
MOST_MODES: Final = 3


def plays(lab: Lab) -> Iterator[Play]:
    """One short play."""
    yield from lab.plays(1, most_turns=MOST_TURNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Metadata before and after a play, a render and further instances.

    Facts:
        `metadata`: `kind` (its type), `fields` (name, render_modes, render_fps, is_parallelizable
            where they are there), `own` (the mode in use).
        `metadata after`: its canonical text `before`, and `after` each of [what was done, in which
            mode, text].
    """
    env = lab.env()
    metadata = getattr(env, "metadata", None)
    before = to_json(metadata)
    lab.play(play, env)
    own = getattr(env, "render_mode", None)
    fields = dict(metadata) if isinstance(metadata, dict) else {}
    yield lab.fact(
        "metadata", {"kind": type(metadata).__name__, "fields": dict(fields), "own": own},
        field="metadata",
    )  # fmt: skip
    after: list[tuple[str, str | None, str]] = [
        ("play", None, to_json(getattr(env, "metadata", None)))
    ]
    if own is not None and own != "human":
        lab.call("render", env.render)
        after.append(("render", None, to_json(getattr(env, "metadata", None))))
    if lab.can_make:
        lab.call("make", lab.make)
        after.append(("make", None, to_json(getattr(env, "metadata", None))))
        for mode in _modes(fields):
            lab.call("make", lab.make, render_mode=mode)
            after.append(("make", mode, to_json(getattr(env, "metadata", None))))
    yield lab.fact("metadata after", {"before": before, "after": after}, field="metadata")


def _modes(fields: dict[str, Any]) -> list[str]:
    """Modes in which further instances are built; "human" needs a screen."""
    declared = fields.get("render_modes")
    listed = declared if isinstance(declared, list | tuple) else ()
    return [mode for mode in listed if isinstance(mode, str) and mode != "human"][:MOST_MODES]
