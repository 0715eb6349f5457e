"""Minari reads what we write, and what it holds is evidence again."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.errors import EvidenceError, RunError
from tests.adapters.data_games import DAY, NIGHT, SPARE, Shift, of_terms, rows_of
from tests.cli.lines import document, said

pytestmark = pytest.mark.trainer
TAG = "mpe2.simple_tag_v3:parallel_env"
TICTACTOE = "pettingzoo.classic.tictactoe_v3:env"


@pytest.fixture(autouse=True)
def _no_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Minari's folder under the user's home is never made."""
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)
    yield
    assert list(home.iterdir()) == []


def exported(run: Any, out: Path, **options: Any) -> Any:
    """The data sets of a run by name, as Minari loads them, and what the export says."""
    import minari

    from gamekeeper.adapters.minari import export

    told: list[str] = []
    written = export(run, out, say=told.append, **options)
    assert [f"lost: {each}" for each in written.lost] == told
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(out))
        assert set(minari.list_local_datasets()) >= set(written.parts)
        sets = {part.split("/")[-1][:-3]: minari.load_dataset(part) for part in written.parts}
    return sets, written


def at(value: Any, row: int) -> Any:
    """One value out of columns in the form of a Dict space."""
    return (
        {key: part[row] for key, part in value.items()} if isinstance(value, dict) else value[row]
    )


def same(one: Any, two: Any) -> None:
    """Both values are equal, bit for bit where they are arrays."""
    if isinstance(one, dict):
        assert set(one) == set(two)
        for key, part in one.items():
            same(part, two[key])
    elif isinstance(one, str):
        assert one == two
    else:
        assert np.asarray(one).dtype == np.asarray(two).dtype
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("spec", ["two_robot_line", "handover", "warehouse", TAG, TICTACTOE, Shift])
def test_data_set_holds_each_agents_decisions(spec: Any, tmp_path: Path) -> None:
    """What it saw, n + 1 of it, did and was paid in between; ends and seeds: as in the episode."""
    evidence = gk.rollout(spec, episodes=2, seed=5, policies="first-legal")
    sets, written = exported(evidence, tmp_path)
    for agent in written.agents:
        dataset, places = sets[agent], iter(range(99))
        for episode in evidence.episodes:
            turns = [
                t for t in episode.turns if agent in t.actions and t.actions[agent] is not None
            ]
            if not turns:  # a spare that nobody needed
                continue
            number = next(places)
            stored = dataset[number]
            seen = stored.observations
            assert (
                len(next(iter(seen.values())) if isinstance(seen, dict) else seen) == len(turns) + 1
            )
            for row, turn in enumerate(turns):
                same(turn.observations[agent], at(stored.observations, row))
                np.testing.assert_array_equal(turn.actions[agent], at(stored.actions, row))
                assert stored.infos["turn"][row] == turn.index
                if agent in turn.masks and "action_mask" in turn.infos[agent]:
                    same(turn.masks[agent], stored.infos["action_mask"][row])
            total = sum(
                t.rewards.get(agent, 0.0) for t in episode.turns if t.index >= turns[0].index
            )
            assert stored.rewards.sum() == pytest.approx(total)
            last = [t for t in episode.turns if agent in t.terminated][-1]
            assert stored.terminations[-1] == last.terminated[agent]
            assert stored.truncations[-1] == last.truncated[agent]
            assert not stored.terminations[:-1].any()
            told = next(iter(dataset.storage.get_episode_metadata([number])))
            assert told["seed"] == episode.seed
            assert told["gamekeeper"]["end"] == "ended"


def test_data_set_says_which_run_it_is(tmp_path: Path) -> None:
    """Fingerprint, source digest, seed and version of the environment are metadata."""
    evidence = gk.rollout("two_robot_line", episodes=1, seed=9)
    sets, _ = exported(evidence, tmp_path)
    about = sets["picker"].storage.metadata["gamekeeper"]
    assert about["fingerprint"] == evidence.fingerprint
    assert about["environment"] == evidence.manifest["environment"]
    assert (about["seed"], about["agents"], about["kind"]) == (9, ["picker"], "agent")


