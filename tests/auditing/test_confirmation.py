"""Findings are given out once their reproducers failed in fresh processes; causes are named."""

from __future__ import annotations

import pickle
import re
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from gamekeeper.auditing import other_process
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.class_state import ClassState
from gamekeeper.auditing.confirm import (
    FLAKY,
    NOT_RUN,
    TRIES,
    UNSTABLE,
    Confirmation,
    Programs,
    _share_until,
    _without_chance,
)
from gamekeeper.auditing.draw_holds import globals_held
from gamekeeper.auditing.holds import (
    calls_of_class,
    missing_held,
    names_held,
    observe_held,
    readings_held,
    rewards_held,
)
from gamekeeper.auditing.probe_session import ProbeSession, TimeUpError
from gamekeeper.auditing.probes import isolation
from gamekeeper.auditing.reproduce import longer_episodes
from gamekeeper.auditing.reproducer_process import FILE, raised_at
from gamekeeper.auditing.result import AuditResult
from gamekeeper.auditing.wrapper_faults import faulty_wrapper, within
from gamekeeper.checks.verdict import Finding, FollowsFrom, Reproduced, Verdict
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.warm_worker import WarmWorker
from gamekeeper.rollouts.workers import TaskOutcome
from tests.auditing.lucky_games import OnlyInTests, Tires

GAMES = "tests.auditing.lucky_games"
GLOBALS_SEEDED = "global generators kept apart for each environment"


def audited(name: str, *select: str, **options: Any) -> AuditResult:
    """The audit of one of the lucky games, in this process."""
    return audit_here(f"{GAMES}:{name}", budget=600, select=select, **options)


def test_finding_is_confirmed_in_five_fresh_processes() -> None:
    """Rare slips of a generator that nobody seeded are shown in each of them."""
    verdict = audited("Slips", "GK60").of("GK601")
    assert (verdict.outcome, verdict.follows_from) == ("failed", None)
    assert verdict.reproduced == Reproduced(TRIES, TRIES, None)


def test_step_that_masks_forbid_in_another_game_shows_no_wrong_mask() -> None:
    """No seed is read, so that the masks of the game that is played again forbid what was done."""
    verdict = audited("Jammed", "GK235").of("GK235")
    assert (verdict.outcome, verdict.findings[0].actual) == ("suspected", "RuntimeError: jammed")


def test_name_that_a_line_of_the_environment_lacks_is_shown() -> None:
    """A NameError in each step fails, where one of the program's own would show nothing."""
    verdict = audited("Nameless", "GK221").of("GK221")
    assert (verdict.outcome, verdict.reproduced) == ("failed", Reproduced(TRIES, TRIES, None))
    assert "lucky_games.py:" in verdict.findings[0].lines[0]


def test_processes_that_agree_by_chance_withdraw_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two other processes give one episode by luck, the third another: no seed determines it."""
    lucky: dict[int, list[Episode]] = {}

    def by_luck(session: ProbeSession, base: EpisodeResult, hash_seed: int) -> Episode:
        there = lucky.setdefault(hash_seed, [])
        there.append(
            there[0] if len(there) == 1 else session.play(base.play, session.env()).episode
        )
        return there[-1]

    monkeypatch.setattr(isolation, "played_elsewhere", by_luck)
    found = audited("Noise", "GK601", "GK607")
    assert (found.of("GK601").outcome, found.of("GK607").outcome) == ("failed", "passed")


def test_draws_of_a_module_as_it_is_imported_share_nothing() -> None:
    """A process's first episode differs by no draw of an import, nor does its reproducer's."""
    found = audited("imported_late", "GK602", "GK607")
    assert (found.of("GK602").outcome, found.of("GK607").outcome) == ("failed", "passed")


def test_comparison_is_confirmed_beside_an_unchanged_play() -> None:
    """State that survives a reset: a used instance differs, two fresh ones don't."""
    found = audited("Tires", "GK60")
    assert [each.id for each in found.failed] == ["GK604"]  # no seed is ignored: nothing is drawn
    assert found.of("GK604").reproduced == Reproduced(TRIES, TRIES, True)


