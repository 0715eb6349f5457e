"""Attribution of runs whose parts are known by the rules of their games."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.attribution.contributions import attribute
from gamekeeper.errors import PolicyError, RunError, TrustError
from gamekeeper.reporting.attribution_text import attribution_text
from tests.diagnosis.attribution import games
from tests.runs.parts.here import Here

ROBOTS = ("robot_0", "robot_1", "robot_2")


@cache
def _shoving(one=None, *, whom="robot_1", fair=True, fresh=5, baseline="noop"):
    """Robots that step but for one that plays `one`."""
    policies = {"*": games.step, **({whom: one} if one else {})}
    evidence = gk.rollout(
        games.Shoving,
        policies=policies,
        episodes=3,
        contract=games.SHOVING,
        env_kwargs={"fair": fair},
    )
    return attribute(
        evidence, env=games.Shoving, policies=policies, episodes=fresh, baseline=baseline
    )


def test_attribution_of_a_sum_is_each_ones_own_part() -> None:
    """Where what agents bring adds up, Shapley value and difference are that, the idle one's 0."""
    found = _shoving(games.still, fresh=50)
    brought = games.TICKS * 3.0  # each step pays all three
    for name, value in zip(ROBOTS, (brought, 0.0, brought), strict=True):
        part = found.agents[name]
        assert part.shapley is not None
        assert part.difference is not None
        assert part.turn_all is not None
        values = (part.shapley.value, part.difference.value, part.turn_all.value)
        assert values == pytest.approx((value,) * 3)
        assert part.difference.baseline == "noop"
    assert (found.everyone, found.nobody, found.method) == (2 * brought, 0.0, "exact")


def test_lazy_agent_is_found_though_it_is_paid() -> None:
    """The one that does nothing has the same own reward, and is the only lazy one."""
    found = _shoving(games.still, fresh=50)
    assert found.agents["robot_1"].own.value == found.agents["robot_0"].own.value
    assert found.agents["robot_1"].own.idle == 1.0
    assert [part.laziness.is_lazy for part in found.agents.values()] == [False, True, False]
    assert found.lazy == ("robot_1",)


def test_no_agent_is_lazy_where_none_works() -> None:
    """Where nobody of a role brings anything, nobody stands out."""
    evidence = gk.rollout(games.Shoving, policies=games.still, episodes=2, contract=games.SHOVING)
    found = attribute(evidence, env=games.Shoving, policies={"*": games.still})
    assert found.lazy == ()


def test_single_action_is_worth_what_it_pays() -> None:
    """One step less costs the team the pay of one step."""
    part = _shoving().agents["robot_0"]
    assert part.turn_one is not None
    assert part.turn_one.value == pytest.approx(3.0)
    assert part.own.terms == {"progress": 36.0, "bump": 0.0}


def test_penalty_on_the_wrong_participant_is_found() -> None:
    """Who is shoved pays for what its neighbour did; the first time is named to be seen again."""
    found = _shoving(games.shove_at_times, whom="robot_0", fair=False)
    (wrong,) = found.wrong_penalties
    assert (wrong.agent, wrong.term, dict(wrong.by)) == ("robot_1", "bump", {"robot_0": 12})
    assert (wrong.wrong.p, wrong.unknown) == (1.0, 0)
    assert wrong.wrong.low > 0.7
    assert wrong.first is not None
    assert wrong.first["episode"] == 0
    assert wrong.first["turn"] % 3 == 0
    assert wrong.first["causers"] == ["robot_0"]


@pytest.mark.parametrize("told", ["plain", "nested", "total", "never"])
def test_terms_of_an_ordinary_environment_are_read_from_infos(told) -> None:
    """They count where they sum to what was paid; else it is said that they couldn't be read."""
    policies = {"*": games.step, "robot_0": games.shove_at_times}
    evidence = gk.rollout(
        games.PlainShoving,
        policies=policies,
        episodes=1,
        contract=games.SHOVING,
        env_kwargs={"told": told},
    )
    found = attribute(evidence, env=games.PlainShoving, policies=policies, episodes=0)
    untold = {each["what"]: each["why"] for each in found.not_tested}
    why = untold.get("rewards and penalties by declared term")
    if told in ("plain", "nested"):
        (wrong,) = found.wrong_penalties
        assert (wrong.agent, wrong.term, list(wrong.by), why) == (
            "robot_1",
            "bump",
            ["robot_0"],
            None,
        )
        assert found.agents["robot_1"].own.terms == {"progress": 32.0, "bump": -2.0}
        return
    assert not found.penalties
    assert not found.agents["robot_1"].own.terms
    never = told == "never"
    assert why == ("bump, progress: never in infos" if never else "in infos, but not what was paid")


