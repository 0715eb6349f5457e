"""Minari data sets that grow episode by episode, and all agents of a Parallel episode as one.

Also the check that Minari can write a space and read the same one back.
"""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.export_source import AgentRows, LeafValues, nested
from gamekeeper.adapters.gymnasium import nothing
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.episode import Spaces
from gamekeeper.episodes.spaces import Codec
from gamekeeper.errors import EvidenceError, RunError

Space = spaces.Space[Any]


def check_space(space: Space | None, *, whose: str) -> Space:
    """Returns the space, if a Minari data set of it reads back the same.

    Raises:
        EvidenceError: it doesn't.
    """
    fault = "evidence names no space" if space is None else _fault(space) or _fault_of_text(space)
    if space is None or fault is not None:
        raise EvidenceError(
            "Minari can't hold a space",
            where=whose,
            actual=str(fault),
            expected="Box, Discrete, MultiDiscrete, MultiBinary, Text; Dict and Tuple of them",
            fix="`--to numpy` holds any space; --agent leaves others out",
        )
    return space


def _fault(space: Space) -> str | None:
    """Returns the part of a space that HDF5 can't hold; None where it can hold all."""
    if isinstance(space, spaces.Dict | spaces.Tuple):
        is_dict = isinstance(space, spaces.Dict)
        bad = [key for key in space.spaces if not is_key(key)] if is_dict else []
        if bad:
            return f"a Dict with the key {bad[0]!r}"
        parts = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
        return next(filter(None, map(_fault, parts)), None)
    if isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        return None if math.prod(space.shape) else f"{space!r:.120}, which has no element"
    return None if isinstance(space, spaces.Discrete | spaces.Text) else f"{space!r:.120}"


def is_key(key: object) -> bool:
    """Tells whether HDF5 takes a key as the name of one thing."""
    return isinstance(key, str) and key not in ("", ".", "..") and not set(key) & {"/", "\0"}


def _fault_of_text(space: Space) -> str | None:
    from minari.serialization import deserialize_space, serialize_space

    try:
        again = deserialize_space(serialize_space(space))
        is_same = bool(again == space) and _dtypes(again) == _dtypes(space)
    except Exception as error:  # whatever Minari raises, the space can't be written
        return f"{space!r:.120} ({type(error).__name__}: {error})"
    return None if is_same else f"{space!r:.120}, read back as {again!r:.120}"


def _dtypes(space: Space) -> list[Any]:
    if isinstance(space, spaces.Dict):
        return [_dtypes(space.spaces[key]) for key in sorted(space.spaces)]
    if isinstance(space, spaces.Tuple):
        return [_dtypes(part) for part in space.spaces]
    return [space.dtype]


WAITING_BYTES: Final = 32 << 20  # of episodes that aren't written yet, of all data sets together
TEXT: Final = 32_000  # characters of an attribute: HDF5 takes 64 kB


