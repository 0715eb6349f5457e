"""Seeds: faults beside the planted ones, and habits that are none."""

from __future__ import annotations

import random
from pathlib import Path
from textwrap import dedent, indent
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.audit_process import audit
from gamekeeper.auditing.gather import gather, session_of
from gamekeeper.auditing.measured_form import measured
from gamekeeper.auditing.probe import probes
from gamekeeper.auditing.probes import isolation
from gamekeeper.auditing.result import AuditResult
from gamekeeper.checks.seeds.seed_effects import p_all_alike
from gamekeeper.contract import Contract
from gamekeeper.interface.opening import open_env
from gamekeeper.rollouts.process_randomness import states
from tests.faults.rovers import MOVES, SIZE, Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders

IDS = tuple(f"GK60{i}" for i in range(10))
HERE = tuple(f"GK60{i}" for i in (0, 2, 3, 4, 5, 6, 9))
"""Those that need no other process."""


def audited(spec: object, select: tuple[str, ...] = HERE, **options: Any) -> AuditResult:
    """An audit that is short."""
    found = audit_here(spec, select=select, budget=options.pop("budget", 800), **options)
    assert [each.reason for each in found.verdicts if each.outcome == "error"] == []
    return found


def broken(spec: object, select: tuple[str, ...] = IDS, **options: Any) -> list[str]:
    """The promises that it breaks, but what follows from another."""
    failed = audited(spec, select, **options).failed
    return sorted(each.id for each in failed if each.follows_from is None)


class FirstSeedOnly(Rovers):
    """Later seeds are ignored."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Hands the seed on once."""
        return super().reset(seed if self.rng is None else None, options)


class SameSeedStays(Rovers):
    """Seeds anew only where the seed is another one than before."""

    last: int | None = None

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Takes the last seed for seeded already."""
        new, self.last = (None if seed == self.last else seed), seed
        return super().reset(new, options)


class WearsOut(Rovers):
    """Its fifth episode and those after it begin elsewhere."""

    resets = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Counts itself."""
        self.resets += 1
        return super().reset(None if seed is None else seed + (self.resets > 4), options)


class NobodyLeft(Rovers):
    """A reset deals to those whom the last episode has left, and raises where there is nobody."""

    has_begun = False

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Raises after an episode that went to its end."""
        if self.has_begun and not self.agents:
            raise KeyError(1)
        self.has_begun = True
        return super().reset(seed, options)


class OpensForGood(Rovers):
    """What the episode of one seed opened stays open."""

    opened = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Reads, and notes."""
        found = super().reset(None if seed is None else seed + self.opened, options)
        self.opened += seed == 1
        return found


class LuckyRovers(Rovers):
    """Samples are found elsewhere by the module random."""

    def drive(self, agent: str, action: int) -> None:
        """Luck."""
        super().drive(agent, action)
        self.battery[agent] -= random.randrange(2)


class LuckyAtTimes(Rovers):
    """Seeds the module random, and draws from it in the episodes of odd seeds."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds it for everybody."""
        random.seed(seed)
        self.is_lucky = bool(seed and seed % 2)
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Luck, or none."""
        super().drive(agent, action)
        self.battery[agent] -= random.randrange(2) if self.is_lucky else 0


class SeedsInConstructor(Rovers):
    """Seeds numpy for everybody, once."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        np.random.seed(3)


class SmallSeeds(Traders):
    """Refuses what doesn't fit into 16 bits."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Looks at the seed first."""
        if seed is not None and seed >= 2**16:
            raise OverflowError("no such seed")
        super().reset(seed, options)


class EmptyOptions(Rovers):
    """Options, even empty ones, go before the seed."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Takes a layout of its own."""
        return super().reset(seed if options is None else 99, options)


class ConstantReset(Rovers):
    """Plays one and the same episode, whatever is asked, though wind and samples are drawn."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts over."""
        return super().reset(5, options)


class ConstantDice(ConstantReset):
    """So does this one, by Python's generator; the one that the seed begins is never drawn from."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds a generator for the looks of it."""
        self.np_random = np.random.default_rng(seed)
        self.dice = random.Random(11)
        return super().reset(None, options)

    def drive(self, agent: str, action: int) -> None:
        """Skids now and then."""
        super().drive(agent, self.dice.choice((0, action)))