def test_pictures_are_kept_to_the_bit(tmp_path: Path) -> None:
    """Minari's own default is JPEG, which would change them; texts and counts stay too."""
    evidence = gk.rollout(Shift, episodes=1)
    sets, _ = exported(evidence, tmp_path)
    turns = list(evidence.episodes[0].turns)
    pictures = np.stack([turn.observations[NIGHT]["picture"] for turn in turns])
    np.testing.assert_array_equal(pictures, sets[NIGHT][0].observations["picture"])


def test_agent_is_paid_apart_for_what_came_before_its_first_decision(tmp_path: Path) -> None:
    """Who joins late may be paid before it decides: no decision of its own earned that."""
    sets, written = exported(gk.rollout(Shift, episodes=1), tmp_path)
    told = next(iter(sets[SPARE].storage.get_episode_metadata([0])))
    assert told["gamekeeper"]["paid_before"] == 2.0 + len(SPARE)
    assert any("before its first decision" in each for each in written.lost)


def test_decision_that_nothing_follows_is_left_out(tmp_path: Path) -> None:
    """A turn-based episode that was cut has no last observation, so none is made up."""
    evidence = gk.rollout("handover", episodes=2, policies="noop", most_turns=9)
    sets, written = exported(evidence, tmp_path)
    rows = [row for row in rows_of(evidence, "giver_0") if row["order"] is not None]
    assert len(sets["giver_0"][0]) == sum(row["episode"] == 0 for row in rows) - 1
    assert sets["giver_0"][0].truncations[-1]
    assert not sets["giver_0"][0].terminations.any()
    assert any(each.startswith("4 last decisions") for each in written.lost)
    assert any("have no joint action" in each for each in written.lost)


def test_episode_that_was_cut_ends_as_truncated(tmp_path: Path) -> None:
    """Minari knows two ends; which it was stands beside."""
    evidence = gk.rollout("two_robot_line", episodes=1, policies="noop", most_turns=3)
    sets, written = exported(evidence, tmp_path)
    assert sets["picker"][0].truncations.tolist() == [False, False, True]
    told = next(iter(sets["picker"].storage.get_episode_metadata([0])))
    assert told["gamekeeper"]["end"] == "cut"
    assert any("was cut" in each for each in written.lost)


@pytest.mark.parametrize("spec", ["two_robot_line", "warehouse", TAG, Shift])
def test_joint_data_set_is_read_as_the_same_evidence(spec: Any, tmp_path: Path) -> None:
    """All agents as one and back: the same rows, orders, masks, terms, seeds, ends, bit for bit."""
    from gamekeeper.adapters.minari import load

    evidence = gk.rollout(spec, episodes=2, seed=5, policies="first-legal")
    _, written = exported(evidence, tmp_path)
    again = load(tmp_path / written.parts[-1])
    assert written.parts[-1].endswith("joint-v0")
    imported = again.manifest["environment"]["imported"]
    assert imported["recorded"]["fingerprint"] == evidence.fingerprint != again.fingerprint
    for one, two in zip(evidence.episodes, again.episodes, strict=True):
        for name in ("seed", "end", "turns", "endings", "policies", "action_types"):
            assert one.header[name] == two.header[name]
        assert one.steps.to_pylist() == two.steps.to_pylist()


def test_joint_data_set_replays_in_the_environment_that_is_named(tmp_path: Path) -> None:
    """Seeds and actions are those of the run, so all turns are; without a name there is none."""
    from gamekeeper.adapters.minari import load

    _, written = exported(gk.rollout("two_robot_line", episodes=2, seed=5), tmp_path / "data")
    load(tmp_path / "data" / written.parts[-1], tmp_path / "run")
    assert gk.replay(tmp_path / "run", env="two_robot_line").verified
    unnamed = gk.replay(tmp_path / "run")
    assert unnamed.verified is False
    assert unnamed.reason == "an imported data set holds no environment: name it with --env"
    with pytest.raises(EvidenceError, match=r"name one, as in minari:.*carrier-v0"):
        load(tmp_path / "data")


