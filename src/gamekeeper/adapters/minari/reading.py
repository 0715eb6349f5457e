"""Minari data sets as evidence: one decision-maker, or the agents of an export of ours."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from os import PathLike, fspath
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.export import needs
from gamekeeper.adapters.minari.script import (
    Script,
    agents_apart,
    one_agent,
    our_agent,
    ours_together,
)
from gamekeeper.core.canon import from_json, to_json
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.space import Codec
from gamekeeper.core.tape import EpisodeEnd, EpisodeStart
from gamekeeper.errors import BundleError, EvidenceError, GamekeeperError
from gamekeeper.game.capture.oddity import odd
from gamekeeper.game.capture.packers import action_packer, observation_packer
from gamekeeper.record.bundle import load as load_bundle
from gamekeeper.record.recorder import Recorder
from gamekeeper.run.memory import MemorySink

METADATA: Final = "metadata.json"
EPISODES: Final = 200  # read out of one opening of the file
LACKS: Final = ("wall times", "states", "seeds of episodes that name none")
KEPT: Final = (
    "dataset_id", "minari_version", "algorithm_name", "author", "author_email", "code_permalink",
    "description", "requirements", "env_spec", "jpeg_encoding",
)  # fmt: skip


def load(
    data: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    agent: str = "agent",
    joint: bool = False,
) -> Evidence:
    """A Minari data set as evidence, in memory or as a bundle.

    | | |
    |---|---|
    | kept | observations, actions, rewards, both flags, infos, seeds, episodes in their order; of an export of ours also agents, orders, masks, reward terms and turns. `manifest["environment"]["imported"]` says where it is from, what it says of itself, and what it lacks |
    | changed | the data set's maker is one agent, `agent`, that sees and does all of it; a turn is a step. Observations that Minari keeps as JPEG are what JPEG left of them |
    | lost | nothing |
    | refused | a data set that names its spaces only by an environment (making that would run code) |

    What Minari doesn't know is null, never made up: seeds of episodes that have none, wall times,
    policies. It can't be replayed without `--env`: it says nothing of how actions came to rewards.

    Args:
        data: an id that Minari knows (in the folder that MINARI_DATASETS_PATH names, else in
            `~/.minari/datasets`; nothing is fetched or made), or the folder of a data set.
        out: the folder of a bundle; None keeps the evidence in memory.
        agent: what the one agent is called, where the data set doesn't say.
        joint: the Dict spaces of the data set hold an entry for each agent: they become agents.
            Minari has one reward and no order for all, so these are null; the reward stands in
            each info as `joint_reward`.
    Raises:
        DependencyError: Minari isn't installed.
        EvidenceError: see *refused*; or there is no such data set.
        BundleError: the bundle can't be written, or the data set is damaged.
    """  # noqa: E501  # a row of a table is one line
    try:
        from minari.dataset.minari_dataset import MinariDataset
        from minari.dataset.minari_storage import MinariStorage
    except ImportError as error:
        raise needs("Minari", "minari", error) from error
    folder = _folder(fspath(data))
    with _reading(folder):
        raw = MinariStorage.read_raw_metadata(folder)
        _check_spaces(raw, folder)
        try:
            dataset = MinariDataset(folder)
        except ImportError as error:  # h5py, or what its format needs
            raise needs("Minari", "minari", error) from error
    if not len(dataset):
        raise EvidenceError("the data set has no episode", where=str(folder))
    sides = dataset.observation_space, dataset.action_space
    script = _script(raw, sides, agent=agent, joint=joint)
    identity = _identity(raw, script)
    terms = tuple(script.terms)
    if out is None:
        memory = MemorySink(terms=terms)
        with _reading(folder):
            _play(dataset, script, memory)
        return memory.evidence(identity)
    recorder = Recorder(out, environment=identity, terms=terms)
    try:
        with _reading(folder):
            _play(dataset, script, recorder)
        recorder.close()
    except BaseException:  # half a data set isn't evidence of it
        with suppress(GamekeeperError):
            recorder.close()
        shutil.rmtree(recorder.path, ignore_errors=True)
        raise
    return load_bundle(out)


@contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """Whatever h5py and Minari raise on a damaged data set leaves as a BundleError."""
    try:
        yield
    except GamekeeperError:
        raise
    except (ArithmeticError, AssertionError, LookupError, OSError, TypeError, ValueError) as error:
        raise _unreadable(folder, error) from error


def _play(dataset: Any, script: Script, sink: Any) -> None:
    """Puts every episode on the tape of a sink, as a game would."""
    tape, layout = sink.tape, sink.layout
    tape.lock = Lock()  # a recorder's thread cuts the tape
    codecs = {name: tuple(map(Codec, pair)) for name, pair in script.spaces.items()}
    layout.announce(list(codecs), codecs.__getitem__)
    seats = [layout.seats[name] for name in codecs]
    packs = {
        seat.name: (seat.index, observation_packer(seat.observation, sink), action_packer(seat))
        for seat in seats
    }
    for episode, (data, said) in enumerate(_episodes(dataset)):
        seed = said.get("seed")
        since = episode if seed is not None else -1
        tape.starts.append(
            EpisodeStart(episode, seed, since, _options(said), _ours(script, said, "policies"))
        )
        turns = 0
        for seat in seats:
            seat.acts_as = None
        for turns, rows in enumerate(script.rows(data)):
            for row in rows:
                seat, see, do = packs[row.agent]
                seen, strange = _packed("obs", row.observation, see)
                done, wild = _packed("action", row.action, do)
                tape.given.extend((
                    seat, seen, row.mask, row.received, row.terminated, row.truncated, row.info,
                    row.live, strange,
                ))  # fmt: skip
                tape.done.extend((row.order, done, row.reward, row.terms, None, wild))
            tape.turns.extend((episode, turns, len(rows), None, None, None))
            if not turns % 256:
                sink.keep_up()
        has_ended = bool(np.any(data.terminations[-1:]) or np.any(data.truncations[-1:]))
        end = said.get("gamekeeper", {}).get("end") or ("ended" if has_ended else "cut")
        told = [_ours(script, said, name) for name in ("endings", "action_types")]
        tape.ends.append(EpisodeEnd(episode, end, turns, None, *told))
        sink.keep_up()


def _episodes(dataset: Any) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Each episode with its attributes.

    Minari keeps one file open for all that is asked for at once, and HDF5 what it has read of it:
    asking for a few at a time keeps memory flat.
    """
    numbers = [int(number) for number in dataset.episode_indices]
    for start in range(0, len(numbers), EPISODES):
        some = numbers[start : start + EPISODES]
        about = dataset.storage.get_episode_metadata(some)
        yield from zip(dataset.iterate_episodes(some), about, strict=True)