@dataclass(slots=True)
class DataSet:
    """One data set in the making.

    Attributes:
        id: as `minari.load_dataset` takes it.
        storage: Minari's own writer of it.
    """

    id: str
    storage: Any
    episodes: int = 0
    steps: int = 0
    _waiting: list[tuple[Any, Mapping[str, Any]]] = field(default_factory=list)

    def add(self, buffer: Any, attributes: Mapping[str, Any]) -> None:
        """Adds an episode."""
        self._waiting.append((buffer, attributes))
        self.episodes += 1
        self.steps += len(buffer.rewards)

    def flush(self) -> None:
        """Writes the episodes that wait."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        first = self.episodes - len(waiting)
        self.storage.update_episodes([buffer for buffer, _ in waiting])
        attributes = [dict(each) for _, each in waiting]
        self.storage.update_episode_metadata(attributes, range(first, self.episodes))


@dataclass(slots=True)
class DataSets:
    """Data sets of one export; `discard` deletes all that was made."""

    root: Path
    namespace: str
    sets: dict[str, DataSet] = field(default_factory=dict)
    _made: list[Path] = field(default_factory=list)
    _waiting_bytes: int = 0

    def begin(self, name: str, observation: Any, action: Any, metadata: Mapping[str, Any]) -> None:
        """Makes an empty data set.

        Raises:
            RunError: there is one of that id.
        """
        from minari import __version__
        from minari.dataset.minari_storage import MinariStorage

        own = re.sub(r"[^\w-]", "_", name) or "_"
        while f"{self.namespace}/{own}-v0" in {each.id for each in self.sets.values()}:
            own += "_"
        dataset_id = f"{self.namespace}/{own}-v0"
        folder = self.root / dataset_id
        if folder.exists():
            raise RunError(
                "there is a data set of that id",
                where=str(folder),
                fix="choose another --out, or move that one away first",
            )
        self._make(folder / "data")
        storage = MinariStorage.new(
            folder / "data",
            observation_space=observation,
            action_space=action,
            data_format="hdf5",
            jpeg_encoding=False,
        )
        head = {"dataset_id": dataset_id, "minari_version": __version__}
        storage.update_metadata({**head, **metadata})
        self.sets[name] = DataSet(dataset_id, storage)

    def add(self, name: str, buffer: Any, attributes: Mapping[str, Any], size: int) -> None:
        """Puts an episode of `size` bytes behind those of a data set."""
        self.sets[name].add(buffer, attributes)
        self._waiting_bytes += size
        if self._waiting_bytes >= WAITING_BYTES:
            self.flush()

    def flush(self) -> None:
        """Writes all episodes that wait."""
        for each in self.sets.values():
            each.flush()
        self._waiting_bytes = 0

    def discard(self) -> None:
        """Deletes every folder that was made."""
        for path in reversed(self._made):
            shutil.rmtree(path, ignore_errors=True)

    def _make(self, folder: Path) -> None:
        """Makes a folder, and the note that Minari puts into each of its namespaces."""
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True)
        self._made += missing[-1:]
        part = self.root
        for step in self.namespace.split("/"):
            part = part / step
            note = part / "namespace_metadata.json"
            if not note.exists():
                note.write_text("{}", encoding="utf-8")


def attributes_of(header: Mapping[str, Any], agent: str | None) -> dict[str, Any]:
    """Header of an episode, of one agent or of all, as attributes that HDF5 takes."""
    texts = {"end": header.get("end"), "fingerprint": header.get("fingerprint")}
    for name in ("options", "endings", "policies", "action_types"):
        text = header.get(name)
        if text is not None and agent is not None and name != "options":
            own = json.loads(text).get(agent)
            text = None if own is None else own if isinstance(own, str) else to_json(own)
        texts[name] = text
    given = {name: text for name, text in texts.items() if text and len(text) <= TEXT}
    return {f"gamekeeper/{name}": text for name, text in given.items()} | {
        "gamekeeper/episode": int(header["episode"])
    }


@dataclass(frozen=True, slots=True)
class MinariEpisode:
    """Columns of one episode of a data set, n steps long.

    Attributes:
        observations: n + 1; by agent where the data set is of all agents.
        actions: n, likewise.
        rewards: [n], of all agents their sum.
        ends: [2, n] terminated and truncated.
        infos: by field, n + 1 (of all agents: by field and agent).
    """

    observations: Mapping[str, Any]
    actions: Mapping[str, Any]
    rewards: Any
    ends: Any
    infos: Mapping[str, Any]


def together_of(
    found: Mapping[str, AgentRows], known: Mapping[str, Spaces], names: list[str]
) -> MinariEpisode | None:
    """Returns the episode of all agents; None without a decision that an observation follows.

    Raises:
        EvidenceError: an observation, an action or a reward of an agent isn't of its space.
    """
    last_action, last_seen = -1, -1  # turns
    for rows in found.values():
        _check(rows)
        last_action = max([last_action, *rows.turns[rows.decided].tolist()])
        last_seen = max([last_seen, *rows.turns[rows.observations.valid].tolist()])
    ticks = min(last_action + 1, last_seen)
    if ticks < 1:
        return None
    parts = {name: _Part(found.get(name), known[name], ticks) for name in names}
    ended = [part for part in parts.values() if part.is_there]
    is_terminated = any(part.fields["terminated"][ticks] for part in ended)
    ends = np.zeros((2, ticks), bool)
    ends[:, -1] = is_terminated, not is_terminated
    return MinariEpisode(
        observations={name: part.observations for name, part in parts.items()},
        actions={name: part.actions for name, part in parts.items()},
        rewards=np.sum([part.fields["paid"][:ticks] for part in parts.values()], axis=0),
        ends=ends,
        infos={
            name: {agent: part.fields[name] for agent, part in parts.items() if name in part.fields}
            for name in dict.fromkeys(field for part in parts.values() for field in part.fields)
        },
    )


class _Part:
    """One agent's part of an episode of all agents, a place for each tick and one more."""

    def __init__(self, rows: AgentRows | None, known: Spaces, ticks: int) -> None:
        assert known.observation is not None  # the data set's space was made of them
        assert known.action is not None
        self.is_there = rows is not None
        count = ticks + 1
        self.fields: dict[str, Any] = {
            "live": np.zeros(count, bool),
            "given": np.zeros(count, bool),
            "order": np.full(count, -1, np.int16),
            "cumulative_reward": np.zeros(count),
            "terminated": np.zeros(count, bool),
            "truncated": np.zeros(count, bool),
            "paid": np.zeros(count),
            "was_paid": np.zeros(count, bool),
            "saw": np.zeros(count, bool),
            "has_terms": np.zeros(count, bool),
            "info": [""] * count,
        }
        if rows is None:
            self.observations = _filled(known.observation, None, (), (), count)
            self.actions = _filled(known.action, None, (), (), ticks)
            return
        kept = np.flatnonzero(rows.turns < count)
        turns = rows.turns[kept]
        sees = kept[rows.observations.valid[kept]]
        acts = kept[rows.decided[kept] & (turns < ticks)]
        self.observations = _filled(
            known.observation, rows.observations, sees, rows.turns[sees], count
        )
        self.actions = _filled(known.action, rows.actions, acts, rows.turns[acts], ticks)
        self._fill(rows, kept, turns, acts)

    def _fill(self, rows: AgentRows, kept: Any, turns: Any, acts: Any) -> None:
        fields = self.fields
        for name in ("live", "cumulative_reward", "terminated", "truncated"):
            fields[name][turns] = rows.numbers(name)[0][kept]
        fields["given"][turns] = rows.numbers("terminated")[1][kept]
        fields["order"][rows.turns[acts]] = rows.numbers("order")[0][acts]
        fields["paid"][turns] = rows.numbers("reward")[0][kept]
        fields["was_paid"][turns] = rows.numbers("reward")[1][kept]
        fields["saw"][turns] = rows.observations.valid[kept]
        fields["paid"][-1] = fields["was_paid"][-1] = 0  # that step isn't in the data set
        texts, masks = rows.texts("info"), rows.masks()
        for row, turn in zip(kept.tolist(), turns.tolist(), strict=True):
            fields["info"][turn] = texts[row] or ""
        for term in rows.terms:
            paid = fields.setdefault("terms", {})[term] = np.zeros(len(fields["paid"]))
            paid[turns] = rows.paid_by(term)[kept]
            paid[-1] = 0.0
            fields["has_terms"][turns] = rows.numbers(f"reward.{term}")[1][kept]
        fields["has_terms"][-1] = False
        kinds = {(mask.dtype.str, mask.shape) for mask in masks if mask is not None}
        if len(kinds) == 1:
            dtype, shape = kinds.pop()
            fields["action_mask"] = np.zeros((len(fields["paid"]), *shape), dtype)
            for row, turn in zip(kept.tolist(), turns.tolist(), strict=True):
                if masks[row] is not None:
                    fields["action_mask"][turn] = masks[row]


