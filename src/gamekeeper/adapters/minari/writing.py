"""Evidence as Minari data sets: one for each agent, and one of all agents together."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Collection, Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.agent_rows import AgentRows, agents_of, nested
from gamekeeper.adapters.export import (
    Export,
    Run,
    Say,
    chosen,
    evidence_of,
    needs,
    tell,
    to_stderr,
    traces_of,
)
from gamekeeper.adapters.minari.course import Course, course_of
from gamekeeper.adapters.minari.sets import DataSets, attributes_of
from gamekeeper.adapters.minari.space import check_space, is_key
from gamekeeper.adapters.minari.together import together_of
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.trace import Trace
from gamekeeper.errors import BundleError, EvidenceError

JOINT: Final = "joint"
LAYOUT: Final = 1
OBJECT_BYTES: Final = 100  # of a text or an array, beside what it holds


def export(
    run: Run,
    out: str | PathLike[str] | None = None,
    *,
    agents: Collection[str] | None = None,
    joint: bool | None = None,
    name: str | None = None,
    say: Say = to_stderr,
) -> Export:
    """Writes a run as Minari data sets that `minari.load_dataset` reads.

    `NAME/picker_0-v0` is what `picker_0` saw, did and was paid; `NAME/joint-v0` all agents of a
    Parallel environment as one, with Dict spaces by agent.

    | | |
    |---|---|
    | kept | observations and actions bit for bit (images too: no JPEG); rewards, all that an agent was paid from one decision to its next; terminated apart from truncated; masks, reward terms, turns and infos (JSON) in `infos`; seeds, options, ends, policies of each episode; environment, source digest, seed and fingerprint of the run |
    | changed | an episode that ran into neither end (it was cut) ends as truncated, its `gamekeeper/end` says so; a decision without a mask, where others have one, gets ones; joint: the reward is the sum of all agents' (each one's stands in `infos`), an agent that isn't there shows zeros, and the order of the action dictionary stands in `infos` |
    | lost | a last decision that no observation follows (an AEC episode that was cut); what is paid before an agent's first decision (`gamekeeper/paid_before`); turns at which only others acted; states, frames, timings; episodes in which an agent decided nothing |
    | refused | a value that isn't of its space; spaces that Minari can't hold (Sequence, Graph, OneOf, whole numbers of another size than 64 bits in a Discrete, keys with "/"); evidence without observations (level "digest"); joint: an AEC environment |

    Args:
        run: evidence, or the folder of a run.
        out: the folder of data sets; None: the one that MINARI_DATASETS_PATH names. Nothing is ever
            written into Minari's folder under your home unless you name it here.
        agents: only these; None: all.
        joint: also all agents as one; None: where the environment is Parallel, everybody is
            exported and Minari can hold it.
        name: of the data sets, before the slash; None: environment and run.
        say: takes a sentence for each loss.
    Raises:
        DependencyError: Minari isn't installed.
        EvidenceError: see *refused*.
        BundleError: there is a data set of that id, there is no bundle, or the disk refuses.
    """  # noqa: E501  # a row of a table is one line
    try:
        import minari  # asked before anything is read
        import minari.dataset._storages.hdf5_storage  # noqa: F401  # with h5py
    except ImportError as error:
        raise needs("Minari", "minari", error) from error
    evidence = evidence_of(run)
    names = chosen(evidence, agents)
    _check_level(evidence)
    writer = _Writer(evidence, names, DataSets(_root(out), name or _namespace(evidence)))
    try:
        writer.begin(joint=joint, all_asked=not agents)
        for trace in traces_of(evidence):
            writer.add(trace)
        writer.sets.flush()
    except BaseException as error:
        writer.sets.discard()
        if isinstance(error, OSError) and not isinstance(error, EvidenceError):
            raise BundleError(
                f"writing failed: {error.strerror or error}", where=str(writer.sets.root)
            ) from error
        raise
    made = writer.sets.sets
    return Export(
        to="minari", path=str(writer.sets.root), agents=tuple(n for n in names if n in made),
        episodes=evidence.episodes.num_rows, rows=sum(each.steps for each in made.values()),
        parts=tuple(each.id for each in made.values()), lost=tell(writer.lost(), say),
    )  # fmt: skip


class _Writer:
    """Puts episode after episode into the data sets."""

    def __init__(self, evidence: Evidence, names: list[str], sets: DataSets) -> None:
        self.evidence, self.names, self.sets = evidence, names, sets
        self._counts: Counter[str] = Counter()
        self._key = JOINT
        while self._key in names:
            self._key += "_"
        self._is_joint = False
        self._why_not: str | None = None

    def begin(self, *, joint: bool | None, all_asked: bool) -> None:
        """Makes the data sets, empty, once it is known that Minari can hold them."""
        known = self.evidence.spaces
        pairs: dict[str, tuple[Any, Any]] = {}
        for name in self.names:
            sides = (known[name].observation, known[name].action)
            pairs[name] = tuple(  # type: ignore[assignment]  # two of two
                check_space(None if side is None else side.space, whose=f"{name}, its {kind}")
                for side, kind in zip(sides, ("observations", "actions"), strict=True)
            )
        for name, pair in pairs.items():
            self.sets.begin(name, *pair, self._metadata("agent", [name]))
        self._why_not = self._no_joint()
        if joint and self._why_not is not None:
            raise EvidenceError(
                "the agents can't be one data set", where="joint", seen=self._why_not,
                mend="joint=False exports each agent",
            )  # fmt: skip
        wanted = all_asked and len(self.names) > 1 if joint is None else joint
        self._is_joint = wanted and self._why_not is None
        if self._is_joint:
            seen = spaces.Dict({each: pair[0] for each, pair in pairs.items()})
            done = spaces.Dict({each: pair[1] for each, pair in pairs.items()})
            self.sets.begin(self._key, seen, done, self._metadata("joint", self.names))
        elif not wanted:
            self._why_not = None

    def add(self, trace: Trace) -> None:
        """One episode: of each agent, and of all."""
        found = {rows.agent: rows for rows in agents_of(trace, self.names)}
        for name, rows in found.items():
            self._agent(trace, name, rows)
        if self._is_joint:
            self._together(trace, found)

    def lost(self) -> list[str]:
        """What the data sets lack, a sentence each."""
        told = [_LOST[kind].format(count) for kind, count in self._counts.items()]
        if self._why_not is not None:
            told.append(f"all agents as one: {self._why_not}")
        if self.evidence.tables.table("states", without=("state",)) is not None:
            told.append("states, turn by turn (`--to numpy` has them)")
        return told

    def _agent(self, trace: Trace, name: str, rows: AgentRows) -> None:
        course = course_of(rows)
        if course is None or not len(course.rewards):
            self._counts["empty"] += 1
            return
        self._count(course)
        codecs = rows.spaces
        assert codecs.observation is not None  # begin() has refused
        assert codecs.action is not None
        seen, did = rows.observations.taken(course.rows), rows.actions.taken(course.rows[:-1])
        ends = np.zeros((2, len(course.rewards)), bool)
        ends[0, -1] = course.terminated
        ends[1, -1] = course.truncated or not course.terminated
        attributes = attributes_of(trace.header, name)
        if course.paid_before:
            attributes["gamekeeper/paid_before"] = course.paid_before
        self._put(
            name, trace,
            observations=nested(codecs.observation.space, seen, codecs.observation),
            actions=nested(codecs.action.space, did, codecs.action),
            rewards=course.rewards, ends=ends, infos=self._infos(rows, course),
            attributes=attributes,
        )  # fmt: skip

    def _infos(self, rows: AgentRows, course: Course) -> dict[str, Any]:
        texts = rows.texts("info")
        infos: dict[str, Any] = {
            "turn": rows.turns[course.rows].astype(np.int32),
            "info": [texts[row] or "" for row in course.rows.tolist()],
        }
        if course.terms:
            infos["terms"] = {
                term: np.concatenate([[0.0], paid]) for term, paid in course.terms.items()
            }
        masks = rows.masks()
        whole, is_lost = whole_masks([masks[row] for row in course.rows.tolist()])
        self._counts.update({"masks": 1} if is_lost else {})
        return infos if whole is None else {**infos, "action_mask": whole}

    def _together(self, trace: Trace, found: Mapping[str, AgentRows]) -> None:
        together = together_of(found, self.evidence.spaces, self.names)
        if together is None:
            self._counts["empty joint"] += 1
            return
        self._put(
            self._key, trace, observations=together.observations, actions=together.actions,
            rewards=together.rewards, ends=together.ends, infos=together.infos,
            attributes=attributes_of(trace.header, None),
        )  # fmt: skip

    def _put(
        self, name: str, trace: Trace, *, observations: Any, actions: Any, rewards: Any,
        ends: Any, infos: Any, attributes: Mapping[str, Any],
    ) -> None:  # fmt: skip
        from minari.data_collector.episode_buffer import EpisodeBuffer

        buffer = EpisodeBuffer(
            seed=trace.seed, observations=observations, actions=actions, rewards=rewards,
            terminations=ends[0], truncations=ends[1], infos=infos,
        )  # fmt: skip
        size = sum(map(size_of, (observations, actions, infos)))
        self.sets.add(name, buffer, attributes, size)

    def _count(self, course: Course) -> None:
        if course.left_out is not None:
            self._counts["last"] += 1
        if not (course.terminated or course.truncated):
            self._counts["cut"] += 1
        if course.paid_before:
            self._counts["before"] += 1

    def _no_joint(self) -> str | None:
        """Why all agents can't be one data set; None where they can."""
        if self.evidence.manifest["environment"].get("api") != "parallel":
            return "agents that act in turn have no joint action"
        bad = [name for name in self.names if not is_key(name)]
        return f"HDF5 has no name {bad[0]!r}" if bad else None

    def _metadata(self, kind: str, agents: list[str]) -> dict[str, Any]:
        manifest = self.evidence.manifest
        kept = ("environment", "terms", "seed", "status", "fingerprint", "info_fingerprint")
        ours = {name: manifest.get(name) for name in kept}
        name = manifest["environment"].get("name")
        return {
            "description": f"{', '.join(agents)} of {name}: evidence recorded by Gamekeeper",
            "gamekeeper": {"layout": LAYOUT, "kind": kind, "agents": agents, **ours},
        }


