"""Minari data sets as evidence, row by row: one agent, or the agents of an export of ours."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.episodes.buffer import TURN, EpisodeEnd, EpisodeStart
from gamekeeper.episodes.canonical import from_json, to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.spaces import Codec
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError, not_installed
from gamekeeper.interface.packing import InfoTexts, action_packer, nonconforming, observation_packer
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.runs.load_run import load as load_run
from gamekeeper.runs.recorder import RunRecorder

Space = spaces.Space[Any]
Pairs = Mapping[str, tuple[Space, Space]]


@dataclass(frozen=True, slots=True)
class Row:
    """Row of one agent; None where the data set says nothing."""

    agent: str
    observation: Any
    mask: bytes | None
    cumulative_reward: float | None
    terminated: bool | None
    truncated: bool | None
    info: str | None
    live: bool
    order: int | None = None
    action: Any = None
    reward: float | None = None
    terms: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Script:
    """Agents and reader of a data set.

    Attributes:
        spaces: of each agent, observation and action.
        terms: reward terms.
        reader: gives the rows of each turn of an episode; those of the last turn have no action.
        is_joint: its Dict spaces are agents.
    """

    spaces: Pairs
    terms: list[str]
    reader: Callable[[Script, Any], Iterator[list[Row]]]
    is_joint: bool = False

    @property
    def lacks(self) -> list[str]:
        """Parts that the evidence lacks, beside those that every import lacks."""
        if self.reader is agents_apart:
            return ["the order of actions", "each agent's own reward and end", "policies"]
        if self.reader is our_agent:
            return ["the other agents", "the turns between this one's decisions"]
        return [] if self.reader is ours_together else ["policies"]


def one_agent(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Yields rows of a data set from elsewhere: one agent, a step a turn."""
    text = InfoTexts().text
    for turn in range(len(episode.rewards) + 1):
        info = at(episode.infos or {}, turn)
        yield [_row(script, episode, turn, *(text(info) if info else (None, None)))]


