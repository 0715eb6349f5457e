"""Writes an episode as mp4 (H.264) and gif.

| | |
|---|---|
| kept | every frame, in the order of turns; actions, rewards and their sums below it |
| changed | frames of several sizes stand in the middle of the largest; a see-through one on white; small ones are enlarged by a whole number; a gif has 256 colours and whole hundredths of a second a frame |
| lost | sound, which no environment has; frames that are neither picture nor text |
| refused | a run without frames that isn't rendered; a file that exists |
"""  # noqa: E501  # a row of a table is one line

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.export import free_path
from gamekeeper.adapters.video.frames import check_trust, recorded, rendered
from gamekeeper.adapters.video.pictures import pictures, pillow, strips_of
from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import DependencyError, EvidenceError, GamekeeperError
from gamekeeper.record.bundle import load
from gamekeeper.record.stage import check_named

FPS: Final = 10.0
"""Frames a second where nobody names a number."""
FORMS: Final = (".mp4", ".gif")
QUALITY: Final = "20"
"""H.264's constant rate factor: below 18 nobody sees a difference, above 28 lines blur."""
SILENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Film:
    """An episode that was written as a film.

    Attributes:
        run: the folder of the run.
        episode: which.
        paths: the files.
        frames: how many there are.
        fps: frames a second.
        size: width and height in pixels.
        source: `recorded`, or `rendered` by a replay.
        divergence: where that replay differs from the run; None where it doesn't.
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
        found = {name: getattr(self, name) for name in self.__slots__}
        return {**found, "paths": list(self.paths), "size": list(self.size)}

    def __str__(self) -> str:
        told = f"{self.frames} frames, {self.size[0]} x {self.size[1]}, {self.fps:g} a second"
        return "\n".join([f"episode {self.episode}, {self.source}: {told}", *self.paths])


def film(
    run: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    episode: int | None = None,
    fps: float | None = None,
    render: bool = False,
    has_strip: bool = True,
    env: str | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Film:
    """Writes an episode of a run as a film.

    Args:
        run: the folder of the run.
        out: a file (.mp4 or .gif), or a folder for both; None: beside the run.
        episode: which; None: the first that has frames, rendered the first.
        fps: frames a second; None: the environment's own where it is rendered, else 10.
        render: play the episode again and render it, whether frames were recorded or not.
        has_strip: actions and rewards stand below each frame.
        env: the name of what is rendered in place of what the evidence names.
        allow_import: render code that the evidence names.
        timeout_s: longest time without a turn while it is rendered.
        on_message: takes reports of progress.
    Raises:
        EvidenceError: there is nothing to show, or no such episode.
        SpecError: `env` is an environment or a factory in place of its name.
        TrustError: rendering would run code that nobody allowed to run.
        DependencyError: Pillow or imageio-ffmpeg isn't installed.
        BundleError: there is no bundle, a frame is damaged, or a file is there already.
    """
    check_named(env)
    evidence = load(run)
    kept = {} if render else recorded(evidence)
    number = _episode(evidence, episode, kept, render=render)
    paths = _paths(run, out, number)
    if ".mp4" in {path.suffix for path in paths}:
        _ffmpeg()  # before anything is played
    pillow()
    source, divergence, own = "recorded", None, None
    with tempfile.TemporaryDirectory(prefix="gamekeeper-video-") as folder:
        frames = kept.get(number, [])
        if render:
            check_trust(evidence, env=env, allow_import=allow_import)
            frames, own, divergence = rendered(
                Path(fspath(run)), number, Path(folder), env=env, silence_s=timeout_s,
                on_message=on_message,
            )  # fmt: skip
            source = "rendered"
        if not frames:
            raise _nothing(evidence, number, render=render)
        strips = strips_of(evidence.trace(number)) if has_strip else {}
        rate = fps or own or FPS
        size = (0, 0)
        for path in paths:
            size = _write(path, lambda: pictures(frames, strips), rate)
    told = tuple(map(str, paths))
    return Film(fspath(run), number, told, len(frames), rate, size, source, divergence)


def _episode(evidence: Evidence, asked: int | None, kept: dict[int, Any], *, render: bool) -> int:
    numbers = evidence.episodes["episode"].to_pylist()
    if asked is not None and asked not in numbers:
        raise EvidenceError(
            f"the run has no episode {asked}", where="--episode",
            expected=f"one of {len(numbers)} episodes", seen=str(asked),
        )  # fmt: skip
    if asked is not None:
        return asked
    if not numbers:
        raise EvidenceError("the run has no episode", where=str(evidence.path))
    with_frames = [number for number in numbers if number in kept]
    if not with_frames and not render:
        raise _nothing(evidence, None, render=False)
    return int((with_frames or numbers)[0])


def _paths(run: str | PathLike[str], out: str | PathLike[str] | None, episode: int) -> list[Path]:
    """The files to write, none of which is there yet."""
    if out is not None and Path(fspath(out)).suffix:
        path = Path(fspath(out))
        if path.suffix not in FORMS:
            raise GamekeeperError(
                "no form of film is known for that name", where=str(path),
                expected=" or ".join(FORMS), seen=path.suffix,
            )  # fmt: skip
        return [free_path(path)]
    whole = Path(fspath(run))
    folder = whole.parent if out is None else Path(fspath(out))
    stem = f"{whole.resolve().name}-episode-{episode}"
    return [free_path(folder / f"{stem}{form}") for form in FORMS]


def _write(path: Path, make: Callable[[], Iterator[Any]], fps: float) -> tuple[int, int]:
    """Writes one file under another name first, so that half a film is never there."""
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
                    str(path), size, fps=fps, codec="libx264", pix_fmt_in="rgb24",
                    pix_fmt_out="yuv420p", macro_block_size=2, quality=None,
                    ffmpeg_log_level="error",
                    output_params=["-crf", QUALITY, "-movflags", "+faststart"],
                )  # fmt: skip
                writer.send(None)
            writer.send(frame.tobytes())
    finally:
        if writer is not None:
            writer.close()
    return size


def _gif(path: Path, frames: Iterator[Any], fps: float) -> tuple[int, int]:
    first = next(frames)
    first.save(
        path, save_all=True, append_images=frames, loop=0, duration=max(round(100 / fps), 2) * 10,
        optimize=False,
    )  # fmt: skip
    return (int(first.width), int(first.height))


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]  # it ships no types
    except ImportError as error:
        raise DependencyError(
            "imageio-ffmpeg isn't installed", where="video", seen=str(error),
            mend="pip install 'gamekeeper[video]'; a gif (--out x.gif) needs Pillow alone",
        ) from error  # fmt: skip
    return imageio_ffmpeg


def _nothing(evidence: Evidence, episode: int | None, *, render: bool) -> EvidenceError:
    which = "the run" if episode is None else f"episode {episode}"
    if render:
        return EvidenceError(
            f"the replay of {which} rendered no frame", where=str(evidence.path),
            mend="its render() gave nothing; try the environment's own render_mode",
        )  # fmt: skip
    return EvidenceError(
        f"{which} has no frames", where=str(evidence.path), expected="frames/*.png",
        mend="--render plays it again and renders it; record with --frames to keep them",
    )  # fmt: skip
