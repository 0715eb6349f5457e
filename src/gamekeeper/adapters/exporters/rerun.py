"""Rerun: a run as a recording (.rrd) that its viewer plays turn by turn.

| entity | what it is |
|---|---|
| `agents/NAME/reward`, `return` | series: what a step paid it, the sum in this episode so far |
| `agents/NAME/terms/TERM` | series, where the contract declares reward terms |
| `agents/NAME/action`, `action/PATH` | series; texts as a log |
| `agents/NAME/order` | series: its place among those who acted |
| `agents/NAME/obs`, `obs/PATH` | images as images, up to 32 numbers as series, more as a tensor, texts as a log |
| `agents/NAME/mask` | series, where infos hold masks |
| `agents/NAME/info`, `end`, `raised`, `nonconforming` | logs: infos (JSON), how it ended and why, exceptions, values that weren't of their space |
| `state`, `state/PATH` | `state()`, as observations |
| `frames` | rendered frames, where they were recorded |
| `episodes` | a log: number, seed, how each ended |
| `run` | the manifest: environment, seed, fingerprint (static) |

| timeline | what it is |
|---|---|
| `run_turn` | turns of the whole run, one after another: what the viewer plays |
| `episode`, `turn` | the episode, the turn in it |

| | |
|---|---|
| kept | every agent's rewards, terms, actions, observations, masks, orders, infos and ends at their turns; states; frames |
| changed | series are float64; a row without a value has no point |
| lost | wall times of turns; observations at level "digest"; frames that are neither PNG nor text |
| refused | nothing |

Source: the entities and timelines of rerun-sdk 0.41 (archetypes Scalars, Image, EncodedImage, Tensor, TextLog, TextDocument).
"""  # noqa: E501  # a row of a table is one line

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.adapters.export_source import (
    AgentRows,
    Export,
    LeafValues,
    Run,
    Say,
    agents_of,
    chosen,
    episodes_of,
    evidence_of,
    tell,
    to_stderr,
)
from gamekeeper.episodes.episode import Episode, Spaces
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import RunError, not_installed
from gamekeeper.runs.files.folder import output_path, system_error

SERIES: Final = 32  # numbers of a value that are still read as series, one each
SMALLEST: Final = 8  # sides of an array of bytes that counts as a picture
SHOWN: Final = 16  # agents in the views that the viewer opens with
CHANNELS: Final = {1: "L", 3: "RGB", 4: "RGBA"}


def export(
    run: Run,
    out: str | PathLike[str] | None,
    *,
    agents: Collection[str] | None = None,
    say: Say = to_stderr,
) -> Export:
    """Writes a run as a Rerun recording; memory stays flat however many episodes there are.

    `rerun FILE.rrd` plays it.

    Args:
        run: evidence, or the folder of a run.
        out: the file; `.rrd` is put behind it where it lacks that.
        agents: only these; None: all.
        say: takes a sentence for each loss.
    Raises:
        DependencyError: rerun-sdk isn't installed.
        RunError: there is no run, `out` is a folder or part of a run, or the disk refuses.
        EvidenceError: the run has no such agent, or no episode.
    """
    try:
        import rerun
    except ImportError as error:
        raise not_installed(error, "rerun-sdk", "rerun", "--to rerun") from error
    evidence = evidence_of(run)
    names = chosen(evidence, agents)
    path = output_path(out, suffix=".rrd")
    draft = path.with_name(path.name + ".part")
    stream = rerun.RecordingStream(
        f"gamekeeper {evidence.manifest['environment'].get('name')}",
        recording_id=evidence.fingerprint or None,
        send_properties=False,  # the only one would be the time of this export
    )
    stream.set_log_time_enabled(False)  # a run is played by its turns, not by when it was exported
    stream.set_log_tick_enabled(False)
    try:
        with _strict():  # what Rerun can't take raises, in place of a warning
            stream.save(fspath(draft), default_blueprint=_views(evidence, names))
            writer = _RerunWriter(stream, evidence, names)
            for episode in episodes_of(evidence):
                writer.add(episode)
            stream.flush()
        stream.disconnect()
        draft.replace(path)
    except BaseException as error:
        stream.disconnect()
        draft.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, RunError):
            raise system_error("writing", path, error) from error
        raise
    return Export(
        to="rerun",
        path=str(path),
        agents=tuple(names),
        episodes=evidence.episode_table.num_rows,
        rows=writer.rows,
        lost=tell(writer.lost(), say),
    )


@contextmanager
def _strict() -> Iterator[None]:
    """Sets Rerun's strict mode, which is one for the whole process, for the time of the block."""
    import rerun

    before = rerun.strict_mode()
    rerun.set_strict_mode(True)
    try:
        yield
    finally:
        rerun.set_strict_mode(before)