def our_agent(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Yields rows of an agent that we exported: its masks, terms and infos as they were."""
    infos = episode.infos or {}
    count = len(episode.rewards)
    for turn in range(count + 1):
        text = _text(infos["info"][turn])
        has_mask = "action_mask" in infos and text is not None and '"action_mask":"' in text
        mask = infos["action_mask"][turn].tobytes() if has_mask else None
        terms = None
        if turn < count and script.terms:
            terms = tuple(float(infos["terms"][term][turn + 1]) for term in script.terms)
            terms = None if np.isnan(terms).all() else terms
        yield [_row(script, episode, turn, text, mask, terms)]


def ours_together(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Yields rows of all agents that we exported as one: each agent's own, in their order."""
    infos, count = episode.infos, len(episode.rewards)
    for turn in range(count + 1):
        rows = []
        for agent in script.spaces:
            field = {
                name: by_agent[agent][turn]
                for name, by_agent in infos.items()
                if agent in by_agent and name != "terms"
            }
            if field["given"] or field["was_paid"]:
                rows.append(_row_of(script, episode, agent, turn, field, is_last=turn == count))
        yield rows


def _row_of(
    script: Script, episode: Any, agent: str, turn: int, field: Mapping[str, Any], *, is_last: bool
) -> Row:
    """Returns one agent's row of a turn, out of the fields of a joint data set of ours."""
    seen, did = script.spaces[agent]
    order, given = int(field["order"]), bool(field["given"])
    acts = order >= 0 and not is_last
    text = _text(field["info"])
    has_mask = text is not None and '"action_mask":"' in text
    return Row(
        agent=agent,
        observation=value_at(seen, episode.observations[agent], turn) if field["saw"] else None,
        mask=field["action_mask"].tobytes() if has_mask else None,
        cumulative_reward=float(field["cumulative_reward"]) if given else None,
        terminated=bool(field["terminated"]) if given else None,
        truncated=bool(field["truncated"]) if given else None,
        info=text,
        live=bool(field["live"]),
        order=order if acts else None,
        action=value_at(did, episode.actions[agent], turn) if acts else None,
        reward=float(field["paid"]) if field["was_paid"] else None,
        terms=_terms(script, episode.infos, agent, turn) if field["has_terms"] else None,
    )


def agents_apart(script: Script, episode: Any) -> Iterator[list[Row]]:
    """Yields rows of a data set from elsewhere with Dict spaces by agent: one reward for all."""
    infos, count = episode.infos or {}, len(episode.rewards)
    for turn in range(count + 1):
        last = turn == count
        reward = {} if last else {"joint_reward": float(episode.rewards[turn])}
        info = {**at(infos, turn), **reward}
        is_over = last and bool(count)
        yield [
            Row(
                agent=agent,
                observation=value_at(pair[0], episode.observations[agent], turn),
                mask=None,
                cumulative_reward=None,
                terminated=is_over and bool(episode.terminations[turn - 1]),
                truncated=is_over and bool(episode.truncations[turn - 1]),
                info=to_json(info) if info else None,
                live=not last,
                action=None if last else value_at(pair[1], episode.actions[agent], turn),
            )
            for agent, pair in script.spaces.items()
        ]


def _row(
    script: Script,
    episode: Any,
    turn: int,
    info: str | None,
    mask: bytes | None,
    terms: tuple[float, ...] | None = None,
) -> Row:
    """Returns the row of the one agent of a data set."""
    agent, (seen, did) = next(iter(script.spaces.items()))
    last = turn == len(episode.rewards)
    before = turn - 1
    ended = [bool(turn and each[before]) for each in (episode.terminations, episode.truncations)]
    return Row(
        agent=agent,
        observation=value_at(seen, episode.observations, turn),
        mask=mask,
        cumulative_reward=float(episode.rewards[before]) if turn else 0.0,
        terminated=ended[0],
        truncated=ended[1],
        info=info,
        live=not (last and any(ended)),
        order=None if last else 0,
        action=None if last else value_at(did, episode.actions, turn),
        reward=None if last else float(episode.rewards[turn]),
        terms=terms,
    )


def value_at(space: Space, column: Any, row: int) -> Any:
    """Returns one value out of whole columns, as its space has it."""
    if isinstance(space, spaces.Dict):
        return {key: value_at(part, column[key], row) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple([value_at(p, c, row) for p, c in zip(space.spaces, column, strict=True)])
    value = column[row]
    if isinstance(space, spaces.Text):
        return value.decode() if isinstance(value, bytes) else str(value)
    if isinstance(space, spaces.Discrete) and isinstance(value, np.integer):
        return space.dtype.type(value)  # HDF5 may hold it in fewer bytes
    return np.array(
        value
    )  # of whatever dtype it is: a value that isn't of the space is kept as it is


def at(infos: Mapping[str, Any], row: int) -> dict[str, Any]:
    """Returns the info of one step; a field with fewer values isn't in it."""
    found: dict[str, Any] = {}
    for name, column in infos.items():
        if isinstance(column, Mapping):
            found[name] = at(column, row)
        elif np.ndim(column) == 0:
            found[name] = column
        elif row < len(column):
            value = column[row]
            found[name] = value.decode(errors="replace") if isinstance(value, bytes) else value
    return found


def _terms(script: Script, infos: Mapping[str, Any], agent: str, turn: int) -> Any:
    if not script.terms:
        return None
    return tuple(float(infos["terms"][agent][term][turn]) for term in script.terms)


def _text(value: Any) -> str | None:
    text = value.decode() if isinstance(value, bytes) else str(value)
    return text or None


METADATA: Final = "metadata.json"
UNTIMED: Final = (None,) * (TURN - 3)  # of a turn: neither times nor a state
EPISODES: Final = 200  # read out of one opening of the file
MOST_NAMED: Final = 5
"""Number of data sets that an error names where a folder holds several."""
LACKS: Final = ("wall times", "states", "seeds of episodes that name none")
KEPT: Final = (
    "dataset_id",
    "minari_version",
    "algorithm_name",
    "author",
    "author_email",
    "code_permalink",
    "description",
    "requirements",
    "env_spec",
    "jpeg_encoding",
)


def load(
    data: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    agent: str = "agent_0",
    joint: bool = False,
) -> Evidence:
    """A Minari data set as evidence, in memory or as a run.

    | | |
    |---|---|
    | kept | observations, actions, rewards, both flags, infos, seeds, episodes in their order; of an export of ours also agents, orders, masks, reward terms and turns, of a joint one every row bit for bit. `manifest["environment"]["imported"]` says where it is from, what it says of itself, and what it lacks |
    | changed | the data set's maker is one agent, `agent_0`, that sees and does all of it; a turn is a step. Observations that Minari keeps as JPEG are what JPEG left of them |
    | lost | of an export of ours: what that lost. The fingerprint is another, as it covers states and the environment; that of the run stands in `imported["recorded"]["fingerprint"]` |
    | refused | a data set that names its spaces only by an environment (making that would run code) |

    What Minari doesn't know is null, never made up: seeds of episodes that have none, wall times,
    policies. It can't be replayed without `--env`: it says nothing of how actions came to rewards.

    Args:
        data: an id that Minari knows (in the folder that MINARI_DATASETS_PATH names, else in
            `~/.minari/datasets`; nothing is fetched or made), or the folder of a data set.
        out: the folder of a run; None keeps the evidence in memory.
        agent: what the one agent is called, where the data set doesn't say.
        joint: the Dict spaces of the data set hold an entry for each agent: they become agents.
            Minari has one reward and no order for all, so these are null; the reward stands in
            each info as `joint_reward`.
    Raises:
        DependencyError: Minari isn't installed.
        EvidenceError: see *refused*; or there is no such data set.
        RunError: the run can't be written, or the data set is damaged.
    """  # noqa: E501  # a row of a table is one line
    try:
        from minari.dataset.minari_dataset import MinariDataset
        from minari.dataset.minari_storage import MinariStorage
    except ImportError as error:
        raise not_installed(error, "Minari", "minari", "minari:") from error
    folder = _folder(fspath(data))
    with _reading(folder):
        raw = MinariStorage.read_raw_metadata(folder)
        missing = [key for key in ("observation_space", "action_space") if key not in raw]
        if missing:
            raise EvidenceError(
                "the data set doesn't name its spaces",
                where=str(folder / METADATA),
                expected="observation_space and action_space",
                actual=f"no {missing[0]}",
                fix="write it again with Minari 0.5, which names them: making the environment to "
                "ask it would run code",
            )
        try:
            dataset = MinariDataset(folder)
        except ImportError as error:  # h5py, or what its format needs
            raise not_installed(error, "Minari", "minari", "minari:") from error
    if not len(dataset):
        raise EvidenceError(
            "the data set has no episode", where=str(folder), fix="fetch it again, or another one"
        )
    sides = dataset.observation_space, dataset.action_space
    script = _script(raw, sides, agent=agent, joint=joint)
    identity = _identity(raw, script)
    terms = tuple(script.terms)
    if out is None:
        memory = MemorySink(terms=terms)
        with _reading(folder):
            _play(dataset, script, memory)
        return memory.evidence(identity)
    recorder = RunRecorder(out, environment=identity, terms=terms)
    try:
        with _reading(folder):
            _play(dataset, script, recorder)
        recorder.close()
    except BaseException:  # half a data set isn't evidence of it
        with suppress(GamekeeperError):
            recorder.close()
        shutil.rmtree(recorder.path, ignore_errors=True)
        raise
    return load_run(out)


@contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """Whatever h5py and Minari raise on a damaged data set leaves as a RunError."""
    try:
        yield
    except GamekeeperError:
        raise
    except (ArithmeticError, AssertionError, LookupError, OSError, TypeError, ValueError) as error:
        raise RunError(
            "the data set can't be read",
            where=str(folder),
            actual=f"{type(error).__name__}: {error}",
            fix="fetch it again, or read it with the Minari that wrote it",
        ) from error


def _play(dataset: Any, script: Script, sink: Any) -> None:
    """Puts every episode on the buffer of a sink, as a capture would."""
    buffer, layout = sink.buffer, sink.layout
    buffer.lock = Lock()  # a recorder's thread cuts the buffer
    codecs = {name: tuple(map(Codec, pair)) for name, pair in script.spaces.items()}
    layout.announce(list(codecs), codecs.__getitem__)
    agents = [layout.agents[name] for name in codecs]
    packs = {
        agent.name: (agent.index, observation_packer(agent.observation, sink), action_packer(agent))
        for agent in agents
    }
    for episode, (data, attributes) in enumerate(_episodes(dataset)):
        seed = attributes.get("seed")
        since = episode if seed is not None else -1
        buffer.starts.append(
            EpisodeStart(
                episode, seed, since, _options(attributes), _ours(script, attributes, "policies")
            )
        )
        turns = 0
        for agent in agents:
            agent.acts_as = None
        for turns, rows in enumerate(script.reader(script, data)):
            for row in rows:
                index, see, do = packs[row.agent]
                seen, strange = _packed("obs", row.observation, see)
                done, wild = _packed("action", row.action, do)
                buffer.given.extend(
                    (
                        index,
                        seen,
                        row.mask,
                        row.cumulative_reward,
                        row.terminated,
                        row.truncated,
                        row.info,
                        row.live,
                        strange,
                    )
                )
                buffer.done.extend((row.order, done, row.reward, row.terms, None, wild))
            buffer.turns.extend((episode, turns, len(rows), *UNTIMED))
            if not turns % 256:
                sink.keep_up()
        has_ended = bool(np.any(data.terminations[-1:]) or np.any(data.truncations[-1:]))
        end = attributes.get("gamekeeper", {}).get("end") or ("ended" if has_ended else "cut")
        endings, types = (_ours(script, attributes, name) for name in ("endings", "action_types"))
        buffer.ends.append(EpisodeEnd(episode, end, turns, None, endings, types))
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
    """Returns a value as its column has it, or as one that isn't of its space."""
    if value is None:
        return None, None
    packed = pack(value)
    return (packed, None) if packed is not None else (None, (nonconforming(field, value),))


def _ours(script: Script, attributes: Mapping[str, Any], name: str) -> str | None:
    """Returns a field that an export of ours wrote about an episode, as JSON by agent."""
    text: str | None = attributes.get("gamekeeper", {}).get(name)
    if text is None or script.is_joint:
        return text
    return to_json({next(iter(script.spaces)): from_json(text) if name == "policies" else text})


def _script(raw: Mapping[str, Any], sides: Any, *, agent: str, joint: bool) -> Script:
    ours = raw.get("gamekeeper")
    ours = ours if isinstance(ours, dict) and isinstance(ours.get("agents"), list) else {}
    terms = [str(term) for term in ours.get("terms") or ()]
    if ours.get("kind") == "joint" or joint:
        bad = [side for side in sides if not isinstance(side, spaces.Dict)]
        if bad or list(sides[0].spaces) != list(sides[1].spaces):
            raise EvidenceError(
                "the data set's spaces don't hold an entry for each agent",
                where="joint",
                expected="two Dict spaces with the same keys",
                actual=f"{sides[0]!r:.100}",
                fix="without --joint (in Python, joint=True) it is one agent's",
            )
        # a Dict space sorts its keys, an export of ours tells the order of agents
        names = ours["agents"] if ours.get("kind") == "joint" else sides[0].spaces
        pairs = {str(n): (sides[0].spaces[n], sides[1].spaces[n]) for n in names}
        if ours.get("kind") == "joint":
            return Script(pairs, terms, ours_together, is_joint=True)
        return Script(pairs, [], agents_apart, is_joint=True)
    if ours.get("kind") == "agent":
        return Script({str(ours["agents"][0]): sides}, terms, our_agent)
    return Script({agent: sides}, [], one_agent)


def _identity(raw: Mapping[str, Any], script: Script) -> dict[str, Any]:
    """Identity in place of an environment, which can't be opened: the data set it is from."""
    name = str(raw.get("dataset_id"))
    attributes = {key: raw[key] for key in KEPT if key in raw}
    lacks = [*LACKS, *script.lacks]
    return {
        "kind": "object",
        "entry_point": f"Minari data set {name}",
        "name": name,
        "api": "parallel",
        "kwargs": {},
        "versions": {},
        "source_digest": None,
        "imported": {
            "from": "minari",
            **attributes,
            "recorded": raw.get("gamekeeper"),
            "lacks": lacks,
        },
    }


def _options(attributes: Mapping[str, Any]) -> str | None:
    ours = attributes.get("gamekeeper", {}).get("options")
    if isinstance(ours, str):
        return ours
    options = attributes.get("options")
    return None if options is None else to_json(options)


def _folder(data: str) -> Path:
    """Returns the folder of a data set that holds its metadata.

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
    found = {path.parents[1] for place in places for path in place.glob(f"*/**/data/{METADATA}")}
    parts = sorted(map(str, found))
    raise EvidenceError(
        f"there is no Minari data set {data!r} here" + " itself, but below it" * bool(parts),
        where=", ".join(map(str, places)),
        expected=f"a folder with data/{METADATA}",
        actual=", ".join(parts[:MOST_NAMED]) + ", ..." * (len(parts) > MOST_NAMED),
        fix=f"name one, as in minari:{parts[0]}"
        if parts
        else f"`minari download {data}` fetches one; or name its folder",
    )
