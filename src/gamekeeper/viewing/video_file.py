"""Writes an episode as mp4 (H.264) and gif.

| | |
|---|---|
| kept | every frame, in the order of turns; actions, rewards and their sums below it |
| changed | frames of several sizes stand in the middle of the largest; a see-through one on white; small ones are enlarged by a whole number; a gif has 256 colours and whole hundredths of a second a frame |
| lost | sound, which environments don't have; frames that are neither picture nor text |
| refused | a run without frames that isn't rendered; a file that exists |
"""  # noqa: E501  # a row of a table is one line

import io
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError, not_installed
from gamekeeper.runs.consent import consented, evidence_of
from gamekeeper.runs.files.folder import output_path, read_bounded
from gamekeeper.runs.replay_runner import check_named
from gamekeeper.viewing.video_frames import recorded, rendered

FRAME_BYTES: Final = 1 << 28
LEAST: Final = 320
"""Least pixels of the longer side; smaller frames are enlarged by a whole number."""
MOST_PIXELS: Final = 1 << 26
"""Most pixels of a frame; codecs can't play larger ones."""
LINE: Final = 12
MARGIN: Final = 4
GLYPH: Final = 6
"""Pixels of Pillow's own font: height of a line, margin of the caption, width of a character."""
MOST_AGENTS: Final = 12
"""Agents whose actions stand below a frame; the others are counted."""
BACKGROUND: Final = (255, 255, 255)
INK: Final = (20, 20, 20)
CAPTION: Final = (238, 238, 238)


def pillow() -> Any:
    """Pillow's module of images.

    Raises:
        DependencyError: it isn't installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise not_installed(error, "Pillow", "video", "video") from error
    return Image


def picture_of(path: Path) -> Any:
    """A frame's file as an RGB picture.

    Raises:
        RunError: it isn't a picture, or is too large to be played.
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
    except Exception as error:  # decoders raise anything on damage
        raise RunError(
            f"{path.name} can't be shown",
            where=str(path),
            actual=str(error)[:200],
            fix="record the run again, or render it with --render",
        ) from error
    ground = image.new("RGBA", whole.size, (*BACKGROUND, 255))
    return image.alpha_composite(ground, whole).convert("RGB")