class Charted(ConstantReset):
    """Nothing is random: a constant draws the map, and no wind blows; a lamp flickers unseen."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places everything as ever."""
        self.flicker = random.Random(3)
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Where it is told to."""
        self.flicker.random()
        self.cells[agent] = (self.cells[agent] + MOVES[action]) % SIZE
        self.battery[agent] -= 1

    def reward(self, agent: str) -> float:
        """1 for a sample, which stays."""
        return float(np.array_equal(self.cells[agent], self.samples[agent]))


class NumberedRovers(Rovers):
    """Agents are numbers."""

    def __init__(self) -> None:
        super().__init__(count=2)
        self.possible_agents: list[Any] = [10, 20]
        self._seen: dict[Any, Any] = dict(zip((10, 20), self._seen.values(), strict=True))
        self._done: dict[Any, Any] = {a: spaces.Discrete(5) for a in (10, 20)}


class Stopwatch(Rovers):
    """Infos carry something that differs from run to run."""

    def info(self, agent: str) -> dict[str, Any]:
        """Entropy in place of a clock."""
        return {"wall_s": float(np.random.default_rng().random())}


@pytest.mark.parametrize(
    ("make", "ids"),
    [
        (FirstSeedOnly, ["GK606"]),
        (SameSeedStays, ["GK604"]),
        (LuckyRovers, ["GK602"]),
        (LuckyAtTimes, ["GK602"]),
        (SeedsInConstructor, ["GK603"]),
        (SmallSeeds, ["GK605"]),
        (EmptyOptions, ["GK601"]),
        (ConstantReset, ["GK600"]),
        (ConstantDice, ["GK600"]),
        (NobodyLeft, ["GK604"]),
    ],
)
def test_seeds_faults_are_found_under_their_own_name(make: Any, ids: list[str]) -> None:
    """Every fault breaks the one promise that names it."""
    assert ids == broken(make)


def test_seeds_draw_of_a_constructor_is_shown_without_an_episode() -> None:
    """An environment whose reset or step raises doesn't keep its program from showing it."""
    (finding,) = audited(SeedsInConstructor, ("GK603",)).of("GK603").findings
    assert finding.actual.endswith("in make")
    assert "reset(" not in finding.reproducer
    assert "assert seen == expected" in finding.reproducer


@pytest.mark.parametrize("make", [Rovers, Traders, Tokens, NumberedRovers, Charted])
def test_seeds_sound_environments_break_nothing(make: Any) -> None:
    """Either API, deaths, masks, agents that are no text, games without randomness."""
    assert broken(make) == []


def test_seeds_one_agent_is_enough() -> None:
    """A game of one is looked at as well."""
    found = audited(lambda: Rovers(count=1))

    assert {"passed"} == {each.outcome for each in found.verdicts}


def test_seeds_game_without_randomness_has_no_seeds_to_obey() -> None:
    """Where nothing is drawn, equal plays are no fault."""
    found = audited(Charted, ("GK600", "GK609"))

    assert [each.outcome for each in found.verdicts] == ["not_applicable"] * 2


def test_seeds_object_is_looked_at_in_its_one_instance() -> None:
    """Of an object the same seed is played twice in a row; what needs another is unseen."""
    found = audited(FirstSeedOnly(), ("GK601", "GK607", "GK608"))

    assert [each.outcome for each in found.verdicts] == ["failed", "not_exercised", "not_exercised"]
    assert "named by text" in found.of("GK608").reason


def test_seeds_sound_object_breaks_nothing() -> None:
    """One instance that plays again and again is no fault."""
    assert broken(Rovers()) == []


def test_seeds_declared_as_undetermined_arent_judged() -> None:
    """Who says that a seed determines nothing is believed; what is global is left alone even so."""
    contract = Contract.from_json({"seeds": {"deterministic": False}})
    found = audited(LuckyRovers, contract=contract)

    assert {
        each.id: each.outcome for each in found.verdicts if each.outcome != "not_applicable"
    } == {"GK603": "failed"}


def test_seeds_volatile_infos_are_passed_over() -> None:
    """An info that is declared volatile may differ; undeclared, it is a fault."""
    contract = Contract.from_json({"infos": {"wall_s": {"volatile": True}}})

    assert broken(Stopwatch, ("GK601", "GK604", "GK605"), contract=contract) == []
    assert broken(Stopwatch, ("GK601", "GK604", "GK605")) == ["GK601"]
    found = audited(Stopwatch, ("GK601",)).of("GK601")
    assert found.severity == "low"
    assert "[infos] NAME = { volatile = true }" in found.findings[0].fix


def test_seeds_audit_leaves_global_generators_as_they_were() -> None:
    """Whoever runs an audit goes on drawing as if nothing had happened."""
    before = states()
    audited(LuckyRovers, ("GK602", "GK605"))

    assert before == states()


