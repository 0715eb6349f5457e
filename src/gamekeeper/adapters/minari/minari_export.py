"""Evidence as Minari data sets: one for each agent, and one of all agents together.

An agent's data set holds its decisions one after another, n of them between n + 1 observations.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.export_source import (
    UNKNOWN_TERMS,
    AgentRows,
    Export,
    Run,
    Say,
    agents_of,
    chosen,
    episodes_of,
    evidence_of,
    nested,
    tell,
    to_stderr,
)
from gamekeeper.adapters.minari.minari_agents import (
    DataSets,
    MinariEpisode,
    attributes_of,
    check_space,
    is_key,
    together_of,
)
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError, not_installed
from gamekeeper.runs.files.folder import system_error


@dataclass(frozen=True, slots=True)
class AgentEpisode:
    """Decisions of one agent in one episode.

    Attributes:
        rows: [n + 1] the row of each observation; the last follows the last decision.
        rewards: [n] sum of its rewards from each decision to the next, or to the end.
        terms: the same by reward term; NaN where the run doesn't say.
        terminated, truncated: its last flags.
        paid_before: rewards before its first decision, which no decision earned.
        left_out: reward of a last decision that no observation follows, and that isn't in `rows`;
            None where one does.
    """

    rows: Any
    rewards: Any
    terms: Mapping[str, Any]
    terminated: bool
    truncated: bool
    paid_before: float
    left_out: float | None


def decisions_of(rows: AgentRows) -> AgentEpisode | None:
    """Returns the decisions of an agent; None where it made none that an observation follows.

    Raises:
        EvidenceError: an observation, an action or a reward isn't of its space.
    """
    decided = np.flatnonzero(rows.decided)
    if not len(decided):
        return None
    paid, was_paid = rows.numbers("reward")
    _check(rows, decided, "obs", rows.observations.valid)
    _check(rows, decided, "action", rows.actions.valid)
    _check(rows, decided, "reward", was_paid)
    # sums from each decision to the next: others may act, and pay the agent, in between
    rewards = np.add.reduceat(paid, decided)
    terms = {term: np.add.reduceat(rows.paid_by(term), decided) for term in rows.terms}
    last = int(decided[-1])
    after = np.flatnonzero(rows.observations.valid[last + 1 :])
    flags = [bool(rows.numbers(name)[0][last + 1 :].any()) for name in ("terminated", "truncated")]
    left_out = None
    if len(after):
        path = np.append(decided, last + 1 + after[0])
    else:
        path, flags, left_out = decided, [False, False], float(rewards[-1])
        rewards = rewards[:-1]
        terms = {term: each[:-1] for term, each in terms.items()}
    before = float(paid[: decided[0]].sum())
    return AgentEpisode(path, rewards, terms, flags[0], flags[1], before, left_out)


def _check(rows: AgentRows, decided: Any, field: str, valid: Any) -> None:
    bad = decided[~valid[decided]]
    if not len(bad):
        return
    row = int(bad[0])
    entry = rows.nonconforming(row).get(field, {})
    raise EvidenceError(
        f"the {_WORDS[field]} of {rows.agent!r} isn't of its space"
        if entry
        else f"{rows.agent!r} decided without a recorded {_WORDS[field]}",
        where=str(Where("", rows.episode, int(rows.turns[row]), rows.agent, field)),
        actual=str(entry)[:200] if entry else "nothing",
        fix="`--to numpy` keeps it as it was; `gamekeeper audit` says what is wrong with it",
    )


_WORDS = {"obs": "observation", "action": "action", "reward": "reward"}


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
    | changed | an episode that ran into neither end (it was cut) ends as truncated, its `gamekeeper/end` says so; a decision without a mask, where others have one, gets ones; reward terms that the run doesn't tell are NaN; joint: the reward is the sum of all agents' (each one's stands in `infos`), an agent that isn't there shows zeros, and the order of the action dictionary stands in `infos` |
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
        RunError: there is a data set of that id, there is no run, or the disk refuses.
    """  # noqa: E501  # a row of a table is one line
    try:
        import minari  # asked before anything is read
        import minari.dataset._storages.hdf5_storage  # noqa: F401  # with h5py
    except ImportError as error:
        raise not_installed(error, "Minari", "minari", "--to minari") from error
    evidence = evidence_of(run)
    names = chosen(evidence, agents)
    _check_level(evidence)
    writer = _DataSetWriter(evidence, names, DataSets(_root(out), name or _namespace(evidence)))
    try:
        writer.begin(joint=joint, all_asked=not agents)
        for episode in episodes_of(evidence):
            writer.add(episode)
        writer.sets.flush()
    except BaseException as error:
        writer.sets.discard()
        if isinstance(error, OSError) and not isinstance(error, EvidenceError):
            raise system_error("writing", writer.sets.root, error) from error
        raise
    made = writer.sets.sets
    return Export(
        to="minari",
        path=str(writer.sets.root),
        agents=tuple(n for n in names if n in made),
        episodes=evidence.episode_table.num_rows,
        rows=sum(each.steps for each in made.values()),
        parts=tuple(each.id for each in made.values()),
        lost=tell(writer.lost(), say),
    )


