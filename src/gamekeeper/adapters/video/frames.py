"""The frames of an episode: those that were recorded, or those of a replay that renders."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.canon import from_json, is_exact
from gamekeeper.core.divergence import compare
from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import EnvError, EvidenceError, GamekeeperError, SpecError, TrustError
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import distrust
from gamekeeper.game.opening.identity import spec_of
from gamekeeper.game.opening.opened import Opened
from gamekeeper.record.bundle import load
from gamekeeper.record.files.folder import inside, reading
from gamekeeper.record.frames import encode_frame
from gamekeeper.record.rendered import open_rendered
from gamekeeper.record.stage import compact
from gamekeeper.record.tasks import error_fields, error_of
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.rerun import replay_trace
from gamekeeper.run.workers import run_task

TASK: Final = "gamekeeper.adapters.video.frames:render_task"
FOLDER: Final = "frames"
NAME: Final = re.compile(r"(\d{6,})-(\d{6,})\.(png|txt)")
"""Files of frames that a film can show: episode, turn, picture or text."""


def recorded(evidence: Evidence) -> dict[int, list[tuple[int, Path]]]:
    """The frames of a run by episode, each with its turn, in their order.

    Raises:
        BundleError: the folder of frames leads out of the bundle.
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


def check_trust(evidence: Evidence, *, env: str | None, allow_import: bool) -> None:
    """Raises where rendering would run code that nobody allowed to run.

    Raises:
        TrustError: the evidence names such an environment.
    """
    identity = evidence.manifest.get("environment")
    given = identity if isinstance(identity, Mapping) else {}
    reason = None if allow_import or env is not None else distrust(given)
    if reason is not None:
        raise TrustError(
            "rendering this run would execute code that its evidence names",
            where=str(evidence.path), seen=reason,
            mend="if you trust it, say --allow-import; or name the environment with --env",
        )  # fmt: skip


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
        episode: which.
        out: an empty folder, which the frames go into.
        env: open this in place of what the evidence names.
        silence_s: longest time without a turn.
        on_message: takes reports of progress.
    Returns:
        The frames with their turns; the environment's own frames a second, None if it names none;
        where the replay differs from the run, None where it doesn't.

    Raises:
        GamekeeperError: it can't be replayed, or renders nothing.
        KeyboardInterrupt: by Ctrl-C.
    """
    arguments: dict[str, Any] = {
        "path": str(run), "episode": episode, "out": str(out), "env": env
    }  # fmt: skip
    outcome = run_task(TASK, arguments, silence_s=silence_s, on_message=on_message)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    value = outcome.value
    if not isinstance(value, dict):
        raise EnvError(f"rendering the replay {outcome.status}", seen=outcome.error or "")
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
        return {"error": error_fields(error), "fps": None, "divergence": None}
    metadata = getattr(opened.env, "metadata", None)
    fps = metadata.get("render_fps") if isinstance(metadata, Mapping) else None
    is_number = isinstance(fps, int | float) and 0 < fps < 1000
    return {"error": None, "fps": fps if is_number else None, "divergence": divergence}


class _Film(MemorySink):
    """Writes the frames of one episode into a folder."""

    __slots__ = ("folder", "wanted")
    folder: Path
    wanted: int

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Writes a frame of the wanted episode."""
        if episode == self.wanted:
            suffix, data = encode_frame(frame)
            (self.folder / f"{episode:06d}-{turn:06d}.{suffix}").write_bytes(data)


def _opened(evidence: Evidence, env: str | None) -> Opened:
    """The environment with the recorded arguments, but one that renders into pictures."""
    identity = evidence.manifest["environment"]
    text = compact(identity.get("kwargs") or {})
    if env is None and not is_exact(text):
        raise SpecError(
            "an argument of the environment was an object that no text can build again",
            where="kwargs", seen=text[:200], mend="name the environment with --env",
        )  # fmt: skip
    given: Any = from_json(text)
    kwargs = {name: value for name, value in given.items() if name != "render_mode"}
    return open_rendered(spec_of(identity) if env is None else env, kwargs)


def _played(
    evidence: Evidence, opened: Opened, episode: int, out: Path, report: Callable[..., None]
) -> str | None:
    """Plays the episode, and those before it that it ran on from; says where it differs."""
    header = next(h for h in evidence.episodes.to_pylist() if h["episode"] == episode)
    if header["since"] is None or header["since"] < 0:
        raise EvidenceError(
            f"episode {episode} was reset without a seed, so it can't be played again",
            where=str(evidence.path), mend="record with seeds, or with --frames",
        )  # fmt: skip
    sink = _Film(
        terms=tuple(evidence.manifest.get("terms") or ()),
        volatile=evidence.contract.volatile_infos(),
    )
    sink.folder, sink.wanted = out, episode
    has_state = evidence.tables.table("states") is not None
    game = game_of(opened.env, sink=sink, frames=True, state=has_state)
    try:
        for number in range(header["since"], episode + 1):
            trace = evidence.trace(number)
            game.episode = number - 1
            replay_trace(
                trace, game,
                agents={seat.name: agent for agent, seat in sink.layout.seats.items()},
                types=evidence.manifest.get("action_types"),
                after_turn=report,
            )  # fmt: skip
            again = sink.evidence(opened.identity, contract=evidence.contract)
    finally:
        game.close()
    found = compare(trace, next(again.traces), volatile=evidence.contract.volatile_infos())
    return None if found.divergence is None else str(found.divergence)