def test_an_info_that_an_agent_lacks_as_it_joins_is_shown() -> None:
    """Nobody knows of it before, so it is no agent of the last actions."""
    verdict = audited("JoinsWithoutInfo", "GK109").of("GK109")
    assert (verdict.outcome, verdict.reproduced) == ("failed", Reproduced(TRIES, TRIES, None))


@pytest.mark.parametrize(("name", "id"), [("Vanishes", "GK501"), ("FirstIsPaid", "GK311")])
def test_agents_that_are_no_texts_are_found_by_a_program(name: str, id: str) -> None:
    """It plays with frozen dataclasses as it plays with names."""
    verdict = audited(name, id).of(id)
    assert verdict.outcome == "failed"
    assert verdict.reproduced is not None
    assert verdict.reproduced.failed == verdict.reproduced.tried == TRIES


def test_sound_agents_that_are_no_texts_are_not_accused() -> None:
    """They share the array that they see, as the program shows; nothing else is found."""
    found = audited("Numbered", "GK")
    assert {each.id for each in found.failed} == {"GK614", "GK615"}
    assert [each.id for each in found.verdicts if each.outcome == "suspected"] == []


def test_agent_that_a_program_does_not_find_shows_nothing() -> None:
    """An exception of a line of its own isn't the environment's."""
    program = "next(agent for agent in ['a'] if agent == 'b')"
    with WarmWorker(()) as worker:
        assert Confirmation([worker], lambda: None, None).failures(program) == (0, 1)


def test_fault_of_a_wrapper_is_placed_in_it() -> None:
    """The one wrapper of three without which a used instance plays like a fresh one is named."""
    (finding,) = audited("dimmed", "GK604").of("GK604").findings
    assert finding.fix.startswith("in the wrapper Dims (tests.auditing.lucky_games), without which")


def test_fault_of_wrapped_rules_is_placed_in_no_wrapper() -> None:
    """The rules alone show it."""
    verdict = audited("wrapped_tires", "GK604").of("GK604")
    assert (verdict.outcome, verdict.reproduced) == ("failed", Reproduced(TRIES, TRIES, True))
    assert "wrapper" not in verdict.findings[0].fix


def test_reference_that_pettingzoos_converter_keeps_is_placed_in_it() -> None:
    """It holds the actions of a round until its last agent acts; the rules copy theirs."""
    (finding,) = audited("converted", "GK631").of("GK631").findings
    assert finding.fix.startswith("in the wrapper parallel_to_aec_wrapper (pettingzoo.")


def test_wrapper_is_told_by_the_episode_as_played_where_rules_refuse_the_shortest() -> None:
    """A program that raises within the wrapper, as its actions were made up, tells nothing."""
    wrappers = ("Outer (a)", "Inner (b)")
    short, whole = (f"def make():\n    return {each}\n" for each in ("short", "whole"))
    passing = {within(whole, wrappers, depth) for depth in (1, 2)}
    assert faulty_wrapper((short, whole), wrappers, passing.__contains__) == "Outer (a)"
    assert faulty_wrapper((short,), wrappers, passing.__contains__) is None
    assert faulty_wrapper((whole,), (), passing.__contains__) is None


def test_state_that_adds_up_over_episodes_is_found() -> None:
    """One episode before the episode isn't enough to see it."""
    found = audited("AddsUp", "GK604")
    assert [each.id for each in found.failed] == ["GK604"]
    program = found.of("GK604").findings[0].reproducer
    assert re.search(r"for _ in range\([2-9]\):\n    (play\(used\)|used.reset\()", program)


def test_consequence_names_the_cause_that_was_held_still() -> None:
    """A seed that settles nothing follows from draws of a global generator."""
    found = audited("Unseeded", "GK60")
    assert found.of("GK602").follows_from is None
    assert found.of("GK601").follows_from == FollowsFrom("GK602", GLOBALS_SEEDED)
    assert not found.ok


def test_an_attribute_called_last_makes_no_aec_environment_of_one() -> None:
    """A program plays by the calls of its API, whatever names stand in the environment."""
    found = audited("AddsToItsOriginal", "GK70")
    assert [each.id for each in found.failed] == ["GK701", "GK702"]
    follows = found.of("GK702").follows_from
    assert follows is not None
    assert follows.id == "GK701"