class _RerunWriter:
    def __init__(self, stream: Any, evidence: Evidence, names: Collection[str]) -> None:
        import rerun

        self.rr, self.stream, self.names, self.rows = rerun, stream, names, 0
        self._evidence, self._frames = evidence, _frames_of(evidence)
        self._before = self._strange_frames = self._episode = 0
        kept = ("environment", "seed", "status", "level", "terms", "fingerprint")
        about = {name: evidence.manifest.get(name) for name in kept}
        text = f"```json\n{json.dumps(about, indent=1)}\n```"
        document = rerun.TextDocument(text, media_type="text/markdown")
        stream.log("run", document, static=True, strict=True)

    def add(self, episode: Episode) -> None:
        """Adds one episode; its turns follow those of the one before."""
        self._episode, header = episode.episode, episode.header
        turns = max(len(episode), int(header.get("turns") or 0) + 1)
        self._log("episodes", np.array([0]), [f"episode {episode.episode}, seed {episode.seed}"])
        for rows in agents_of(episode, self.names):
            self._agent(rows, episode.endings.get(rows.agent))
        if episode.states is not None and episode.states.num_rows:
            states = AgentRows("state", episode.episode, episode.states, Spaces(None, None))
            self._values(["state"], states.turns, states.values_of("state", episode.state_codec))
        for turn, path in self._frames.get(episode.episode, ()):
            self._frame(turn, path)
        last = np.array([turns - 1])
        text = f"episode {episode.episode}: {header.get('end') or 'open'} after {turns - 1} turns"
        self._log("episodes", last, [text])
        if header.get("error"):
            self._log("episodes", last, [header["error"]], level="ERROR")
        self._before += turns

    def lost(self) -> list[str]:
        """Returns what the recording lacks, a sentence each."""
        found = []
        if self._evidence.manifest.get("level") == "digest":
            found.append("observations: the run was recorded at level 'digest'")
        if self._strange_frames:
            found.append(f"{self._strange_frames} frames that are neither PNG nor text")
        return found

    def _agent(self, rows: AgentRows, reason: str | None) -> None:
        place = ["agents", rows.agent]
        self.rows += len(rows)
        paid, was_paid = rows.numbers("reward")
        self._series([*place, "reward"], rows.turns[was_paid], paid[was_paid])
        self._series([*place, "return"], rows.turns[was_paid], np.cumsum(paid)[was_paid])
        for term in rows.terms:
            values, valid = rows.numbers(f"reward.{term}")
            self._series([*place, "terms", term], rows.turns[valid], values[valid])
        order, acted = rows.numbers("order")
        self._series([*place, "order"], rows.turns[acted], order[acted])
        self._values([*place, "obs"], rows.turns, rows.observations)
        self._values([*place, "action"], rows.turns, rows.actions)
        masks = rows.masks()
        has_mask = np.array([mask is not None for mask in masks], bool)
        known = [mask for mask in masks if mask is not None]
        if len({mask.shape for mask in known}) == 1:
            self._numbers([*place, "mask"], rows.turns[has_mask], np.stack(known))
        for name, level in (("info", "DEBUG"), ("raised", "ERROR"), ("nonconforming", "WARN")):
            self._texts([*place, name], rows.turns, rows.texts(name), level=level)
        ended = np.flatnonzero(rows.ended)
        if len(ended):
            row = int(ended[0])
            how = "terminated" if rows.numbers("terminated")[0][row] else "truncated"
            text = f"{rows.agent} {how}" + ("" if reason is None else f": {reason}")
            self._texts([*place, "end"], rows.turns[[row]], [text], level="INFO")

    def _values(self, place: list[str], turns: Any, values: LeafValues) -> None:
        """Logs every leaf in its own form, at the turns whose rows hold a value."""
        rows = np.flatnonzero(values.valid)
        for path, leaf in values.taken(rows).items() if len(rows) else ():
            below = [*place, *path.split("/")] if path else place
            if isinstance(leaf, list):
                self._texts(below, turns[rows], leaf, level="INFO")
            else:
                self._numbers(below, turns[rows], leaf)

    def _numbers(self, place: list[str], turns: Any, values: Any) -> None:
        count = int(np.prod(values.shape[1:], dtype=np.int64))
        if _is_picture(values):
            self._pictures(place, turns, values)
        elif 0 < count <= SERIES:
            self._series(place, turns, values.reshape(len(values), count))
        elif count:
            self._tensors(place, turns, values)

    def _tensors(self, place: list[str], turns: Any, values: Any) -> None:
        """Logs tensors one by one: Rerun has no columns of them."""
        path = self.rr.new_entity_path(place)
        self.stream.set_time("episode", sequence=self._episode)
        for turn, value in zip(turns.tolist(), values, strict=True):
            self.stream.set_time("run_turn", sequence=turn + self._before)
            self.stream.set_time("turn", sequence=turn)
            self.stream.log(path, self.rr.Tensor(value), strict=True)
        self.stream.reset_time()

    def _pictures(self, place: list[str], turns: Any, values: Any) -> None:
        height, width = values.shape[1:3]
        channels = values.shape[3] if values.ndim == 4 else 1
        form = self.rr.components.ImageFormat(
            width=width, height=height, color_model=CHANNELS[channels], channel_datatype="U8"
        )
        flat = np.ascontiguousarray(values).reshape(len(values), -1)
        columns = self.rr.Image.columns(buffer=flat, format=[form] * len(values))
        self._send(place, turns, columns)

    def _series(self, place: list[str], turns: Any, values: Any) -> None:
        if not len(turns):
            return
        flat = np.asarray(values, np.float64).reshape(len(turns), -1)
        columns = self.rr.Scalars.columns(scalars=flat.reshape(-1))
        lengths = [flat.shape[1]] * len(turns)
        self._send(place, turns, columns if flat.shape[1] == 1 else columns.partition(lengths))

    def _texts(self, place: list[str], turns: Any, texts: list[Any], *, level: str) -> None:
        logged = [(turn, text) for turn, text in zip(turns, texts, strict=True) if text]
        if logged:
            numbers, lines = zip(*logged, strict=True)
            path = self.rr.new_entity_path(place)
            self._log(path, np.array(numbers), list(lines), level=level)

    def _log(self, path: str, turns: Any, texts: list[str], *, level: str = "INFO") -> None:
        columns = self.rr.TextLog.columns(text=texts, level=[level] * len(texts))
        self.stream.send_columns(path, self._times(turns), columns, strict=True)

    def _send(self, place: list[str], turns: Any, columns: Any) -> None:
        path = self.rr.new_entity_path(place)
        self.stream.send_columns(path, self._times(turns), columns, strict=True)

    def _times(self, turns: Any) -> list[Any]:
        turns = np.asarray(turns, np.int64)
        return [
            self.rr.TimeColumn("run_turn", sequence=turns + self._before),
            self.rr.TimeColumn("episode", sequence=np.full(len(turns), self._episode)),
            self.rr.TimeColumn("turn", sequence=turns),
        ]

    def _frame(self, turn: int, path: Path) -> None:
        data = path.read_bytes()
        if path.suffix == ".png":
            columns = self.rr.EncodedImage.columns(
                blob=[np.frombuffer(data, np.uint8)], media_type=["image/png"]
            )
        elif path.suffix == ".txt":
            columns = self.rr.TextDocument.columns(text=[data.decode(errors="replace")])
        else:
            self._strange_frames += 1
            return
        self._send(["frames"], np.array([turn]), columns)


