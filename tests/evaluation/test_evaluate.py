"""Evaluations, played."""

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from gamekeeper.errors import EvidenceError, RunError, SpecError
from gamekeeper.evaluation.evaluation import Evaluation
from gamekeeper.evaluation.evaluator import evaluate, load_evaluation
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.tasks.two_robot_line import reference
from tests.evaluation.policies import names

BOTH = {"reference": "reference", "random": "random"}
SHORT = {"n": 9}


def rows(found: Evaluation, **wanted: Any) -> list[Any]:
    """The result rows with these fields."""
    return [row for row in found.results if all(row[k] == v for k, v in wanted.items())]


def test_evaluate_plays_everybody_the_same_seeds(tmp_path: Path) -> None:
    """Every policy's episode k has the seed of episode k, and its own row for each agent."""
    found = evaluate("two_robot_line", policies=BOTH, episodes=21, seed=3, out=tmp_path / "e")
    table = pq.read_table(tmp_path / "e" / "episodes.parquet")
    assert table.num_rows == 2 * 21 * 2
    seeds = {(row["pairing"], row["episode"]): row["seed"] for row in table.to_pylist()}
    for name in BOTH:
        assert [episode_seed(3, k) for k in range(21)] == [seeds[name, k] for k in range(21)]
    assert {"reward.meeting", "length", "ending", "success"} <= set(table.schema.names)
    assert found.episodes == 21
    assert found == load_evaluation(tmp_path / "e")


def test_evaluate_tells_team_roles_and_agents_apart() -> None:
    """Sums over the team, means in a role, each agent by itself; endings by flag and reason."""
    found = evaluate("two_robot_line", policies=BOTH, episodes=20)
    team, picker, agent = (
        rows(found, policy="reference", who=who, scope=scope, metric="return")[0]
        for who, scope in (("team", "team"), ("picker", "role"), ("picker", "agent"))
    )
    assert tuple(row["mean"]["value"] for row in (team, picker, agent)) == (2.0, 1.0, 1.0)
    assert {key: team["success"][key] for key in ("hits", "n")} == {"hits": 20, "n": 20}
    assert tuple(team["endings"][k] for k in ("terminated", "truncated", "cut")) == (20, 0, 0)
    assert team["endings"]["reasons"] == {"met": 20}


def test_evaluate_claims_about_a_checkpoint_say_so_and_need_episodes() -> None:
    """Twenty episodes have no interval of the mean; the reason is told, and the figure stays."""
    found = evaluate("two_robot_line", policies=BOTH, episodes=20)
    mean = rows(found, policy="random", scope="team", metric="length")[0]["mean"]
    assert mean["value"] > 0
    assert mean["low"] is None
    assert any("at least 95 episodes" in row["why"] for row in found.refused)
    assert any("not about how it was trained" in claim for claim in found.notes)


def test_few_pairs_say_which_is_more_often_above() -> None:
    """Twelve pairs give a difference no interval; that all of them agree is an exact p-value."""
    found = evaluate(
        "two_robot_line",
        policies={"met": "reference", "still": "noop"},
        episodes=12,
        env_kwargs=SHORT,
    )
    row = next(
        row for row in found.comparisons if (row["who"], row["metric"]) == ("team", "return")
    )
    assert row["difference"]["low"] is None
    assert (row["difference"]["above"], row["difference"]["below"]) == (12, 0)
    assert row["difference"]["p_alone"] == pytest.approx(2.0**-11)
    assert row["improvement"]["low"] == pytest.approx(0.025 ** (1 / 12))
    assert "met is above still in each of 12 pairs, p =" in row["claim"]


def test_evaluate_compares_on_shared_seeds_with_correction() -> None:
    """Paired over episodes, the p-values corrected for how many there are."""
    found = evaluate(
        "two_robot_line", policies={**BOTH, "still": "noop"}, episodes=60, env_kwargs=SHORT
    )
    by_pair = {
        (row["a"], row["b"]): row
        for row in found.comparisons
        if (row["who"], row["metric"]) == ("team", "success")
    }
    row = by_pair["reference", "still"]
    assert (row["unit"], row["n"]) == ("episode", 60)
    assert (row["difference"]["value"], row["improvement"]["value"]) == (1.0, 1.0)
    assert row["difference"]["p"] > row["difference"]["p_alone"]
    assert "is above" in row["claim"]
    assert len(by_pair) == 3


def test_evaluate_takes_training_runs_as_the_unit() -> None:
    """Thirty runs have an interval over runs; three are listed, without one."""
    many = evaluate(
        "two_robot_line",
        policies={"method": names(30), "still": "noop"},
        episodes=20,
        env_kwargs=SHORT,
    )
    (over,) = rows(many, run=None, scope="team", metric="length")
    assert (over["runs"], over["episodes"]) == (30, 20)
    assert over["mean"]["low"] < over["mean"]["value"] < over["mean"]["high"]
    assert (
        len(
            [
                r
                for r in rows(many, scope="team", metric="length", policy="method")
                if r["run"] is not None
            ]
        )
        == 30
    )
    compared = next(row for row in many.comparisons if row["who"] == "team")
    assert (compared["unit"], compared["n"]) == ("run", 30)
    few = evaluate("two_robot_line", policies={"method": names(3)}, episodes=20, env_kwargs=SHORT)
    (over,) = rows(few, run=None, scope="team", metric="length")
    assert over["mean"]["low"] is None
    assert any("too few for some intervals over runs" in claim for claim in few.notes)