_LOST: Final = {
    "empty": "{} times an agent's episode, in which it decided nothing that an observation follows",
    "empty joint": "{} episodes of all agents as one, in which nobody decided anything",
    "last": "{} last decisions that no observation follows, with what they were paid",
    "cut": "{} times that an agent's episode was cut stands as truncated",
    "before": "{} times what an agent was paid before its first decision (it stands apart)",
    "masks": "masks of {} episodes, which change their form within one",
}


def whole_masks(masks: list[Any]) -> tuple[Any, bool]:
    """The masks of an episode as one array, and whether they can't be one.

    Where a mask is missing, a decision gets ones (all is legal), the last observation zeros.
    """
    kinds = {(mask.dtype.str, mask.shape) for mask in masks if mask is not None}
    if not kinds:
        return None, False
    if len(kinds) > 1:
        return None, True
    dtype, shape = kinds.pop()
    last = len(masks) - 1
    blanks = [(np.zeros if at == last else np.ones)(shape, dtype) for at in range(len(masks))]
    return np.stack([b if m is None else m for m, b in zip(masks, blanks, strict=True)]), False


def size_of(part: Any) -> int:
    """The bytes of arrays and texts in dictionaries, tuples and lists."""
    if isinstance(part, Mapping):
        return sum(map(size_of, part.values()))
    if isinstance(part, tuple | list):
        return sum(map(size_of, part))
    return OBJECT_BYTES + (len(part) if isinstance(part, str) else int(getattr(part, "nbytes", 8)))


def _check_level(evidence: Evidence) -> None:
    if evidence.manifest.get("level") == "digest":
        raise EvidenceError(
            "the run has no observations, only their digests", where=str(evidence.path or "memory"),
            expected="level 'full'", seen="level 'digest'",
            mend="record it again with --level full, or --to numpy without observations",
        )  # fmt: skip


def _root(out: str | PathLike[str] | None) -> Path:
    named = fspath(out) if out is not None else os.environ.get("MINARI_DATASETS_PATH")
    if not named:
        raise EvidenceError(
            "no folder for the data sets is named", where="--out", expected="a folder",
            seen="none, and MINARI_DATASETS_PATH is empty", mend="--out data",
        )  # fmt: skip
    return Path(named).absolute()  # Minari measures a data set wrongly where its path is relative


def _namespace(evidence: Evidence) -> str:
    parts = [str(evidence.manifest["environment"].get("name") or "run")]
    parts += [] if evidence.path is None else [evidence.path.name]
    clean = [re.sub(r"[^\w-]", "_", part) for part in parts]
    return "/".join(part if len(part) > 1 else f"{part}_" for part in clean)