def test_agent_of_ours_is_read_as_its_own_decisions(tmp_path: Path) -> None:
    """Masks, infos and terms come back; what an agent's data set doesn't say is named."""
    from gamekeeper.adapters.minari import load

    evidence = gk.rollout("handover", episodes=2, seed=5, policies="first-legal")
    _, written = exported(evidence, tmp_path / "data")
    again = load(tmp_path / "data" / written.parts[0], tmp_path / "run")
    rows = [row for row in rows_of(evidence, "giver_0") if row["order"] is not None]
    back = rows_of(again, "giver_0")
    assert len(back) == len(rows)
    for one, two in zip(rows, back, strict=True):
        for name in ("obs", "action", "action_mask", "terminated", "truncated", "info"):
            assert one[name] == two[name], name
    assert again.path == tmp_path / "run"
    assert again.manifest["status"] == "finalized"
    imported = again.manifest["environment"]["imported"]
    assert imported["recorded"]["fingerprint"] == evidence.fingerprint
    assert "the other agents" in imported["lacks"]
    replayed = gk.replay(tmp_path / "run", env="handover")
    assert (replayed.verified, replayed.divergence) == (False, None)
    assert "no actions of the others" in str(replayed.reason)


def foreign(out: Path, observation: Any, action: Any, **columns: Any) -> str:
    """A data set that Minari wrote by itself, in an episode of two steps."""
    import minari
    from minari.data_collector import EpisodeBuffer

    told = {"rewards": [1.0, 2.0], "terminations": [False, True], "truncations": [False, False]}
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of every part of the metadata that isn't given
        patch.setenv("MINARI_DATASETS_PATH", str(out))
        minari.create_dataset_from_buffers(
            "theirs/set-v3",
            [EpisodeBuffer(**{**told, **columns})],
            observation_space=observation,
            action_space=action,
            author="Ada",
        )
    return "theirs/set-v3"


def test_data_set_of_others_is_one_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it lacks is null; who made it is stated; infos stand step by step."""
    from gamekeeper.adapters.minari import load

    seen = np.arange(6, dtype=np.float32).reshape(3, 2)
    name = foreign(
        tmp_path,
        spaces.Box(-9, 9, (2,), np.float32),
        spaces.Discrete(4),
        observations=seen,
        actions=np.array([2, 3]),
        infos={"speed": np.array([0.5, 0.25, 0.125])},
    )
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    evidence = load(name, agent="cart")
    episode = evidence.episodes[0]
    turns = list(episode.turns)
    assert [turn.actions.get("cart") for turn in turns] == [2, 3, None]
    np.testing.assert_array_equal(seen, [turn.observations["cart"] for turn in turns])
    assert [turn.cumulative_reward["cart"] for turn in turns] == [0.0, 1.0, 2.0]
    assert [turn.infos["cart"]["speed"] for turn in turns] == [0.5, 0.25, 0.125]
    assert turns[-1].terminated["cart"]
    assert episode.seed is None
    assert episode.header["policies"] is None
    assert evidence.timings is None
    imported = evidence.manifest["environment"]["imported"]
    assert (imported["dataset_id"], imported["author"]) == (name, ["Ada"])
    assert evidence.summary.agents["cart"].return_mean == 3.0


def test_data_set_of_others_is_verified_in_its_environment(tmp_path: Path) -> None:
    """Its one agent is called as the Gymnasium environment's: no option is needed."""
    import gymnasium

    from gamekeeper.adapters.minari import load

    env = gymnasium.make("CartPole-v1")
    seen, rewards, ended = [env.reset(seed=3)[0]], [], [False]
    while not ended[-1]:
        observation, reward, terminated, _, _ = env.step(1)
        seen.append(observation)
        rewards.append(float(reward))
        ended.append(terminated)
    name = foreign(
        tmp_path,
        env.observation_space,
        env.action_space,
        observations=np.array(seen),
        actions=np.ones(len(rewards), np.int64),
        rewards=rewards,
        terminations=ended[1:],
        truncations=[False] * len(rewards),
        seed=3,
    )
    load(tmp_path / name, tmp_path / "run")
    replayed = gk.replay(tmp_path / "run", env="gymnasium:CartPole-v1")
    assert (replayed.verified, replayed.divergence, replayed.reason) == (True, None, None)


def test_value_of_another_dtype_is_nonconforming(tmp_path: Path) -> None:
    """A data set whose values aren't of its space is read as it is: nothing is coerced."""
    from gamekeeper.adapters.minari import load

    name = foreign(
        tmp_path,
        spaces.Box(-9, 9, (2,), np.float32),
        spaces.Discrete(4),
        observations=np.zeros((3, 2), np.float64),
        actions=np.array([2, 3]),
    )
    turn = load(tmp_path / name).episodes[0].turns[0]
    assert turn.nonconforming["agent_0"]["obs"]["type"] == "numpy.ndarray"
    assert turn.observations["agent_0"].dtype == np.float64