def test_evaluate_refuses_one_run_under_two_names() -> None:
    """Counted twice, it would make intervals too narrow."""
    spec = {
        "environments": {"e": "two_robot_line"},
        "policies": {"m": [{"*": "random"}, {"picker": "random", "*": "random"}]},
    }
    found = evaluate(spec, episodes=1)  # other positions: another run
    assert found.policies["m"]["runs"] == 2
    spec["policies"] = {"m": [reference, lambda o, a, i, r: 1]}
    assert evaluate(spec, episodes=1).policies["m"]["runs"] == 2
    spec["policies"] = {"m": ["random", "random "]}
    with pytest.raises(EvidenceError, match="one and the same"):
        evaluate(spec, episodes=1)


def test_evaluate_gives_equal_bytes_by_workers_and_here(tmp_path: Path) -> None:
    """In this process, and by two: the same document and the same table."""
    told = {"policies": BOTH, "episodes": 45, "env_kwargs": SHORT, "crossplay": True}
    evaluate("two_robot_line", **told, out=tmp_path / "here")  # type: ignore[arg-type]  # a dict of any
    evaluate("two_robot_line", **told, out=tmp_path / "apart", workers=2)  # type: ignore[arg-type]  # a dict of any
    for name in ("evaluation.json", "episodes.parquet"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "apart" / name).read_bytes()


def test_evaluate_again_plays_only_what_is_missing_or_stale(tmp_path: Path) -> None:
    """More episodes: the new ones. An edited policy: its own; and it says why."""
    policy = tmp_path / "mine.py"
    policy.write_text("def act(observation, agent, info, rng):\n    return 2\n")
    spec = {
        "name": "again",
        "environments": {"e": {"spec": "two_robot_line", "kwargs": SHORT}},
        "policies": {"mine": f"{policy}:act", "random": "random"},
    }
    told: list[str] = []

    def run(episodes: int) -> Evaluation:
        told.clear()
        return evaluate(spec, episodes=episodes, out=tmp_path / "e", on_note=told.append)

    first = run(20)
    assert told == ["40 episodes played"]
    assert first == run(20)
    assert told == ["no episode was missing: 40 were there already"]
    run(40)
    assert told == ["40 episodes played, 40 were there already"]
    policy.write_text("def act(observation, agent, info, rng):\n    return 0\n")
    changed = run(40)
    assert "policy mine in e is stale: its file or source changed" in told
    assert "40 episodes played, 40 were there already" in told
    assert first.fingerprint != changed.fingerprint


def test_evaluate_leaves_other_folders_alone(tmp_path: Path) -> None:
    """Whether a stranger's, or another evaluation's."""
    (tmp_path / "x.txt").write_text("mine")
    with pytest.raises(RunError, match="something else"):
        evaluate("two_robot_line", policies=BOTH, episodes=1, out=tmp_path)
    evaluate("two_robot_line", policies=BOTH, episodes=1, out=tmp_path / "e")
    with pytest.raises(RunError, match="two_robot_line"):
        evaluate("tictactoe", policies={"random": "random"}, episodes=1, out=tmp_path / "e")


def test_evaluate_refuses_to_lose_results(tmp_path: Path) -> None:
    """Another seed, fewer episodes or policies, other arguments; more of them are added."""
    at = {"env_kwargs": SHORT, "out": tmp_path / "e"}
    evaluate("two_robot_line", policies=BOTH, episodes=4, crossplay=True, **at)  # type: ignore[arg-type]  # a dict of any
    before = (tmp_path / "e" / "evaluation.json").read_bytes()
    one = {name: BOTH[name] for name in list(BOTH)[:1]}
    for changed, said in (
        ({"policies": BOTH, "episodes": 4, "seed": 1}, "seed 0 there, 1 asked for"),
        ({"policies": BOTH, "episodes": 3}, "4 episodes there, 3 asked for"),
        ({"policies": one, "episodes": 4}, "now without it"),
        ({"policies": dict.fromkeys(BOTH, "noop"), "episodes": 4}, "policy .* as .*, now "),
        ({"policies": BOTH, "episodes": 4, "env_kwargs": {"n": 7}}, "kwargs of two_robot_line"),
        ({"policies": BOTH, "episodes": 4}, "cross-play in two_robot_line"),
    ):
        with pytest.raises(RunError, match=said) as refused:
            evaluate("two_robot_line", **{**at, **changed})  # type: ignore[arg-type]  # a dict of any
        assert "--out" in str(refused.value)
        assert before == (tmp_path / "e" / "evaluation.json").read_bytes()
    more = {**BOTH, "more": "noop"}
    found = evaluate("two_robot_line", policies=more, episodes=5, crossplay=True, **at)  # type: ignore[arg-type]  # a dict of any
    assert (found.episodes, set(found.policies)) == (5, set(more))