def _packed(field: str, value: Any, pack: Any) -> tuple[Any, tuple[str] | None]:
    """A value as its column has it, or as what isn't of its space."""
    if value is None:
        return None, None
    packed = pack(value)
    return (packed, None) if packed is not None else (None, (odd(field, value),))


def _ours(script: Script, said: Mapping[str, Any], name: str) -> str | None:
    """What an export of ours says of an episode, as JSON by agent."""
    text: str | None = said.get("gamekeeper", {}).get(name)
    if text is None or script.is_joint:
        return text
    return to_json({script.only: from_json(text) if name == "policies" else text})


def _script(raw: Mapping[str, Any], sides: Any, *, agent: str, joint: bool) -> Script:
    ours = raw.get("gamekeeper")
    ours = ours if isinstance(ours, dict) and isinstance(ours.get("agents"), list) else {}
    terms = [str(term) for term in ours.get("terms") or ()]
    if ours.get("kind") == "joint" or joint:
        bad = [side for side in sides if not isinstance(side, spaces.Dict)]
        if bad or list(sides[0].spaces) != list(sides[1].spaces):
            raise EvidenceError(
                "the data set's spaces don't hold an entry for each agent", where="joint",
                expected="two Dict spaces with the same keys", seen=f"{sides[0]!r:.100}",
                mend="without joint it is one agent's",
            )  # fmt: skip
        # a Dict space sorts its keys, an export of ours tells the order in which agents sat
        names = ours["agents"] if ours.get("kind") == "joint" else sides[0].spaces
        pairs = {str(n): (sides[0].spaces[n], sides[1].spaces[n]) for n in names}
        if ours.get("kind") == "joint":
            return Script(pairs, terms, ours_together, is_joint=True)
        return Script(pairs, [], agents_apart, is_joint=True)
    if ours.get("kind") == "agent":
        return Script({str(ours["agents"][0]): sides}, terms, our_agent)
    return Script({agent: sides}, [], one_agent)


def _identity(raw: Mapping[str, Any], script: Script) -> dict[str, Any]:
    """What stands for an environment: a thing that can't be opened, and where it is from."""
    name = str(raw.get("dataset_id"))
    said = {key: raw[key] for key in KEPT if key in raw}
    lacks = [*LACKS, *script.lacks]
    return {
        "kind": "object", "entry_point": f"Minari data set {name}", "name": name,
        "api": "parallel", "kwargs": {}, "versions": {}, "source_digest": None,
        "imported": {"from": "minari", **said, "recorded": raw.get("gamekeeper"), "lacks": lacks},
    }  # fmt: skip


def _options(said: Mapping[str, Any]) -> str | None:
    ours = said.get("gamekeeper", {}).get("options")
    if isinstance(ours, str):
        return ours
    options = said.get("options")
    return None if options is None else to_json(options)


def _folder(data: str) -> Path:
    """The folder of a data set that holds its metadata.

    Raises:
        EvidenceError: there is none.
    """
    root = os.environ.get("MINARI_DATASETS_PATH")
    roots = [Path(root)] if root else [Path("~/.minari/datasets").expanduser()]
    places = [Path(data), *(each / data for each in roots)]
    for place in places:
        for folder in (place.absolute() / "data", place.absolute()):
            if (folder / METADATA).is_file():
                return folder
    raise EvidenceError(
        f"there is no Minari data set {data!r} here", where=", ".join(map(str, places)),
        expected=f"a folder with data/{METADATA}",
        mend=f"`minari download {data}` fetches one; or name its folder",
    )  # fmt: skip


def _check_spaces(raw: Mapping[str, Any], folder: Path) -> None:
    missing = [key for key in ("observation_space", "action_space") if key not in raw]
    if missing:
        raise EvidenceError(
            "the data set doesn't name its spaces", where=str(folder / METADATA),
            expected="observation_space and action_space", seen=f"no {missing[0]}",
            mend="write it again with Minari 0.5, which names them: making the environment to ask "
            "it would run code",
        )  # fmt: skip


def _unreadable(folder: Path, error: Exception) -> BundleError:
    return BundleError(
        "the data set can't be read", where=str(folder), seen=f"{type(error).__name__}: {error}",
        mend="fetch it again, or read it with the Minari that wrote it",
    )  # fmt: skip