def test_a_roster_that_keeps_the_dead_is_one_cause() -> None:
    """Agents that have left lack no entries, though a wrapper's list still has them."""
    found = audited("with_own_roster", "GK1", "GK3", "GK5")
    assert [each.id for each in found.failed if each.follows_from is None] == ["GK303"]


def test_what_the_first_play_leaves_to_all_instances_is_shared_state() -> None:
    """Plays of this process are alike; those of new processes are too, but for the first one."""
    found = audited("Remembers", "GK607", "GK608")
    assert [each.id for each in found.failed] == ["GK607"]


def test_consequence_of_several_causes_passes_once_all_are_held_still() -> None:
    """Neither generator alone makes a used instance play like a fresh one."""
    found = audited("Drifts", "GK601", "GK602", "GK604")
    assert {each.id for each in found.failed if each.follows_from is None} == {"GK601", "GK602"}
    follows = found.of("GK604").follows_from
    assert follows is not None
    assert follows.held_still.startswith(f"{GLOBALS_SEEDED}, and ")


@pytest.mark.parametrize(("name", "cause"), [("Lingers", "GK503"), ("PaidWhenGone", None)])
def test_pay_after_the_end_follows_where_it_stops_once_the_ended_are_out(
    name: str, cause: str | None
) -> None:
    """Who is paid by a roster that isn't `agents` is paid on: another cause."""
    found = audited(name, "GK402", "GK503")
    follows = found.of("GK402").follows_from
    assert {each.id for each in found.failed} == {"GK402", "GK503"}
    assert cause == (None if follows is None else follows.id)


@pytest.mark.parametrize(("name", "cause"), [("Sinks", "GK503"), ("SinksAsItEnds", None)])
def test_observation_of_an_agent_that_is_gone_with_the_cause_follows(
    name: str, cause: str | None
) -> None:
    """It isn't there to be seen once the ended are out: in the step that ends it, it is."""
    found = audited(name, "GK214", "GK503")
    follows = found.of("GK214").follows_from
    assert {each.id for each in found.failed} == {"GK214", "GK503"}
    assert cause == (None if follows is None else follows.id)


def test_faults_of_a_step_that_nothing_happens_in_follow_from_agents_that_stay() -> None:
    """One line makes all of it: agents wait, take actions and are paid, as none is removed."""
    select = "GK303", "GK304", "GK407", "GK522"
    found = audit_here("tests.auditing.roster_games:Stops", select=select, budget=600)
    causes = {each.id: each.follows_from and each.follows_from.id for each in found.failed}
    assert causes == {"GK303": None, "GK304": "GK303", "GK407": "GK303", "GK522": "GK303"}


def test_observation_that_hands_out_an_info_shares_what_infos_share() -> None:
    """One array is told once, where infos of their own leave each observation its own."""
    found = audit_here("tests.auditing.roster_games:OneMask", select=("GK61",), budget=600)
    causes = {each.id: each.follows_from and each.follows_from.id for each in found.failed}
    assert causes == {"GK614": "GK615", "GK615": None}


def test_action_that_a_shared_mask_allows_follows_from_the_sharing() -> None:
    """Each mask is right as it is written, and all are the last one: copies are obeyed."""
    select = "GK235", "GK615"
    found = audit_here("tests.auditing.roster_games:OneBuffer", select=select, budget=600)
    causes = {each.id: each.follows_from and each.follows_from.id for each in found.failed}
    assert causes == {"GK235": "GK615", "GK615": None}


@pytest.mark.parametrize("select", [("GK6",), ("GK620",)], ids=str)
def test_second_fault_is_shown_with_the_first_held_still(select: tuple[str, ...]) -> None:
    """Writing into an observation moves the game, whatever the process draws."""
    verdict = audited("Written", *select).of("GK620")
    assert (verdict.outcome, verdict.follows_from) == ("failed", None)
    assert verdict.reproduced == Reproduced(TRIES, TRIES, True)
    assert "make = draws_seeded(make)\n" in verdict.findings[0].reproducer