def test_evaluate_counts_broken_episodes_as_failed() -> None:
    """They have no return; how many there were, and why, is said."""
    policies = {"bad": "tests.evaluation.policies:failing", "random": "random"}
    found = evaluate("two_robot_line", policies=policies, episodes=20)
    (row,) = rows(found, policy="bad", scope="team", metric="length")
    assert (row["success"]["hits"], row["endings"]["failed"]) == (0, 20)
    assert rows(found, policy="bad", metric="return") == []
    assert any("no idea" in claim for claim in found.notes)
    assert any("exception" in row["why"] for row in found.refused)


def test_evaluate_stops_when_it_is_known_well_enough() -> None:
    """Everybody plays the same number; the interval allows for having looked."""
    spec = {
        "environments": {"e": {"spec": "two_robot_line", "kwargs": SHORT}},
        "policies": {"reference": "reference", "random": "random"},
        "seeds": {"episodes": 20},
        "stop": {"metric": "success", "width": 0.2, "most": 200, "every": 20},
    }
    found = evaluate(spec)
    assert found.stopping is not None
    assert found.stopping["reached"]
    assert 20 < found.episodes < 200
    assert all(row["width"] <= 0.2 for row in found.stopping["sequences"])
    (row,) = rows(found, policy="random", scope="team", metric="return")
    assert row["success"]["high"] - row["success"]["low"] <= 0.2
    assert any("allow for looking" in claim for claim in found.notes)
    spec["stop"] = {"metric": "length", "width": 1e-6, "most": 30, "every": 10}
    found = evaluate(spec)
    assert found.stopping is not None
    assert (found.stopping["reached"], found.episodes) == (False, 30)


def test_evaluate_takes_success_as_it_is_asked() -> None:
    """A condition in place of the contract's failure, for the team and for each agent."""
    spec = {
        "environments": {
            "e": {
                "spec": "two_robot_line",
                "success": {"team": "length <= 4", "agent": "meeting > 0"},
            }
        },
        "policies": {"reference": "reference", "still": "noop"},
    }
    found = evaluate(spec, episodes=5)
    told = {
        (row["policy"], row["who"], row["scope"]): row["success"]["p"]
        for row in found.results
        if row["success"] is not None
    }
    assert told["reference", "team", "team"] == 1.0
    assert 0.0 == told["still", "team", "team"] == told["still", "picker", "agent"]


def test_evaluate_plays_objects_here_and_refuses_to_send_them() -> None:
    """A function in memory is played in this process only."""
    policies = {"mine": reference, "random": "random"}
    found = evaluate("two_robot_line", policies=policies, episodes=2)
    assert "<gamekeeper.tasks.two_robot_line.reference>" in json.dumps(found.to_json())
    with pytest.raises(EvidenceError, match="workers=0"):
        evaluate("two_robot_line", policies=policies, episodes=2, workers=1)


def test_evaluate_keeps_evidence_that_replays(tmp_path: Path) -> None:
    """A run for each line-up, whose returns are those of the raw episodes."""
    import gamekeeper as gk

    found = evaluate("two_robot_line", policies=BOTH, episodes=3, out=tmp_path / "e", record="full")
    assert [row["pairing"] for row in found.evidence] == ["reference", "random"]
    for row in found.evidence:
        assert row["differs"] == 0
        assert gk.replay(tmp_path / "e" / row["folder"]).verified
        assert row["fingerprint"] == gk.load(tmp_path / "e" / row["folder"]).fingerprint


def test_evaluate_says_what_it_needs() -> None:
    """Nobody to evaluate; arguments beside a specification."""
    with pytest.raises(SpecError, match="no policy is named to be evaluated"):
        evaluate("two_robot_line")
    with pytest.raises(SpecError, match="says what its environments are given"):
        evaluate("gk-tasks-1", env_kwargs={"n": 3})


def test_evaluate_sees_rewards_that_cancel_without_a_contract() -> None:
    """Every episode adds up to 0: there is no team, but an environment may be said to have one."""
    from pettingzoo.classic import connect_four_v3

    found = evaluate(connect_four_v3.env, policies={"random": "random"}, episodes=3)
    assert list(found.environments) == ["connect_four"]
    assert rows(found, scope="team", metric="return") == []
    spec = {
        "environments": {"c": {"spec": "connect_four", "team": True}},
        "policies": {"r": "random"},
    }
    assert rows(evaluate(spec, episodes=3), scope="team", metric="return")


def test_evaluation_goes_to_json_and_back() -> None:
    """And shows itself as text and as a table."""
    found = evaluate("two_robot_line", policies=BOTH, episodes=2)
    again = Evaluation.from_json(json.loads(json.dumps(found.to_json())))
    assert found == again
    assert "reference" in str(found)
    assert found._repr_html_().startswith("<table>")
    with pytest.raises(EvidenceError, match="no evaluation"):
        Evaluation.from_json({"kind": "record"})