class _DataSetWriter:
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
                "the agents can't be one data set",
                where="joint",
                actual=self._why_not,
                fix="joint=False exports each agent",
            )
        wanted = all_asked and len(self.names) > 1 if joint is None else joint
        self._is_joint = wanted and self._why_not is None
        if self._is_joint:
            seen = spaces.Dict({each: pair[0] for each, pair in pairs.items()})
            done = spaces.Dict({each: pair[1] for each, pair in pairs.items()})
            self.sets.begin(self._key, seen, done, self._metadata("joint", self.names))
        elif not wanted:
            self._why_not = None

    def add(self, episode: Episode) -> None:
        """Adds one episode: of each agent, and of all."""
        found = {rows.agent: rows for rows in agents_of(episode, self.names)}
        for name, rows in found.items():
            self._agent(episode, name, rows)
        if not self._is_joint:
            return
        together = together_of(found, self.evidence.spaces, self.names)
        if together is None:
            self._counts["empty joint"] += 1
        else:
            self._put(self._key, episode, together, attributes_of(episode.header, None))

    def lost(self) -> list[str]:
        """Returns losses of the data sets, a sentence each."""
        counts = [(kind, self._counts[kind]) for kind in _LOST]
        found = [_LOST[kind].format(count) for kind, count in counts if count]
        if self._why_not is not None:
            found.append(f"all agents as one: {self._why_not}")
        if self.evidence.tables.table("states", without=("state",)) is not None:
            found.append("states, turn by turn (`--to numpy` has them)")
        return found

    def _agent(self, episode: Episode, name: str, rows: AgentRows) -> None:
        own = decisions_of(rows)
        if own is None or not len(own.rewards):
            self._counts["empty"] += 1
            return
        is_cut = not (own.terminated or own.truncated)
        self._counts["last"] += own.left_out is not None
        self._counts["cut"] += is_cut
        self._counts["before"] += own.paid_before != 0.0
        codecs = rows.spaces
        assert codecs.observation is not None  # begin() has refused
        assert codecs.action is not None
        seen, did = rows.observations.taken(own.rows), rows.actions.taken(own.rows[:-1])
        ends = np.zeros((2, len(own.rewards)), bool)
        ends[:, -1] = own.terminated, own.truncated or is_cut
        attributes = attributes_of(episode.header, name)
        if own.paid_before:
            attributes["gamekeeper/paid_before"] = own.paid_before
        data = MinariEpisode(
            observations=nested(codecs.observation.space, seen, codecs.observation),
            actions=nested(codecs.action.space, did, codecs.action),
            rewards=own.rewards,
            ends=ends,
            infos=self._infos(rows, own),
        )
        self._put(name, episode, data, attributes)

    def _infos(self, rows: AgentRows, own: AgentEpisode) -> dict[str, Any]:
        texts = rows.texts("info")
        infos: dict[str, Any] = {
            "turn": rows.turns[own.rows].astype(np.int32),
            "info": [texts[row] or "" for row in own.rows.tolist()],
        }
        self._counts.update({"terms": int(rows.has_unknown_terms.sum())})
        if own.terms:
            infos["terms"] = {
                term: np.concatenate([[0.0], paid]) for term, paid in own.terms.items()
            }
        masks = rows.masks()
        whole, is_lost = whole_masks([masks[row] for row in own.rows.tolist()])
        self._counts.update({"masks": 1} if is_lost else {})
        return infos if whole is None else {**infos, "action_mask": whole}

    def _put(
        self, name: str, episode: Episode, data: MinariEpisode, attributes: Mapping[str, Any]
    ) -> None:
        from minari.data_collector.episode_buffer import EpisodeBuffer

        buffer = EpisodeBuffer(
            seed=episode.seed,
            observations=data.observations,
            actions=data.actions,
            rewards=data.rewards,
            terminations=data.ends[0],
            truncations=data.ends[1],
            infos=data.infos,
        )
        size = sum(map(size_of, (data.observations, data.actions, data.infos)))
        self.sets.add(name, buffer, attributes, size)

    def _no_joint(self) -> str | None:
        """Returns the reason why all agents can't be one data set; None where they can."""
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
    "empty joint": "{} episodes of all agents as one, in which no agent decided anything",
    "last": "{} last decisions that no observation follows, with what they were paid",
    "cut": "{} times that an agent's episode was cut stands as truncated",
    "before": "{} times what an agent was paid before its first decision (it stands apart)",
    "terms": UNKNOWN_TERMS,
    "masks": "masks of {} episodes, which change their form within one",
}


def whole_masks(masks: list[Any]) -> tuple[Any, bool]:
    """Returns the masks of an episode as one array, and True if they can't be one.

    Where a mask is missing, a decision gets ones (all is legal), the last observation zeros.
    """
    kinds = {(mask.dtype.str, mask.shape) for mask in masks if mask is not None}
    if len(kinds) != 1:
        return None, len(kinds) > 1
    dtype, shape = kinds.pop()
    blanks = [*[np.ones(shape, dtype)] * (len(masks) - 1), np.zeros(shape, dtype)]
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
            "the run has no observations, only their digests",
            where=str(evidence.path or "memory"),
            expected="level 'full'",
            actual="level 'digest'",
            fix="record it again with --level full, or --to numpy without observations",
        )


def _root(out: str | PathLike[str] | None) -> Path:
    named = fspath(out) if out is not None else os.environ.get("MINARI_DATASETS_PATH")
    if not named:
        raise EvidenceError(
            "no folder for the data sets is named",
            where="--out",
            expected="a folder",
            actual="none, and MINARI_DATASETS_PATH is empty",
            fix="--out data",
        )
    return Path(named).absolute()  # Minari measures a data set wrongly where its path is relative


def _namespace(evidence: Evidence) -> str:
    parts = [str(evidence.manifest["environment"].get("name") or "run")]
    parts += [] if evidence.path is None else [evidence.path.name]
    clean = [re.sub(r"[^\w-]", "_", part) for part in parts]
    return "/".join(part if len(part) > 1 else f"{part}_" for part in clean)