@pytest.mark.parametrize(
    "method",
    [
        """
        def drive(self, agent, action, seen=[]):
            seen.append(agent)
            super().drive(agent, action)
            self.battery[agent] -= len(seen) % 7 == 0
        """,
        """
        def reset(self, seed=None, options=None, seen=[]):
            seen.append(seed)
            super().reset(seed, options)
            self.battery["rover_0"] -= len(seen) % 2
            return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}
        """,
    ],
    ids=["counts_moves", "counts_every_other_reset"],
)
def test_seeds_state_of_the_class_is_told_as_shared(tmp_path: Path, method: str) -> None:
    """An instance that plays otherwise because another was there before shares something."""
    lines = ["from tests.faults.rovers import Rovers", "class Counted(Rovers):"]
    tmp_path.joinpath("counted.py").write_text(
        "\n".join([*lines, indent(dedent(method), "    "), "def make():", "    return Counted()"])
    )
    found = audited(f"{tmp_path / 'counted.py'}:make", ("GK601", "GK607", "GK608"), budget=200)

    assert {each.id: each.outcome for each in found.verdicts} == {
        "GK601": "not_exercised",
        "GK607": "failed",
        "GK608": "not_exercised",
    }


def test_seeds_verdicts_repeat_in_other_processes(tmp_path: Path) -> None:
    """The order of a set is found, whatever hash seed the audit itself runs under."""
    tmp_path.joinpath("shuffled.py").write_text(
        dedent(
            """
            from tests.faults.traders import Traders

            class Shuffled(Traders):
                def open_round(self):
                    super().open_round()
                    if self.queue:
                        self.queue = list(set(self.queue))
                        self.agent_selection = self.queue[0]

            def make():
                return Shuffled(count=2)
            """
        )
    )
    found = audit(f"{tmp_path / 'shuffled.py'}:make", select=("GK608",), budget=60)

    assert found.of("GK608").outcome == "failed"


def test_p_all_alike_falls_with_every_further_play() -> None:
    """Sixteen equal plays beside sixteen different ones are no accident; four are no proof."""
    different = [str(k) for k in range(16)]

    assert p_all_alike(different, 16) < 1e-7
    assert p_all_alike(["a"] * 12 + ["b"] * 4, 16) > 1e-3
    assert p_all_alike(different[:4], 4) > 1e-3


def test_replay_is_not_blamed_for_the_generators_of_the_process() -> None:
    """A game that draws from NumPy's own generator breaks that promise alone."""
    audit = audit_here("tests.faults.seeds:GlobalGenerator", select=("GK602", "GK901"))
    assert {each.id: each.outcome for each in audit.verdicts} == {
        "GK602": "failed",
        "GK901": "passed",
    }


def test_state_that_shows_after_many_resets_is_found() -> None:
    """Resets without a step wear an instance out, and the program shows it in as many."""
    found = audited(WearsOut, ("GK604",))
    (finding,) = (each for verdict in found.failed for each in verdict.findings[:1])
    assert "for _ in range(6):\n    used.reset(seed=" in finding.reproducer


def test_state_that_a_rare_episode_leaves_is_found() -> None:
    """An episode that another probe saw differ in a used instance is the first to be tried."""
    session = session_of(
        open_env(OpensForGood), None, spec=OpensForGood, kwargs={}, seed=0, budget=60
    )
    gather(session, {"form"}, died={}, on_probe=lambda *_: None)
    (plan,) = session.unlike
    assert plan.seed == 1
    assert next(iter(probes({"second_episode"})["second_episode"].plays(session))) is plan


class PaidTheNextTick(Rovers):
    """A sample is paid at the tick after it was found, by a list that no reset clears."""

    def __init__(self) -> None:
        super().__init__(horizon=30)
        self.owed: list[tuple[int, str]] = []

    def reward(self, agent: str) -> float:
        """Pays what is due at this tick, and only then."""
        if super().reward(agent):
            self.owed.append((self.time + 1, agent))
        due = (self.time, agent)
        found, self.owed = self.owed.count(due), [each for each in self.owed if each != due]
        return float(found)


def test_what_was_owed_before_the_largest_reward_is_looked_for_after_a_reset() -> None:
    """Few cuts of an episode leave a debt; one before a payment does."""
    assert broken(PaidTheNextTick, ("GK604",)) == ["GK604"]


def test_sets_are_turned_in_six_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two are played under all hash seeds that are needed, four more under one of them each."""
    asked: dict[int, list[int]] = {}

    def there(session: Any, base: Any, hash_seed: int) -> Any:
        asked.setdefault(base.play.stream, []).append(hash_seed)
        return base.episode

    monkeypatch.setattr(isolation, "played_elsewhere", there)
    monkeypatch.setattr(isolation, "hash_seeds", lambda names: (4, 7))
    session = session_of(open_env(Rovers), None, spec="rovers", kwargs={}, seed=0, budget=2_000)
    found = gather(session, {"other_process"}, died={}, on_probe=lambda *_: None).gathered()
    assert list(asked.values()) == [[4, 7], [4, 7], [4], [7], [4], [7]]
    assert measured(Contract(), found)["deterministic"] is True


def test_actions_that_are_objects_are_not_told_to_other_processes() -> None:
    """No process can be given what only this one has, so none is said to play another episode."""
    found = audit_here("tests.faults.names:OrdersAreObjects", budget=1_000, select=("GK608",))
    assert found.of("GK608").outcome == "not_exercised"
