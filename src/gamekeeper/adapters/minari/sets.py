"""Minari data sets that grow episode by episode, in a folder of ours or of the user's naming."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.canon import to_json
from gamekeeper.errors import BundleError

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
        """Takes an episode."""
        self._waiting.append((buffer, attributes))
        self.episodes += 1
        self.steps += len(buffer.rewards)

    def flush(self) -> None:
        """Writes what waits."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        first = self.episodes - len(waiting)
        self.storage.update_episodes([buffer for buffer, _ in waiting])
        attributes = [dict(each) for _, each in waiting]
        self.storage.update_episode_metadata(attributes, range(first, self.episodes))


@dataclass(slots=True)
class DataSets:
    """The data sets of one export; `discard` takes back all that was made."""

    root: Path
    namespace: str
    sets: dict[str, DataSet] = field(default_factory=dict)
    _made: list[Path] = field(default_factory=list)
    _waiting_bytes: int = 0

    def begin(self, name: str, observation: Any, action: Any, metadata: Mapping[str, Any]) -> None:
        """Makes an empty data set.

        Raises:
            BundleError: there is one of that id.
        """
        from minari import __version__
        from minari.dataset.minari_storage import MinariStorage

        own = self._free(re.sub(r"[^\w-]", "_", name) or "_")
        dataset_id = f"{self.namespace}/{own}-v0"
        folder = self.root / dataset_id
        if folder.exists():
            raise BundleError(
                "there is a data set of that id", where=str(folder),
                mend="choose another --out, or move that one away first",
            )  # fmt: skip
        self._make(folder / "data")
        storage = MinariStorage.new(
            folder / "data", observation_space=observation, action_space=action,
            data_format="hdf5", jpeg_encoding=False,
        )  # fmt: skip
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
        """Writes all that waits."""
        for each in self.sets.values():
            each.flush()
        self._waiting_bytes = 0

    def discard(self) -> None:
        """Takes back every folder that was made."""
        for path in reversed(self._made):
            shutil.rmtree(path, ignore_errors=True)

    def _free(self, name: str) -> str:
        taken = {each.id.rpartition("/")[2] for each in self.sets.values()}
        while f"{name}-v0" in taken:
            name += "_"
        return name

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
    """What an episode's header says of one agent, or of all, as attributes that HDF5 takes."""
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