def _is_picture(values: Any) -> bool:
    """True for bytes [rows, height, width(, channels)] that are large enough to see."""
    if values.dtype != np.uint8 or values.ndim not in (3, 4) or min(values.shape[1:3]) < SMALLEST:
        return False
    return values.ndim == 3 or values.shape[3] in CHANNELS


def _frames_of(evidence: Evidence) -> Mapping[int, list[tuple[int, Path]]]:
    """Returns the files of rendered frames by episode, with their turns, in order."""
    found: dict[int, list[tuple[int, Path]]] = {}
    files = () if evidence.path is None else (Path(evidence.path) / "frames").glob("*-*.*")
    for path in sorted(files):
        episode, _, turn = path.stem.partition("-")
        if episode.isdigit() and turn.isdigit() and not path.is_symlink():
            found.setdefault(int(episode), []).append((int(turn), path))
    return found


def _views(evidence: Evidence, names: Collection[str]) -> Any:
    """Layout that the viewer opens with: returns, rewards, frames, logs, played over `run_turn`."""
    import rerun
    from rerun import blueprint

    some = list(names)[:SHOWN]

    def series(name: str) -> Any:
        paths = [rerun.new_entity_path(["agents", agent, name]) for agent in some]
        return blueprint.TimeSeriesView(origin="/", contents=paths, name=f"{name}s")

    pictures = [blueprint.Spatial2DView(origin="/frames")] if _frames_of(evidence) else []
    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Vertical(series("return"), series("reward")),
            blueprint.Vertical(*pictures, blueprint.TextLogView(origin="/", name="log")),
        ),
        blueprint.TimePanel(timeline="run_turn"),
    )