def size_for(sizes: Sequence[tuple[int, int]], lines: int, width: int) -> tuple[int, int, int]:
    """Width, height and enlargement of all pictures of a video, both sides even for the codec.

    Args:
        sizes: of the frames.
        lines: number of lines below them.
        width: characters of the longest line.
    """
    wide, high = max(size[0] for size in sizes), max(size[1] for size in sizes)
    scale = max(-(-LEAST // max(wide, high)), 1)
    across = max(wide * scale, width * GLYPH + 2 * MARGIN if lines else 0)
    down = high * scale + (lines * LINE + 2 * MARGIN if lines else 0)
    return across + across % 2, down + down % 2, scale


def composed(frame: Any, lines: Sequence[str], size: tuple[int, int, int]) -> Any:
    """A picture of that size, with the frame in the middle and the lines below it."""
    image = pillow()
    across, down, scale = size
    whole = image.new("RGB", (across, down), BACKGROUND)
    large = frame.resize((frame.width * scale, frame.height * scale), image.Resampling.NEAREST)
    height = len(lines) * LINE + 2 * MARGIN if lines else 0
    whole.paste(large, ((across - large.width) // 2, (down - height - large.height) // 2))
    if lines:
        whole.paste(image.new("RGB", (across, height), CAPTION), (0, down - height))
        _draw(whole, lines, MARGIN, down - height + MARGIN)
    return whole


def captions_of(episode: Episode) -> dict[int, list[str]]:
    """Captions of the frames by turn: actions of the turn before, rewards and their sums."""
    names = list(dict.fromkeys(str(a) for turn in episode.turns for a in turn.agents))
    shown, rest = names[:MOST_AGENTS], names[MOST_AGENTS:]
    wide = max(map(len, map(one_line, shown)), default=0)
    totals = dict.fromkeys(names, 0.0)
    head = f"episode {episode.episode}, turn 0"
    found = {0: _lines(head, shown, rest, wide, {}, {}, totals)}
    for turn in episode.turns:
        for agent, paid in turn.rewards.items():
            totals[str(agent)] = totals.get(str(agent), 0.0) + (paid or 0.0)
        head = f"episode {episode.episode}, turn {turn.index + 1}"
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
        action = _short(acted[name]) if name in acted else "-"
        reward = f"{paid[name]:+.3g}" if paid.get(name) else ""
        lines.append(f"{one_line(name):<{wide}}  {action:<14}  {reward:>8}  sum {totals[name]:.4g}")
    if rest:
        lines.append(f"... and {len(rest)} more agents")
    return lines


def _short(action: Any) -> str:
    values = json.dumps(
        action, default=lambda x: getattr(x, "tolist", x.__str__)(), separators=(",", ":")
    )
    text = one_line(values)
    return text if len(text) <= 14 else f"{text[:12]}.."


def _written(lines: Sequence[str]) -> Any:
    """A text as a picture, each character in a cell of its own."""
    image = pillow()
    wide = max(map(len, lines), default=0)
    size = (max(wide, 1) * GLYPH + 2 * MARGIN, max(len(lines), 1) * LINE + 2 * MARGIN)
    if size[0] * size[1] > MOST_PIXELS:
        raise RunError(
            "a frame's text is too long to be shown",
            actual=f"{len(lines)} lines",
            fix="record the run with render_mode rgb_array",
        )
    found = image.new("RGB", size, BACKGROUND)
    _draw(found, lines, MARGIN, MARGIN)
    return found


def _draw(picture: Any, lines: Sequence[str], left: int, top: int) -> None:
    from PIL import ImageDraw, ImageFont

    # The font inside Pillow: all characters have one width, and only Latin-1 is in it.
    font = getattr(ImageFont, "load_default_imagefont", ImageFont.load_default)()
    draw = ImageDraw.Draw(picture)
    for number, line in enumerate(lines):
        text = line.expandtabs().encode("latin-1", "replace").decode("latin-1")
        draw.text((left, top + number * LINE), text, fill=INK, font=font)


def pictures(
    frames: Sequence[tuple[int, Path]], captions: Mapping[int, Sequence[str]]
) -> Iterator[Any]:
    """The pictures of a video, one after another, all of one size.

    Args:
        frames: turns and files.
        captions: lines below each frame, by turn; empty: without lines.
    """
    sizes = list({picture_of(path).size for _, path in frames})
    lines = max((len(caption) for caption in captions.values()), default=0)
    width = max((len(line) for caption in captions.values() for line in caption), default=0)
    size = size_for(sizes, lines, width)
    for turn, path in frames:
        caption = list(captions.get(turn, ()))
        yield composed(picture_of(path), caption + [""] * (lines - len(caption)), size)


FPS: Final = 10.0
"""Frames per second by default."""
FORMS: Final = (".mp4", ".gif")
QUALITY: Final = "20"
"""H.264's constant rate factor: below 18 differences can't be seen, above 28 lines blur."""
SILENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class VideoFile:
    """An episode that was written as a video.

    Attributes:
        run: the folder of the run.
        fps: frames per second.
        size: width and height in pixels.
        source: `recorded`, or `rendered` by a replay.
        divergence: first difference of that replay from the run; None where there is none.
    """

    run: str
    episode: int
    paths: tuple[str, ...]
    frames: int
    fps: float
    size: tuple[int, int]
    source: str
    divergence: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper video --json` prints."""
        return fields_json(self)

    def __str__(self) -> str:
        size = f"{self.size[0]} x {self.size[1]} pixels"
        text = f"{self.frames} frames, {size}, {self.fps:g} per second"
        return "\n".join([f"episode {self.episode}, {self.source}: {text}", *self.paths])


@dataclass(frozen=True, slots=True)
class VideoRendering:
    """Options of playing an episode again and rendering it.

    Attributes:
        env: name of the environment; None: the recorded one.
        allow_import: allow code that only the run names.
        timeout_s: longest time without a turn, in seconds.
        on_message: is called with reports of progress.
    """

    env: str | None = None
    allow_import: bool = False
    timeout_s: float | None = SILENCE_S
    on_message: Callable[[dict[str, Any]], None] | None = None


def film(
    run: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    episode: int | None = None,
    fps: float | None = None,
    rendering: VideoRendering | None = None,
    has_strip: bool = True,
) -> VideoFile:
    """Writes an episode of a run as a video.

    Args:
        run: the folder of the run.
        out: a file (.mp4 or .gif), or a folder for both; None: beside the run.
        episode: its number; None: the first that has frames, or with `rendering` the first.
        fps: frames per second; None: the environment's `render_fps` where it is rendered, else 10.
        rendering: plays the episode again and renders it, even if frames were recorded; None: the
            recorded frames.
        has_strip: write actions and rewards below each frame.
    Raises:
        EvidenceError: the run has no frames, or no such episode.
        SpecError: `rendering.env` is an environment or a factory in place of its name.
        TrustError: rendering would run code that the user hasn't allowed.
        DependencyError: Pillow or imageio-ffmpeg isn't installed.
        RunError: the run is missing, a frame is damaged, or a file exists already.
    """
    evidence = evidence_of(run)
    known: dict[int, list[tuple[int, Path]]] = {}
    if rendering is None:
        known = recorded(evidence)
    else:
        check_named(rendering.env)
    number = _episode(evidence, episode, known, render=rendering is not None)
    paths = _paths(run, out, number)
    if ".mp4" in {path.suffix for path in paths}:
        _ffmpeg()  # a missing package is reported before anything is played
    pillow()
    source, divergence, own = "recorded", None, None
    with tempfile.TemporaryDirectory(prefix="gamekeeper-video-") as folder:
        frames = known.get(number, [])
        if rendering is not None:
            with consented(
                evidence,
                doing="rendering this run",
                env=rendering.env,
                allow_import=rendering.allow_import,
            ):
                frames, own, divergence = rendered(
                    Path(fspath(run)),
                    number,
                    Path(folder),
                    env=rendering.env,
                    silence_s=rendering.timeout_s,
                    on_message=rendering.on_message,
                )
            source = "rendered"
        if not frames:
            raise _without_frames(evidence, number, render=rendering is not None)
        captions = captions_of(evidence.episode(number)) if has_strip else {}
        rate = fps or own or FPS
        size = (0, 0)
        for path in paths:
            size = _write(path, lambda: pictures(frames, captions), rate)
    names = tuple(map(str, paths))
    return VideoFile(fspath(run), number, names, len(frames), rate, size, source, divergence)


def _episode(evidence: Evidence, asked: int | None, known: dict[int, Any], *, render: bool) -> int:
    numbers = evidence.episode_table["episode"].to_pylist()
    if asked is not None:
        return int(evidence.header(asked)["episode"])
    with_frames = [number for number in numbers if number in known]
    if not with_frames and not (render and numbers):
        raise _without_frames(evidence, None, render=False)
    return int((with_frames or numbers)[0])


def _paths(run: str | PathLike[str], out: str | PathLike[str] | None, episode: int) -> list[Path]:
    if out is not None and Path(fspath(out)).suffix:
        path = Path(fspath(out))
        if path.suffix not in FORMS:
            raise GamekeeperError(
                "the ending of the name isn't a known video format",
                where=str(path),
                expected=" or ".join(FORMS),
                actual=path.suffix,
                fix=f"--out {path.with_suffix('.mp4')}",
            )
        return [output_path(path)]
    whole = Path(fspath(run))
    folder = whole.parent if out is None else Path(fspath(out))
    stem = f"{whole.resolve().name}-episode-{episode}"
    return [output_path(folder / f"{stem}{form}") for form in FORMS]


def _write(path: Path, make: Callable[[], Iterator[Any]], fps: float) -> tuple[int, int]:
    """Writes a file under another name first, so that it never exists in part."""
    draft = path.with_name(f".{path.stem}.tmp{path.suffix}")
    try:
        size = (_mp4 if path.suffix == ".mp4" else _gif)(draft, make(), fps)
        draft.replace(path)
    finally:
        with suppress(FileNotFoundError):
            draft.unlink()
    return size


def _mp4(path: Path, frames: Iterable[Any], fps: float) -> tuple[int, int]:
    writer, size = None, (0, 0)
    try:
        for frame in frames:
            if writer is None:
                size = frame.size
                writer = _ffmpeg().write_frames(
                    str(path),
                    size,
                    fps=fps,
                    codec="libx264",
                    pix_fmt_in="rgb24",
                    pix_fmt_out="yuv420p",
                    macro_block_size=2,
                    quality=None,
                    ffmpeg_log_level="error",
                    output_params=["-crf", QUALITY, "-movflags", "+faststart"],
                )
                writer.send(None)
            writer.send(frame.tobytes())
    finally:
        if writer is not None:
            writer.close()
    return size


def _gif(path: Path, frames: Iterator[Any], fps: float) -> tuple[int, int]:
    first = next(frames)
    first.save(
        path,
        save_all=True,
        append_images=frames,
        loop=0,
        duration=max(round(100 / fps), 2) * 10,
        optimize=False,
    )
    return (int(first.width), int(first.height))


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]  # it ships no types
    except ImportError as error:
        raise not_installed(
            error, "imageio-ffmpeg", "video", "video", "; a gif (--out x.gif) needs Pillow alone"
        ) from error
    return imageio_ffmpeg


def _without_frames(evidence: Evidence, episode: int | None, *, render: bool) -> EvidenceError:
    subject = "the run" if episode is None else f"episode {episode}"
    if render:
        return EvidenceError(
            f"the replay of {subject} rendered no frame",
            where=str(evidence.path),
            fix="its render() returned None; check the environment's render_mode",
        )
    return EvidenceError(
        f"{subject} has no frames",
        where=str(evidence.path),
        expected="frames/*.png",
        fix="--render plays an episode again and renders it; `rollout --frames` records frames",
    )
