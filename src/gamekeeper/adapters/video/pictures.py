"""Frames as pictures of one size: text drawn, small ones enlarged, what was done written below."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.contract.places import one_line
from gamekeeper.core.trace import Trace
from gamekeeper.errors import BundleError, DependencyError
from gamekeeper.record.files.folder import read_bounded

FRAME_BYTES: Final = 1 << 28
LEAST: Final = 320
"""Pixels that the longer side has at least; smaller frames are enlarged by a whole number."""
MOST_PIXELS: Final = 1 << 26
"""Of a frame; beyond, no codec plays it."""
LINE: Final = 12
MARGIN: Final = 4
GLYPH: Final = 6
"""Pixels of Pillow's own font: height of a line, margin of the strip, width of a sign."""
MOST_AGENTS: Final = 12
"""Agents whose actions stand below a frame; the others are counted."""
BACKGROUND: Final = (255, 255, 255)
INK: Final = (20, 20, 20)
STRIP: Final = (238, 238, 238)


def pillow() -> Any:
    """Pillow's module of images.

    Raises:
        DependencyError: it isn't installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise DependencyError(
            "Pillow isn't installed", where="video", seen=str(error),
            mend="pip install 'gamekeeper[video]'",
        ) from error  # fmt: skip
    return Image


def picture_of(path: Path) -> Any:
    """A frame's file as an RGB picture.

    Raises:
        BundleError: it is no picture, or too large to be played.
    """
    data = read_bounded(path, FRAME_BYTES)
    if path.suffix == ".txt":
        return _written(data.decode(errors="replace").splitlines())
    image = pillow()
    try:
        opened = image.open(io.BytesIO(data), formats=["PNG"])
        if opened.width * opened.height > MOST_PIXELS:
            raise ValueError(f"{opened.width} x {opened.height} pixels")
        whole = opened.convert("RGBA")
    except Exception as error:  # what a decoder raises on damage is no closed list
        raise BundleError(
            f"{path.name} can't be shown", where=str(path), seen=str(error)[:200],
            mend="record the run again, or render it with --render",
        ) from error  # fmt: skip
    ground = image.new("RGBA", whole.size, (*BACKGROUND, 255))
    return image.alpha_composite(ground, whole).convert("RGB")


def size_for(sizes: Sequence[tuple[int, int]], strip: int, width: int) -> tuple[int, int, int]:
    """Width, height and enlargement of all pictures of a film, both sides even.

    Args:
        sizes: of the frames.
        strip: lines below them.
        width: signs of the longest line.
    """
    wide, high = max(size[0] for size in sizes), max(size[1] for size in sizes)
    scale = max(-(-LEAST // max(wide, high)), 1)
    across = max(wide * scale, width * GLYPH + 2 * MARGIN if strip else 0)
    down = high * scale + (strip * LINE + 2 * MARGIN if strip else 0)
    return across + across % 2, down + down % 2, scale


def composed(frame: Any, lines: Sequence[str], size: tuple[int, int, int]) -> Any:
    """A picture of that size: the frame at the top, in the middle; the lines below it."""
    image = pillow()
    across, down, scale = size
    whole = image.new("RGB", (across, down), BACKGROUND)
    large = frame.resize((frame.width * scale, frame.height * scale), image.Resampling.NEAREST)
    strip = len(lines) * LINE + 2 * MARGIN if lines else 0
    whole.paste(large, ((across - large.width) // 2, (down - strip - large.height) // 2))
    if lines:
        whole.paste(image.new("RGB", (across, strip), STRIP), (0, down - strip))
        _draw(whole, lines, MARGIN, down - strip + MARGIN)
    return whole


def strips_of(trace: Trace) -> dict[int, list[str]]:
    """What stands below the frame of each turn: who did what to come there, and what it paid."""
    names = list(dict.fromkeys(str(a) for turn in trace.turns for a in turn.agents))
    shown, rest = names[:MOST_AGENTS], names[MOST_AGENTS:]
    wide = max(map(len, map(one_line, shown)), default=0)
    totals = dict.fromkeys(names, 0.0)
    head = f"episode {trace.episode}, turn 0"
    found = {0: _lines(head, shown, rest, wide, {}, {}, totals)}
    for turn in trace.turns:
        for agent, paid in turn.rewards.items():
            totals[str(agent)] = totals.get(str(agent), 0.0) + (paid or 0.0)
        head = f"episode {trace.episode}, turn {turn.index + 1}"
        acted = {str(agent): turn.actions.get(agent) for agent in turn.order}
        found[turn.index + 1] = _lines(head, shown, rest, wide, acted, turn.rewards, totals)
    return found


def _lines(
    head: str,
    names: Sequence[str],
    rest: Sequence[str],
    wide: int,
    acted: Mapping[str, Any],
    paid: Mapping[Any, float],
    totals: Mapping[str, float],
) -> list[str]:
    lines = [head]
    for name in names:
        did = _short(acted[name]) if name in acted else "-"
        got = paid.get(name)
        told = "" if not got else f"{got:+.3g}"
        lines.append(f"{one_line(name):<{wide}}  {did:<14}  {told:>8}  sum {totals[name]:.4g}")
    if rest:
        lines.append(f"... and {len(rest)} more agents")
    return lines


def _short(action: Any) -> str:
    text = one_line(str(action.tolist() if hasattr(action, "tolist") else action))
    return text if len(text) <= 14 else f"{text[:12]}.."


def _written(lines: Sequence[str]) -> Any:
    """A text as a picture, each sign in a cell of its own."""
    image = pillow()
    wide = max(map(len, lines), default=0)
    size = (max(wide, 1) * GLYPH + 2 * MARGIN, max(len(lines), 1) * LINE + 2 * MARGIN)
    if size[0] * size[1] > MOST_PIXELS:
        raise BundleError("a frame's text is too long to be shown", seen=f"{len(lines)} lines")
    found = image.new("RGB", size, BACKGROUND)
    _draw(found, lines, MARGIN, MARGIN)
    return found


def _draw(picture: Any, lines: Sequence[str], left: int, top: int) -> None:
    from PIL import ImageDraw, ImageFont

    # The font that comes inside Pillow: every sign has one width; beyond Latin-1 it has none.
    font = getattr(ImageFont, "load_default_imagefont", ImageFont.load_default)()
    draw = ImageDraw.Draw(picture)
    for number, line in enumerate(lines):
        text = line.expandtabs().encode("latin-1", "replace").decode("latin-1")
        draw.text((left, top + number * LINE), text, fill=INK, font=font)


def pictures(
    frames: Sequence[tuple[int, Path]], strips: Mapping[int, Sequence[str]]
) -> Iterator[Any]:
    """The pictures of a film, one after another, all of one size.

    Args:
        frames: turns and files.
        strips: by turn, what stands below; empty: nothing.
    """
    sizes = list({picture_of(path).size for _, path in frames})
    lines = max((len(strip) for strip in strips.values()), default=0)
    width = max((len(line) for strip in strips.values() for line in strip), default=0)
    size = size_for(sizes, lines, width)
    for turn, path in frames:
        strip = list(strips.get(turn, ())) if strips else []
        yield composed(picture_of(path), strip + [""] * (lines - len(strip)), size)
