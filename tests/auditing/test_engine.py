"""The engine: budgets, processes that die, objects, faults of probes and checks."""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Iterator
from threading import Event
from typing import Any

import pytest

from gamekeeper import heartbeat
from gamekeeper.auditing import audit as audit_room
from gamekeeper.auditing import gather as gathering_room
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.audit_process import audit
from gamekeeper.auditing.gather import Gathering, gather, session_of
from gamekeeper.auditing.judge import WANTED, judge
from gamekeeper.auditing.probe import probes
from gamekeeper.auditing.probe_session import TimeUpError
from gamekeeper.auditing.result import AuditResult
from gamekeeper.checks import check as checks_room
from gamekeeper.checks.check import LOW, Case, Check, check, checks, selected
from gamekeeper.checks.probe_evidence import ProbeDeath, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.interface.opening import open_env
from gamekeeper.plugins import Plugins
from tests.faults.endings import SilentLeave
from tests.faults.rovers import Rovers

BROKEN = "tests.faults.endings:SilentLeave"
CLEAN = "tests.faults.rovers:Rovers"


def made(ok: bool = True, **options: Any) -> Check:
    """A check of its own that looks once."""

    @check("TEST001", LOW, "rollout", **options)
    def promise(contract: Contract, evidence: ProbeEvidence) -> Iterator[Case]:
        """Something holds.

        Fix: nothing
        """
        yield Case(Where("rollout", 0, 0, None, "x"), ok, 1, 2)

    return promise


def test_audit_of_an_object_runs_in_this_process() -> None:
    """An environment in memory is audited as it is."""
    found = audit(SilentLeave(), select=("GK501",), budget=1500)

    assert [verdict.id for verdict in found.failed] == ["GK501"]
    assert "your environment" in found.failed[0].findings[0].reproducer


def test_audit_repeats_with_its_seed() -> None:
    """Verdicts, findings and steps are the same on every run with one seed."""
    one, two = (audit_here(BROKEN, select=("GK5", "GK4"), budget=1500, seed=3) for _ in range(2))

    assert one.verdicts == two.verdicts
    assert one.steps == two.steps


def test_audit_on_a_busy_machine_gives_the_same_verdicts(monkeypatch: pytest.MonkeyPatch) -> None:
    """An hour between any two looks at the clock cuts nothing short."""
    asked: Any = {"select": ("GK5",), "budget": 600}
    quiet = audit_here(BROKEN, **asked)
    hours = itertools.count(0.0, 3600.0)
    for clock in ("time.monotonic", "gamekeeper.heartbeat.monotonic"):
        monkeypatch.setattr(clock, lambda: next(hours))
    busy = audit_here(BROKEN, **asked)

    assert (busy.verdicts, busy.steps) == (quiet.verdicts, quiet.steps)


def test_audit_document_reads_back() -> None:
    """What crosses a process as JSON comes back as it was."""
    found = audit_here(BROKEN, select=("GK501",), budget=600)

    assert AuditResult.from_json(found.to_json()).to_json() == found.to_json()
    assert "GK501 high" in str(found)


def test_audit_steps_stay_near_the_budget() -> None:
    """A budget of steps is kept, but for shrinking; two probes have half and 0.3 of it on top."""
    assert audit_here(CLEAN, budget=4000).steps < 5000 + 2000 + 1200


def test_audit_refuses_an_empty_budget() -> None:
    """Nothing can be seen without a step."""
    with pytest.raises(EvidenceError, match="no env step to play"):
        audit_here(CLEAN, budget=0)


def test_audit_refuses_an_unknown_environment() -> None:
    """The error of the process comes out as it would here."""
    with pytest.raises(SpecError, match="no_such"):
        audit("no_such_module:make")


def test_selected_refuses_what_begins_no_id() -> None:
    """A misspelt id isn't passed over."""
    with pytest.raises(EvidenceError, match="GK9999"):
        selected(("GK9999",))


def test_selected_takes_beginnings() -> None:
    """A family is named by how its ids begin, and single ones are left out."""
    assert selected(("gk5",), ("Gk501",)).keys() == selected(("GK5",), ("GK501",)).keys()
    assert set(selected(("GK5",), ("GK501",))) == {
        id for id in checks() if id.startswith("GK5") and id != "GK501"
    }