def test_game_that_a_seed_does_not_settle_is_not_measured_as_deterministic() -> None:
    """The generators of the process are another's elsewhere."""
    assert audited("Unseeded").measured["deterministic"] is False
    assert audited("Sound").measured["deterministic"] is True


def test_fault_of_a_lucky_draw_is_shown_by_drawing_the_same_again() -> None:
    """An observation leaves its space by a draw of the process: each reset begins as it did."""
    verdict = audited("Leaps", "GK214").of("GK214")
    assert (verdict.outcome, verdict.follows_from) == ("failed", None)
    assert "make = draws_seeded(make)\n" in verdict.findings[0].reproducer


def test_fault_of_a_used_instance_is_shown_by_resets_before() -> None:
    """A roster that is lent out from the second episode on; what follows is another's fault."""
    found = audited("LentRoster", "GK102", "GK606")
    verdict = found.of("GK102")
    assert (verdict.outcome, verdict.follows_from) == ("failed", None)
    assert "make = reset_before(" in verdict.findings[0].reproducer
    assert [each.id for each in found.verdicts if each.outcome == "suspected"] == []


def test_finding_that_no_fresh_process_shows_is_suspected() -> None:
    """An observation leaves its space in this process alone: nothing failed, nothing passed."""
    found = audited("OnlyInTests", "GK214")
    verdict = found.of("GK214")
    assert verdict.outcome == "suspected"
    assert verdict.reproduced is not None
    assert verdict.reproduced.failed < verdict.reproduced.tried
    assert found.ok


@pytest.mark.parametrize(
    ("cause", "seeded", "compares", "reason", "outcome"),
    [
        ("GK601", "failed", True, FLAKY, "not_exercised"),
        ("GK601", "failed", False, FLAKY, "suspected"),
        ("GK601", "failed", True, NOT_RUN, "suspected"),
        ("GK601", "passed", True, FLAKY, "suspected"),
        ("GK607", "failed", True, UNSTABLE, "not_exercised"),
        ("GK607", "failed", True, FLAKY, "suspected"),
        ("GK607", "passed", True, UNSTABLE, "suspected"),
    ],
)
def test_chance_suspects_no_comparison_where_an_episode_differs_by_itself(
    cause: str, seeded: Any, compares: bool, reason: str, outcome: str
) -> None:
    """What isn't shown of two episodes that differ by themselves was no comparison."""
    programs = [Programs(Finding("", "", "", "", ""), ("",), compares=compares, unchanged="")]
    doubted = Verdict("GK634", "a claim", "suspected", "high", reason=reason)
    found = {cause: Verdict(cause, "", seeded, "high"), "GK634": doubted}
    assert _without_chance(found, [(doubted, programs)])["GK634"].outcome == outcome


def test_object_has_findings_without_reproduction() -> None:
    """No other process can build what was handed over as an object."""
    verdict = audit_here(Tires(), budget=400, select=("GK214",)).of("GK214")
    assert (verdict.outcome, verdict.reproduced) == ("passed", None)
    verdict = audit_here(OnlyInTests(), budget=400, select=("GK214",)).of("GK214")
    assert (verdict.outcome, verdict.reproduced) == ("failed", None)


def test_first_of_several_takes_half_of_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a slow reproducer leaves is for those after it."""
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    assert _share_until(None, 3) is None
    assert _share_until(110.0, 4) == 105.0
    assert _share_until(110.0, 1) == 110.0


@pytest.mark.parametrize("left_s", [-1.0, 0.5])
def test_program_that_the_time_cuts_off_shows_nothing(left_s: float) -> None:
    """A process that is ended as the audit's time is over is no failure of its environment."""
    with WarmWorker(()) as worker:
        work = Confirmation([worker], lambda: None, time.monotonic() + left_s)
        with pytest.raises(TimeUpError):
            work.failures("import time; time.sleep(600)")