def test_a_stopped_attribution_goes_on(tmp_path: Path) -> None:
    """What was played isn't played again, and another attribution isn't taken for this one."""
    policies = {"*": games.step}
    evidence = gk.rollout(games.Shoving, policies=policies, episodes=2, contract=games.SHOVING)
    seen = []

    def stop(fields: dict[str, int]) -> None:
        seen.append(fields)
        if len(seen) == 4:
            raise KeyboardInterrupt

    again = {"env": games.Shoving, "policies": policies, "episodes": 3}
    with pytest.raises(KeyboardInterrupt) as caught:
        attribute(evidence, out=tmp_path, on_message=stop, **again)
    assert "the same command goes on from there" in caught.value.__notes__[0]
    found = attribute(evidence, out=tmp_path, **again)
    assert found.reused == 4
    assert {**found.to_json(), "reused": 0} == attribute(evidence, **again).to_json()
    with pytest.raises(RunError, match="another experiment"):
        attribute(evidence, out=tmp_path, seed=1, **again)


def test_a_budget_of_steps_binds_and_says_what_it_left() -> None:
    """Some of each kind is played, and the rest is named."""
    policies = {"*": f"{games.HERE}:step"}
    options = {"policies": policies, "episodes": 20, "action_episodes": 6, "allow_import": True}
    evidence = gk.rollout(
        f"{games.HERE}:make", policies=policies, episodes=6, contract=games.SHOVING
    )
    whole = attribute(evidence, **options)
    found = attribute(evidence, budget=whole.steps // 2, **options)
    assert whole.steps // 3 < found.steps <= whole.steps // 2
    assert 0 < found.fresh < 20
    assert 0 < found.episodes < 6
    why = {each["what"]: each["why"] for each in found.not_tested}
    left = f"{20 - found.fresh} new episodes with agents replaced"
    assert why[left] == "the budget of env steps was reached (--budget)"
    assert left in attribution_text(found.to_json(), width=80)


def test_penalty_on_the_one_that_earned_it_is_right() -> None:
    """The same shoves, paid by whom they come from."""
    found = _shoving(games.shove_at_times, whom="robot_0")
    (own,) = found.penalties
    assert (own.agent, own.wrong.p, own.is_wrong) == ("robot_0", 0.0, False)


@pytest.mark.parametrize("fair", [True, False])
def test_penalty_in_turns_is_of_whom_it_comes_from(fair) -> None:
    """In an AEC game the cause is looked for among what everybody did last."""
    policies = {"*": games.step, "robot_2": games.shove_at_times}
    declared = games.SHOVING.to_toml().replace("parallel", "aec")
    contract = gk.Contract.parse(declared.replace("shoving_v0", "shoving_turns_v0"))
    evidence = gk.rollout(
        games.ShovingInTurns,
        policies=policies,
        episodes=2,
        contract=contract,
        env_kwargs={"fair": fair},
    )
    found = attribute(evidence, env=games.ShovingInTurns, policies=policies, episodes=1)
    wrong = [(each.agent, set(each.by)) for each in found.wrong_penalties]
    assert wrong == ([] if fair else [("robot_0", {"robot_2"})])


def test_influence_is_of_whom_it_reaches() -> None:
    """A shove is seen by the next robot when it decides next, and by nobody before it."""
    found = _shoving(games.shove_at_times, whom="robot_0")
    seen = {
        (row["from"], row["to"]): row["p"]
        for row in found.influence
        if row["on"] == "observation" and row["lag"] == 1
    }
    assert seen["robot_0", "robot_1"] > 0
    assert seen["robot_0", "robot_2"] == 0
    assert seen["robot_0", "robot_0"] == 0
    assert all(row["p"] == 0 for row in found.influence if row["on"] == "ending")
    rewards = [row for row in found.influence if row["on"] == "reward" and row["lag"] > 0]
    assert {row["p"] for row in rewards} == {0.0}


def _talking(speaker, hearer):
    policies = {"speaker_0": speaker, "hearer_0": hearer}
    evidence = gk.rollout(games.Talking, policies=policies, episodes=3, contract=games.TALKING)
    return attribute(evidence, env=games.Talking, policies=policies)


def test_messages_that_tell_and_are_heeded_are_found() -> None:
    """A speaker that says what it sees signals; a hearer that does what it hears listens."""
    found = _talking(games.says_goal, games.obeys)
    kinds = {(talk.kind, talk.source, talk.to): talk for talk in found.messages}
    signalling = kinds["signalling", "speaker_0", None]
    assert signalling.p <= 0.01
    assert signalling.bits is not None
    assert signalling.bits > 1.0
    assert kinds["coordination", "speaker_0", "hearer_0"].p <= 0.01
    listening = kinds["listening", None, "hearer_0"]
    assert listening.share is not None
    assert (listening.share.p, listening.unchanged) == (1.0, 0.0)


def test_messages_that_tell_nothing_are_not_found() -> None:
    """A speaker that babbles doesn't signal; a deaf hearer decides the same whatever it hears."""
    found = _talking(games.babbles, games.is_deaf)
    kinds = {(talk.kind, talk.source, talk.to): talk for talk in found.messages}
    assert kinds["signalling", "speaker_0", None].p > 0.01
    assert kinds["coordination", "speaker_0", "hearer_0"].p > 0.01
    listening = kinds["listening", None, "hearer_0"]
    assert (listening.p, listening.unchanged) == (0.0, 0.0)


def test_agent_without_a_noop_is_measured_against_random() -> None:
    """The baseline that took its place is named with the figure; laziness isn't told from it."""
    part = _talking(games.says_goal, games.obeys).agents["speaker_0"]
    assert part.difference is not None
    assert part.difference.baseline == "random"
    assert part.laziness.is_lazy is None


def test_attribution_takes_actions_that_are_arrays() -> None:
    """Boxes of several numbers, within dictionaries too, are replaced and compared as any."""
    evidence = gk.rollout(games.Thrust, episodes=2, seed=3)
    found = attribute(evidence, env=games.Thrust, episodes=2, action_episodes=2)
    assert {"drone_0", "drone_1"} == set(found.agents)
    reached = {(r["from"], r["to"]) for r in found.influence if r["p"] > 0}
    assert reached == {("drone_0", "drone_0"), ("drone_1", "drone_1")}


def test_text_tells_which_baseline_played_and_keeps_to_the_terminal() -> None:
    """Without a noop chance plays, and the first legal action stands still; nothing is wider."""
    evidence = gk.rollout(games.Thrust, episodes=2, seed=3)
    found = attribute(evidence, env=games.Thrust, episodes=2, action_episodes=2)
    text = attribution_text(found.to_json(), width=80)
    assert "(random, as no noop is declared)" in " ".join(text.split())
    assert "if the agent's first legal action (no noop is declared) replaces" in " ".join(
        text.split()
    )
    assert max(map(len, text.splitlines())) <= 80


def _by_hand(episodes: int):
    env = games.Shoving()
    from gamekeeper.interface.recorded_env import capture_of
    from gamekeeper.rollouts.memory import MemorySink

    sink = MemorySink(terms=tuple(games.SHOVING.rewards))
    capture = capture_of(env, sink=sink)
    for seed in range(episodes):
        capture.reset(seed)
        while capture.to_move:
            capture.step(dict.fromkeys(capture.to_move, games.STEP))
        capture.end_episode()
    return sink.evidence({"api": "parallel", "kind": "object"}, contract=games.SHOVING)


def test_run_without_policies_is_looked_into_action_by_action() -> None:
    """Nobody can react, so there is no difference reward; and it says so."""
    found = attribute(_by_hand(2), env=games.Shoving)
    part = found.agents["robot_0"]
    assert (found.loop, found.everyone, part.difference, part.shapley) == ("open", None, None, None)
    assert part.turn_all is not None
    assert (part.turn_all.value, part.turn_all.low, part.turn_all.n) == (36.0, None, 2)
    assert part.laziness.is_lazy is None
    assert "names no policies" in found.not_tested[0]["why"]


def test_fewer_episodes_have_no_interval() -> None:
    """Below fifty fresh episodes a figure stands alone, and laziness is not told."""
    found = _shoving(games.still)
    part = found.agents["robot_1"]
    assert part.shapley is not None
    assert (part.shapley.low, part.shapley.n, found.lazy) == (None, 5, ())


def test_large_team_is_sampled_and_still_sums() -> None:
    """Beyond eight players orders are drawn; the values sum to all less none all the same."""
    policies = {"*": games.step, "robot_3": games.still}
    evidence = gk.rollout(
        games.Shoving,
        policies=policies,
        episodes=2,
        contract=games.SHOVING,
        env_kwargs={"robots": 10},
    )
    found = attribute(evidence, env=games.Shoving, policies=policies, episodes=6)
    assert found.method == "sampled"
    values = [part.shapley.value for part in found.agents.values() if part.shapley is not None]
    assert (found.everyone, found.nobody) == (10 * 9 * games.TICKS, 0.0)
    assert sum(values) == pytest.approx(10 * 9 * games.TICKS)
    assert values[3] == 0.0


def test_attribution_of_turns_sums(tmp_path: Path) -> None:
    """An AEC game is attributed the same way."""
    evidence = gk.rollout("tictactoe", policies="random", episodes=3, out=tmp_path / "run")
    found = attribute(evidence, episodes=50)
    values = [part.shapley.value for part in found.agents.values() if part.shapley is not None]
    assert found.everyone is not None
    assert found.nobody is not None
    assert sum(values) == pytest.approx(found.everyone - found.nobody)
    own = [row for row in found.influence if row["on"] == "observation" and row["p"] > 0]
    assert own


def test_attribution_is_the_same_whoever_plays(tmp_path: Path) -> None:
    """Worker processes, or another executor, give the figures that this process gives."""
    evidence = gk.rollout("two_robot_line", episodes=2, seed=3, out=tmp_path / "run")
    here, there, far = (attribute(evidence, episodes=4, workers=n) for n in (0, 2, Here(1)))
    assert here.to_json() == there.to_json() == far.to_json()


@pytest.mark.usefixtures("nothing_is_ours")
def test_attribution_of_foreign_code_asks_for_trust(tmp_path: Path) -> None:
    """Evidence from a folder doesn't run a file that it names unasked."""
    gk.rollout(
        f"{games.HERE}:make",
        policies="random",
        episodes=1,
        contract=games.SHOVING,
        out=tmp_path / "run",
    )
    with pytest.raises(TrustError, match="--allow-import"):
        attribute(tmp_path / "run")
    assert attribute(tmp_path / "run", allow_import=True, episodes=1).loop == "closed"


def test_unknown_baseline_is_refused() -> None:
    """An environment without a reference policy can't be measured against one."""
    with pytest.raises(PolicyError, match="reference"):
        _shoving(baseline="reference")


def test_document_has_what_others_read() -> None:
    """The fields of the interface stand in the JSON document, and nothing in it is no JSON."""
    found = _shoving()
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    part = data["agents"]["robot_0"]
    assert part.keys() >= {"return", "share", "idle", "difference", "shapley", "lazy"}
    assert part["difference"].keys() >= {"value", "low", "high", "baseline"}
    assert part["share"] == pytest.approx(1 / 3)
    assert "robot_0" in str(found)
    assert "<table>" in found._repr_html_()
    assert np.isfinite(part["return"])


def test_rivals_are_given_no_part_of_a_teams_return() -> None:
    """What one wins the other loses: nothing is played for a sum that says nothing."""
    evidence = gk.rollout("pettingzoo.classic.tictactoe_v3:env", episodes=9, seed=1)
    found = gk.attribute(evidence, action_episodes=1)
    assert found.rivals is not None
    assert "cancels out" in found.rivals
    assert (found.fresh, found.everyone, found.lazy, found.harmful) == (0, None, (), ())
    assert {part.own.share for part in found.agents.values()} == {None}
    assert {part.turn_all for part in found.agents.values()} == {None}
    text = attribution_text(found.to_json(), width=80)
    assert "Agents compete" in text
    assert "the sum of all agents' returns" not in text