def test_dict_spaces_of_others_can_be_agents(tmp_path: Path) -> None:
    """One reward and no order for all: each agent's own is null, the joint one stands in infos."""
    from gamekeeper.adapters.minari import load

    both = {name: spaces.Discrete(5) for name in ("a", "b")}
    columns = {"a": np.array([1, 2, 3]), "b": np.array([4, 3, 2])}
    name = foreign(
        tmp_path,
        spaces.Dict(both),
        spaces.Dict(both),
        observations=columns,
        actions={key: column[:2] for key, column in columns.items()},
    )
    evidence = load(tmp_path / name, joint=True)
    rows = evidence.agent_steps.to_pylist()
    assert {row["agent"] for row in rows} == {"a", "b"}
    assert {(row["order"], row["reward"], row["cumulative_reward"]) for row in rows} == {
        (None, None, None)
    }
    turn = evidence.episodes[0].turns[0]
    assert (turn.actions["b"], turn.infos["b"]) == (4, {"joint_reward": 1.0})
    assert "the order of actions" in evidence.manifest["environment"]["imported"]["lacks"]
    with pytest.raises(EvidenceError, match="an entry for each agent"):
        load(foreign_box(tmp_path / "other"), joint=True)


def test_import_takes_entries_of_dict_spaces_as_agents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """With --joint two agents; without one, called as --agent says; never both options."""
    both = spaces.Dict({name: spaces.Discrete(5) for name in ("a", "b")})
    columns = {"a": np.array([1, 2, 3]), "b": np.array([4, 3, 2])}
    acts = {key: column[:2] for key, column in columns.items()}
    name = foreign(tmp_path, both, both, observations=columns, actions=acts)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    line = ("import", f"minari:{name}", "--out")
    assert set(document(capfd, *line, tmp_path / "two", "--joint")[1]["agents"]) == {"a", "b"}
    assert set(document(capfd, *line, tmp_path / "one", "--agent", "hand")[1]["agents"]) == {"hand"}
    code, found = document(capfd, *line, tmp_path / "no", "--joint", "--agent", "hand")
    assert (code, found["error"]["fix"]) == (2, "leave one of the two out")
    foreign_box(tmp_path / "box")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "box"))
    code, found = document(capfd, *line, tmp_path / "no", "--joint")
    assert (code, "without --joint" in found["error"]["fix"]) == (2, True)
    assert not (tmp_path / "no").exists()


def foreign_box(out: Path) -> Path:
    """A data set whose spaces are no Dict."""
    name = foreign(
        out,
        spaces.Box(-9, 9, (2,), np.float32),
        spaces.Discrete(4),
        observations=np.zeros((3, 2), np.float32),
        actions=np.array([2, 3]),
    )
    return out / name


def test_data_set_without_spaces_is_refused(tmp_path: Path) -> None:
    """To ask an environment for them would run code that the data set names."""
    from gamekeeper.adapters.minari import load

    path = foreign_box(tmp_path) / "data" / "metadata.json"
    about = json.loads(path.read_text())
    del about["action_space"]
    path.write_text(json.dumps(about))
    with pytest.raises(EvidenceError, match="doesn't name its spaces"):
        load(path.parent)


def test_damaged_data_set_leaves_no_evidence(tmp_path: Path) -> None:
    """Half a data set isn't evidence of it: the error names the folder, and nothing is left."""
    from gamekeeper.adapters.minari import load

    folder = foreign_box(tmp_path / "data")
    path = folder / "data" / "main_data.hdf5"
    path.write_bytes(path.read_bytes()[:600])
    for out in (None, tmp_path / "run"):
        with pytest.raises(RunError, match="can't be read") as told:
            load(folder, out)
        assert str(folder) in told.value.where
    assert not (tmp_path / "run").exists()