def test_class_state_is_put_back() -> None:
    """A list of the class and a default argument are as they were, also through a wrapper."""

    class Shelf:
        goods: ClassVar = [1]

        def put(self, seen: list[int] = []) -> int:  # noqa: B006  # what is looked at
            seen.append(1)
            self.goods.append(len(seen))
            return len(seen)

    class Wrapped:
        def __init__(self) -> None:
            self.env = Shelf()

    wrapped = Wrapped()
    state = ClassState(wrapped)
    assert [wrapped.env.put(), wrapped.env.put(), Shelf.goods] == [1, 2, [1, 1, 2]]
    state.restore()
    assert [list(Shelf.goods), wrapped.env.put()] == [[1], 1]


def test_hash_seeds_turn_every_two_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """A seed that turns too few of what is left is passed over."""
    turned = {1: set(), 2: {"ab", "ac"}, 3: {"ab"}, 4: {"bc"}}

    def orders(pairs: list[tuple[str, str]], seed: int) -> list[list[str]]:
        here = [[*set(pair)] for pair in pairs]
        return [
            o[::-1] if "".join(p) in turned[seed] else o for p, o in zip(pairs, here, strict=True)
        ]

    monkeypatch.setattr(other_process, "_orders", orders)
    assert other_process.hash_seeds.__wrapped__(("a", "b", "c")) == (2, 4)


def test_calls_that_an_instance_keeps_are_held_too() -> None:
    """A wrapper that takes its inner environment's `reset` for its own attribute."""

    class Wrapper:
        def __init__(self) -> None:
            self.reset = np.random.random

    make = globals_held(calls_of_class(Wrapper))
    assert make().reset() == make().reset()


def test_instances_whose_generators_are_held_are_copied_by_pickle() -> None:
    """Of two instances neither takes the other's class away."""
    make = globals_held(Uncleared)
    for env in [make(), make()]:
        assert pickle.loads(pickle.dumps(env)).rewards == {"a": 0}


class Uncleared:
    """Pays 1 more in every step, and counts the calls of observe()."""

    def __init__(self) -> None:
        self.rewards, self.calls = {"a": 0}, 0

    def step(self, action: Any) -> None:
        self.rewards["a"] += 1

    def observe(self, agent: str = "a") -> int:
        self.calls += 1
        return self.calls

    state = render = observe

    def reset(self) -> None:
        self.agents = self.possible_agents = ["a", "b", "a"]


def test_rewards_names_and_readings_are_held_still() -> None:
    """Rewards are of their step alone, names stand once, and no reading is seen by the next."""
    env = names_held(readings_held(rewards_held(observe_held(Uncleared))))()
    env.reset()
    assert env.agents == env.possible_agents == ["a", "b"]
    assert [env.step(0) or env.rewards["a"] for _ in range(3)] == [1, 1, 1]
    assert [env.observe("a"), env.observe("a"), env.state(), env.render(), env.calls] == [
        *(1, 1, 1, 1),
        0,
    ]


def test_agents_in_the_game_are_given_the_entries_that_they_lack() -> None:
    """A Parallel step without a reward, an AEC environment without cumulative rewards."""

    class Silent(Uncleared):
        def step(self, action: Any) -> Any:
            return {}, {"a": 2.0}, {}, {}, {}

    class Turns(Uncleared):
        agent_iter = None
        unwrapped = property(lambda self: self)

    env = missing_held(Silent)()
    env.reset()
    assert env.step({})[1] == {"a": 2.0, "b": 0.0}
    aec = missing_held(Turns)()
    aec.reset()
    aec._cumulative_rewards["a"] = 1.0
    aec.reset()  # which doesn't set them either
    assert aec._cumulative_rewards == {"a": 0.0, "b": 0.0}


def test_a_finding_tells_the_exception_that_its_program_shows() -> None:
    """A program that ends in another exception than the audit saw has the last word."""

    class Worker(WarmWorker):
        def start(self) -> None:
            """Needs no process."""

        def run(self, *args: Any, **named: Any) -> TaskOutcome:
            """The end of a program that asserts that nothing was raised."""
            value = {"raised": "AssertionError", "text": "list", "at": "", "told": "IndexError: x"}
            return TaskOutcome("done", value, None, None, 0.0)

    def told(actual: str) -> tuple[str, str]:
        finding = Finding("here", "a step", actual, "", f"# actual: {actual}\n")
        work = Confirmation([Worker(())], lambda: None, None)
        found, _, is_shown = work.finding(Programs(finding, (), compares=False, unchanged=""))
        assert is_shown
        return found.actual, found.reproducer

    assert told("ValueError: dead") == ("IndexError: x", "# actual: IndexError: x\n")
    assert told("IndexError: y")[0] == "IndexError: y"
    assert told("NaN at [14]")[0] == "NaN at [14]"