def _filled(codec: Codec, values: LeafValues | None, rows: Any, turns: Any, count: int) -> Any:
    """Returns values at their turns, zeros elsewhere, in the form of their space."""
    leaves: dict[str, Any] = {}
    blanks = codec.pack(nothing(codec.space)) or [0] * len(codec.leaves)
    for leaf, blank in zip(codec.leaves, blanks, strict=True):
        taken = None if values is None else values.leaves[leaf.path]
        if leaf.kind in ("text", "json"):
            texts = [""] * count
            for row, turn in zip(rows, turns, strict=True):
                texts[turn] = taken[row]  # type: ignore[index]  # rows come of values
            leaves[leaf.path] = texts
            continue
        whole = np.zeros((count, *leaf.shape), leaf.dtype)
        if leaf.kind == "int":
            whole[:] = blank
        if taken is not None:
            whole[turns] = taken[rows]
        leaves[leaf.path] = whole
    return nested(codec.space, leaves, codec)


def _check(rows: AgentRows) -> None:
    for row, text in enumerate(rows.texts("nonconforming")):
        strange = {} if text is None else rows.nonconforming(row)
        bad = next(
            (name for name in ("obs", "action", "reward") if "value" in strange.get(name, {})), None
        )
        if bad is not None:
            raise EvidenceError(
                f"a value of {rows.agent!r} isn't of its space",
                where=f"episode {rows.episode}, turn {rows.turns[row]}, {bad}",
                actual=str(strange[bad])[:200],
                fix="`--to numpy` keeps it as it was; `gamekeeper audit` says what is wrong",
            )