def test_what_minari_cannot_hold_is_refused(tmp_path: Path) -> None:
    """Odd values, digests, spaces without a fixed shape, joint turns: each with a fix."""
    from gamekeeper.adapters.minari import export

    class Long(Shift):
        def __init__(self) -> None:
            super().__init__()
            self.observation_spaces[DAY] = spaces.Sequence(spaces.Discrete(3))

    nonconforming = gk.rollout(lambda: Shift(nonconforming="observation"), episodes=1)
    with pytest.raises(EvidenceError, match="isn't of its space") as told:
        export(nonconforming, tmp_path / "data")
    assert "turn 1" in told.value.where
    with pytest.raises(EvidenceError, match="Minari can't hold a space"):
        export(gk.rollout(Long, episodes=1), tmp_path / "data")
    gk.rollout("two_robot_line", episodes=1, level="digest", out=tmp_path / "run")
    with pytest.raises(EvidenceError, match="only their digests"):
        export(tmp_path / "run", tmp_path / "data")
    with pytest.raises(EvidenceError, match="can't be one data set"):
        export(gk.rollout("handover", episodes=1), tmp_path / "data", joint=True)
    with pytest.raises(EvidenceError, match="no folder"):
        export(nonconforming)
    assert not (tmp_path / "data").exists()


def test_data_sets_grow_part_by_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However little waits in memory, the data sets are the same."""
    from gamekeeper.adapters.minari import minari_agents as sets

    evidence = gk.rollout("handover", episodes=5, seed=2)
    whole, _ = exported(evidence, tmp_path / "a")
    monkeypatch.setattr(sets, "WAITING_BYTES", 1)
    parts, _ = exported(evidence, tmp_path / "b")
    for name, dataset in whole.items():
        assert parts[name].total_steps == dataset.total_steps
        for one, two in zip(dataset, parts[name], strict=True):
            same(one.observations, two.observations)
            same(one.rewards, two.rewards)
        numbers = range(len(dataset))
        seeds = [
            [told["seed"] for told in each.storage.get_episode_metadata(numbers)]
            for each in (dataset, parts[name])
        ]
        assert seeds[0] == seeds[1]


def test_command_writes_and_reads_data_sets(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`export RUN --to minari`, then `import minari:ID`; what exists stays."""
    run, data = tmp_path / "demo", tmp_path / "data"
    gk.rollout("two_robot_line", episodes=2, out=run)
    code, found = document(capfd, "export", run, "--to", "minari", "--out", data)
    names = [f"two_robot_line_v0/demo/{name}-v0" for name in ("picker", "carrier", "joint")]
    assert (code, found["parts"]) == (0, names)
    assert said(capfd, "export", run, "--to", "minari", "--out", data)[0] == 2
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(data))
    back = tmp_path / "back"
    code, found = document(capfd, "import", f"minari:{names[2]}", "--out", back)
    assert (code, found["status"], found["imported"]["dataset_id"]) == (0, "finalized", names[2])
    returns, again = (
        {
            name: (each.return_mean, each.length_mean)
            for name, each in evidence.summary.agents.items()
        }
        for evidence in (gk.load(run), gk.load(back))
    )
    assert returns == again
    assert said(capfd, "verify", back)[0] == 0
    assert said(capfd, "replay", back)[0] == 2
    code, _, err = said(capfd, "export", "minari:nobody/nothing-v0", "--to", "numpy", "--out", "x")
    assert (code, "there is no Minari data set" in err) == (2, True)


def test_broken_export_leaves_nothing(tmp_path: Path) -> None:
    """A data set that is there already stops an export before another is made."""
    from gamekeeper.adapters.minari import export

    evidence = gk.rollout("two_robot_line", episodes=1)
    export(evidence, tmp_path, agents=["carrier"], say=lambda _: None)
    before = sorted(path.name for path in (tmp_path / "two_robot_line_v0").iterdir())
    with pytest.raises(RunError, match="a data set of that id"):
        export(evidence, tmp_path, say=lambda _: None)
    assert before == sorted(path.name for path in (tmp_path / "two_robot_line_v0").iterdir())


def test_terms_that_nothing_tells_are_unknown_there_and_back(tmp_path: Path) -> None:
    """NaN in the data sets, with a word; null again in evidence, row by row."""
    from gamekeeper.adapters.minari import load

    sets, written = exported(evidence := of_terms(policies="first-legal", seed=5), tmp_path)
    assert np.isnan(sets[DAY][0].infos["terms"]["care"][1:]).all()
    assert any("by which terms" in each for each in written.lost)
    back = [load(tmp_path / part).agent_steps.to_pylist() for part in written.parts]
    assert back[-1] == evidence.agent_steps.to_pylist()
    assert {row["reward.care"] for row in back[1]} == {None}