@pytest.mark.parametrize(
    ("program", "shows"),
    [
        ("raise AssertionError('NaN')", (True, True)),
        ("{}['agent_1']", (True, True)),
        ("from gymnasium import spaces; spaces.Discrete(2).sample([True])", (True, True)),
        ("import json; json.loads('{')", (False, True)),
        ("import gone", (False, False)),
        ("def reset(): ...\nreset(seed=1)", (False, True)),
    ],
)
def test_an_exception_of_the_environment_shows_an_exception_alone(
    program: str, shows: tuple[bool, bool]
) -> None:
    """A value isn't shown by a play that is over before; what the program asks for is."""
    with WarmWorker(()) as worker:
        work = Confirmation([worker], lambda: None, None)
        for actual, is_shown in zip(("NaN at [14]", "KeyError: 'agent_1'"), shows, strict=True):
            finding = Finding("here", "a number", actual, "", program)
            found = work.finding(Programs(finding, (program,), compares=False, unchanged=""))
            assert found[2] is is_shown


@pytest.mark.parametrize("kind", ["SystemExit", "Collision"])
def test_exception_of_any_name_is_shown_with_its_line(kind: str, tmp_path: Path) -> None:
    """Its name needs no Error at its end, and the path of its file may have spaces."""
    file = tmp_path / "a folder" / "collisions.py"
    file.parent.mkdir()
    file.write_text(f"class Collision(Exception): ...\ndef step():\n    raise {kind}('wall')\n")
    program = f"import sys; sys.path.insert(0, {str(file.parent)!r})\nimport collisions\n"
    program += "collisions.step()\n"
    with WarmWorker(()) as worker:
        work = Confirmation([worker], lambda: None, None)
        for actual, shown in ((f"step raises {kind}: wall", True), ("NaN at [14]", False)):
            finding = Finding("here", "a step", actual, "", program)
            found = work.finding(Programs(finding, (program,), compares=False, unchanged=""))
            assert found[2] is shown
            assert found[0].lines == ((f"{file}:3",) if shown else ())


def test_program_that_a_loaded_module_stops_runs_without_it() -> None:
    """Some modules are to be loaded after a choice that the environment makes as it is imported."""
    program = "import sys\nif 'colorsys' in sys.modules: raise ImportError\nassert False, 'shown'"
    finding = Finding("here", "a number", "another", "", program)
    with WarmWorker(("colorsys",)) as worker:
        work = Confirmation([worker], lambda: None, None)
        found = work.finding(Programs(finding, (program,), compares=False, unchanged=""))
    assert found[2]


@pytest.mark.parametrize(
    ("line", "file"), [("np.testing.assert_equal(1, 2)", ""), ("json.loads('{')", "decoder.py")]
)
def test_a_comparison_by_numpy_is_the_programs_own(line: str, file: str) -> None:
    """The place that a finding names is where the environment raised, not NumPy's comparison."""
    with pytest.raises((AssertionError, ValueError)) as caught:
        exec(compile(f"import json\nimport numpy as np\n{line}", FILE, "exec"), {})
    inner = caught.value.with_traceback(caught.tb.tb_next)  # from the program on
    assert raised_at(inner).partition(":")[0].endswith(file)
    assert bool(raised_at(inner)) == bool(file)


def test_program_that_passes_by_chance_gives_way_to_one_of_four_times_its_turns() -> None:
    """A fault that one turn shows now and then is shown by a few, and needn't take all."""
    played = EpisodePlan(actions=[{"a": 0}] * 23)
    shortest = EpisodePlan(actions=[{"a": 0}])
    found = [len(each.actions or ()) for each in longer_episodes(shortest, played)]
    assert found == [4, 16, 23]