@pytest.mark.parametrize(
    ("ok", "waivers", "outcome"),
    [
        (True, {}, "passed"),
        (False, {}, "failed"),
        (False, {"TEST001": "on purpose"}, "waived"),
        (True, {"TEST001": "on purpose"}, "passed"),
    ],
)
def test_judge_minds_waivers(ok: bool, waivers: dict[str, str], outcome: str) -> None:
    """A waiver stands for a broken promise; on a kept one it is reported as needless."""
    judged = judge(made(ok), Contract(waivers=waivers), ProbeEvidence("parallel"), {})

    assert judged.outcome == outcome
    assert ("on purpose" in judged.reason) == bool(waivers)


def test_judge_tells_not_exercised_from_not_applicable() -> None:
    """No case is never green, and what isn't promised isn't judged."""

    @check("TEST002", LOW, "rollout")
    def quiet(contract: Contract, evidence: ProbeEvidence) -> Iterator[Case]:
        """Something holds.

        Fix: nothing
        """
        yield from ()

    not_exercised = judge(
        quiet, Contract(), ProbeEvidence("parallel", not_exercised={"rollout": "time"}), {}
    )
    other = judge(made(api="aec"), Contract(), ProbeEvidence("parallel"), {})
    declared = judge(made(applies=lambda *_: "undeclared"), Contract(), ProbeEvidence("aec"), {})

    assert (not_exercised.outcome, not_exercised.reason) == ("not_exercised", "time")
    assert (other.outcome, declared.outcome) == ("not_applicable", "not_applicable")
    assert declared.reason == "undeclared"


def test_judge_calls_a_failing_check_an_error() -> None:
    """A check that raises is our fault, or its author's, never the environment's."""

    @check("TEST003", LOW)
    def promise(contract: Contract, evidence: ProbeEvidence) -> Iterator[Case]:
        """Something holds.

        Fix: nothing
        """
        raise ZeroDivisionError
        yield

    judged = judge(promise, Contract(), ProbeEvidence("parallel"), {})

    assert judged.outcome == "error"
    assert "ZeroDivisionError" in judged.reason


def test_check_needs_a_promise() -> None:
    """A check without a claim and a fix, or with an id of another form, can't be made."""

    def run(contract: Contract, evidence: ProbeEvidence) -> Iterator[Case]:
        yield from ()

    with pytest.raises(EvidenceError, match="is no check"):
        check("GK001", LOW)(run)


def test_gather_goes_on_without_a_probe_in_which_the_process_died() -> None:
    """The death is a fact, and what the probe should have seen is unseen."""
    opened = open_env(Rovers)
    session = session_of(opened, None, spec=Rovers, kwargs={}, seed=0, budget=100)

    gathered = gather(
        session, ["rollout"], died={"rollout": "died: killed by SIGSEGV"}, on_probe=lambda *_: None
    ).gathered()

    assert [fact.value.text for fact in gathered.facts(ProbeDeath)] == ["died: killed by SIGSEGV"]
    assert "SIGSEGV" in gathered.not_exercised["rollout"]


def test_in_order_puts_cheap_probes_of_many_checks_first() -> None:
    """What ends the time costs the probes of few checks; where it is short, the last one moves."""
    long, short = (gathering_room.in_order(probes(), is_short=each) for each in (False, True))
    assert long[:3] == ["same_seed", "surface", "spaces"]
    assert long[-1] == "second_episode"
    assert short.index("second_episode") < short.index("unseeded") < short.index("alternated")
    assert set(long) == set(short) == set(probes())


def test_gather_gives_each_probe_one_look_however_short_its_share() -> None:
    """The first look isn't cut by the probe's share; a later one is."""
    session = session_of(open_env(Rovers), None, spec=Rovers, kwargs={}, seed=0, budget=2000)
    gathering = Gathering(session, probes(["rollout"]), share_until_s=0.0)
    gathering.looks["rollout"] = []
    with pytest.raises(TimeUpError):
        gathering_room._probe(gathering, "rollout", gathering.probes["rollout"], 2000, 1 << 24)
    assert len(gathering.looks["rollout"]) == 1


