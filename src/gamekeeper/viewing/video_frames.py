"""The frames of an episode: those that were recorded, or those of a replay that renders."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.episodes.canonical import from_json, is_exact
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EnvError, GamekeeperError, SpecError
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.identity import spec_of
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.rollouts.reruns import replayed_episode
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.files.folder import inside, reading
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import encode_frame
from gamekeeper.runs.recording import open_rendered
from gamekeeper.runs.replay_runner import compact
from gamekeeper.runs.reset_chain import chain_of
from gamekeeper.runs.worker_errors import error_of

TASK: Final = "gamekeeper.viewing.video_frames:render_task"
FOLDER: Final = "frames"
NAME: Final = re.compile(r"(\d{6,})-(\d{6,})\.(png|txt)")
"""Names of files of frames: episode, turn, picture or text."""


def recorded(evidence: Evidence) -> dict[int, list[tuple[int, Path]]]:
    """The frames of a run by episode, each with its turn, in their order.

    Raises:
        RunError: the folder of frames leads out of the run.
    """
    found: dict[int, list[tuple[int, Path]]] = {}
    if evidence.path is None:
        return found
    run = Path(evidence.path)
    folder = inside(run, FOLDER)
    if not folder.is_dir():
        return found
    with reading(folder):
        names = sorted(path.name for path in folder.iterdir())
    for name in names:
        parts = NAME.fullmatch(name)
        if parts is not None:
            path = inside(run, f"{FOLDER}/{name}")
            found.setdefault(int(parts[1]), []).append((int(parts[2]), path))
    return {episode: sorted(frames) for episode, frames in found.items()}


def rendered(
    run: Path,
    episode: int,
    out: Path,
    *,
    env: str | None,
    silence_s: float | None,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> tuple[list[tuple[int, Path]], float | None, str | None]:
    """Plays an episode again in a worker, rendering each turn into files.

    Args:
        run: the folder of the run.
        out: an empty folder for the frames.
        env: name of the environment; None: the recorded one.
        silence_s: longest time without a turn, in seconds.
        on_message: is called with reports of progress.
    Returns:
        The frames with their turns; the environment's `render_fps`, or None; the first difference
        of the replay from the run, or None.

    Raises:
        GamekeeperError: it can't be replayed, or renders nothing.
        KeyboardInterrupt: by Ctrl-C.
    """
    arguments: dict[str, Any] = {"path": str(run), "episode": episode, "out": str(out), "env": env}
    outcome = run_task(TASK, arguments, silence_s=silence_s, on_message=on_message)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    value = outcome.value
    if not isinstance(value, dict):
        raise EnvError(
            f"rendering the replay {outcome.status}",
            actual=outcome.error or "",
            fix="make render() of the environment work in a process without a display",
        )
    if value["error"] is not None:
        raise error_of(value["error"])
    parts = [(NAME.fullmatch(path.name), path) for path in sorted(out.iterdir())]
    found = [(int(match[2]), path) for match, path in parts if match is not None]
    return found, value["fps"], value["divergence"]


# -- in the worker


def render_task(
    report: Callable[..., None], *, path: str, episode: int, out: str, env: str | None
) -> dict[str, Any]:
    """Plays an episode again and writes its frames into `out`.

    Returns:
        `fps`, `divergence`, and `error`: its fields, or None.
    """
    try:
        evidence = load(path)
        opened = _opened(evidence, env)
        divergence = _played(evidence, opened, episode, Path(out), report)
    except GamekeeperError as error:
        return {"error": error.to_json(), "fps": None, "divergence": None}
    metadata = getattr(opened.env, "metadata", None)
    fps = metadata.get("render_fps") if isinstance(metadata, Mapping) else None
    is_number = isinstance(fps, int | float) and 0 < fps < 1000
    return {"error": None, "fps": fps if is_number else None, "divergence": divergence}


class _FrameWriter(MemorySink):
    __slots__ = ("folder", "wanted")
    folder: Path
    wanted: int

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Writes a frame of the wanted episode."""
        if episode == self.wanted:
            suffix, data = encode_frame(frame)
            (self.folder / f"{episode:06d}-{turn:06d}.{suffix}").write_bytes(data)


def _opened(evidence: Evidence, env: str | None) -> Opened:
    """Opens the environment with the recorded arguments and a render_mode for pictures."""
    identity = evidence.manifest["environment"]
    text = compact(identity.get("kwargs") or {})
    if env is None and not is_exact(text):
        raise SpecError(
            "an argument of the environment was an object that can't be built from text",
            where="kwargs",
            actual=text[:200],
            fix="name the environment with --env",
        )
    given: Any = from_json(text)
    kwargs = {name: value for name, value in given.items() if name != "render_mode"}
    return open_rendered(spec_of(identity) if env is None else env, kwargs)


def _played(
    evidence: Evidence, opened: Opened, episode: int, out: Path, report: Callable[..., None]
) -> str | None:
    """Plays the episode, after those since the last seed; returns the first difference."""
    header = next(h for h in evidence.episode_table.to_pylist() if h["episode"] == episode)
    chain = chain_of(header, frozenset(evidence.episode_table["episode"].to_pylist()))
    sink = _FrameWriter(
        terms=tuple(evidence.manifest.get("terms") or ()),
        volatile=evidence.contract.volatile_infos(),
    )
    sink.folder, sink.wanted = out, episode
    has_state = evidence.tables.table("states") is not None
    capture = capture_of(opened.env, sink=sink, frames=True, state=has_state)
    try:
        for number in (*chain, episode):
            recorded = evidence.episode(number)
            capture.episode = number - 1
            replayed_episode(
                recorded,
                capture,
                agents={each.name: agent for agent, each in sink.layout.agents.items()},
                types=evidence.manifest.get("action_types"),
                after_turn=report,
            )
            again = sink.evidence(opened.identity, contract=evidence.contract)
    finally:
        capture.close()
    found = compare(recorded, again.episodes[0], volatile=evidence.contract.volatile_infos())
    return None if found.divergence is None else str(found.divergence)