def test_gather_doesnt_take_what_the_first_play_compiles_for_its_pace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a clock on which a step takes 1 s, and the first play of all 100 s more."""
    now_s = [0.0]

    class Ticking(Rovers):
        def step(self, actions: dict[str, Any]) -> Any:
            now_s[0] += 1.0 if now_s[0] else 101.0
            return super().step(actions)

    monkeypatch.setattr(gathering_room.time, "monotonic", lambda: now_s[0])
    session = session_of(open_env(Ticking), None, spec=Ticking, kwargs={}, seed=0, budget=100)
    steps = gathering_room._steps_until(session, 10_000.0)
    assert 10_000.0 - now_s[0] <= steps  # resets count, too


def test_gather_goes_on_where_time_ends_while_it_looks_for_sharing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whether plays differ by what classes share isn't told then; what was seen is judged."""

    def late(gathering: object) -> bool:
        raise TimeUpError

    monkeypatch.setattr(gathering_room, "differs_by_itself", lambda evidence: True)
    monkeypatch.setattr(gathering_room, "_is_shared", late)
    session = session_of(open_env(Rovers), None, spec=Rovers, kwargs={}, seed=0, budget=100)
    found = gather(session, ["same_seed"], died={}, on_probe=lambda *_: None)
    assert found.looks["same_seed"]
    assert not found.is_shared


def test_audit_survives_a_process_that_is_killed(tmp_path: Any) -> None:
    """An environment that kills its process leaves the rest of the audit standing."""
    source = tmp_path / "killer.py"
    source.write_text(
        "import os, signal\n"
        "from tests.faults.rovers import Rovers\n"
        "class Killer(Rovers):\n"
        "    def step(self, actions):\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "def make():\n"
        "    return Killer()\n",
        encoding="utf-8",
    )
    found = audit(f"{source}:make", select=("GK402", "GK501"), budget=300)

    assert {verdict.outcome for verdict in found.verdicts} == {"not_exercised"}
    assert "SIGKILL" in found.verdicts[0].reason


def test_audit_finds_that_every_episode_ends_the_process(tmp_path: Any) -> None:
    """An environment in which no probe lives gets a finding with a program, and no bare error."""
    source = tmp_path / "aborter.py"
    source.write_text(
        "import os\n"
        "from tests.faults.rovers import Rovers\n"
        "class Aborter(Rovers):\n"
        "    def step(self, actions):\n"
        "        os.abort()\n"
        "def make():\n"
        "    return Aborter()\n",
        encoding="utf-8",
    )
    found = audit(f"{source}:make", budget=300)

    assert [each.id for each in found.failed] == ["GK221"]
    assert "SIGABRT in step" in found.of("GK221").findings[0].actual
    assert "aborter.py:5" in found.of("GK221").findings[0].actual
    assert not [each.id for each in found.verdicts if each.outcome == "error"]


def test_checks_refuses_two_of_one_id(monkeypatch: pytest.MonkeyPatch) -> None:
    """An id names one promise."""
    found = Plugins({"one": made(), "two": made()})
    monkeypatch.setattr(checks_room.plugins, "load", lambda *_, **__: found)
    with pytest.raises(EvidenceError, match="two checks are called TEST001"):
        checks()


def test_every_check_says_what_it_looks_at() -> None:
    """A check of ours that wasn't exercised names what would have had to be there."""
    ours = {id: each for id, each in checks().items() if id.startswith("GK")}
    said = {id for id, each in ours.items() if each.looks_at or WANTED.keys() & {*each.needs}}
    assert said == ours.keys()


def test_judging_gives_signs_of_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """Evidence of hundreds of agents is judged for minutes without an env step: that is no hang."""
    given, waited = Event(), []

    def measured(*_: Any) -> dict[str, Any]:
        waited.append(given.wait(20))
        return {}

    monkeypatch.setattr(heartbeat, "_signs", [given.set])
    monkeypatch.setattr(audit_room, "measured", measured)
    audit_here(Rovers, budget=50)

    assert waited == [True]


def test_judge_keeps_no_good_case() -> None:
    """Good cases are counted and let go: of hundreds of agents there are millions."""
    alive: list[int] = []

    class Look(Case):
        """A case that weak references can name."""

    @check("TEST004", LOW)
    def promise(contract: Contract, evidence: ProbeEvidence) -> Iterator[Case]:
        """Something holds.

        Fix: nothing
        """
        looks: list[weakref.ref[Case]] = []
        for _ in range(50):
            case = Look(Where(), True)
            looks.append(weakref.ref(case))
            yield case
            del case
        alive.append(sum(each() is not None for each in looks))

    judged = judge(promise, Contract(), ProbeEvidence("parallel"), {})
    assert (judged.outcome, judged.cases) == ("passed", 50)
    assert alive[0] <= 1
