"""Life cycle: before a reset, after the end, resets at any time, closing."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from tests.auditing.roster_games import Counting, Turning
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


def audited(spec: object, *, budget: int = 200) -> AuditResult:
    """The audit of a small game, by the checks of life cycles."""
    found = audit_here(spec, select=("GK52",), budget=budget)
    assert [v.reason for v in found.verdicts if v.outcome == "error"] == []
    return found


def broken(spec: object, **options: Any) -> set[str]:
    """The ids of the checks that are broken."""
    return {verdict.id for verdict in audited(spec, **options).failed}


@pytest.mark.parametrize("game", [Counting, Turning])
@pytest.mark.parametrize("ids", [("a", "b", "c"), (0, 1, 2), (("red", 0), 1, "b")], ids=str)
def test_agents_may_be_called_anything(game: Any, ids: Any) -> None:
    """Numbers and tuples name agents as well as texts do."""
    assert broken(lambda: game(ids)) == set()


class Watched(Counting):
    """Counts how often it is closed."""

    closed = 0

    def close(self) -> None:
        """Takes note."""
        self.closed += 1


def test_an_object_is_never_closed() -> None:
    """Who hands over an object keeps it: what needs another instance is unseen."""
    env = Watched()
    found = audited(env)
    assert found.of("GK525").outcome == found.of("GK521").outcome == "not_exercised"
    assert found.of("GK520").outcome == "passed"
    assert env.closed == 0


class Leaves(Counting):
    """Ends the program when it is closed, as some that draw with pygame do."""

    def close(self) -> None:
        """Leaves."""
        raise SystemExit


def test_an_audit_outlives_a_close_that_ends_the_program() -> None:
    """What was seen is given out, and the close itself is judged."""
    found = audited(Leaves)
    assert found.of("GK525").outcome == "failed"
    assert found.of("GK520").outcome == "passed"


class Refuses(Rovers):
    """Refuses steps after the end, with an error of its own."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Raises where there is nobody."""
        if not self.agents:
            raise KeyError("nobody is here")
        return super().step(actions)


class Silent(Traders):
    """Says nothing to steps after the end, and does nothing."""

    def step(self, action: Any) -> None:
        """Nothing, where there is nobody."""
        if self.agents:
            super().step(action)


class StillSeen(Refuses):
    """Observations are of all rovers, also after the end."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Nothing but observations."""
        if not self.agents:
            return {a: self.observation(a) for a in self.possible_agents}, {}, {}, {}, {}
        return super().step(actions)


@pytest.mark.parametrize("game", [Refuses, Silent, StillSeen])
def test_steps_after_the_end_may_raise_or_do_nothing(game: Any) -> None:
    """Any exception is fine, and so is silence, or what no learner learns from."""
    assert audited(game).of("GK520").outcome == "passed"


class Revives(Turning):
    """A step after the end begins another round."""

    def step(self, action: Any) -> None:
        """Resets itself."""
        if not self.agents:
            self.reset()
        super().step(action)


def test_a_turn_after_the_end_is_found() -> None:
    """An AEC environment that goes on by itself is told so."""
    assert "GK520" in broken(Revives)


class ThrowsAway(Rovers):
    """Can't be reset while an episode is on."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Raises in mid-episode."""
        if self.agents:
            raise RuntimeError("the episode isn't over")
        return super().reset(seed, options)


class Empty(Rovers):
    """After its first episode nobody comes back."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The roster of the second episode is empty."""
        is_first = self.rng is None
        out = super().reset(seed, options)
        self.agents = self.agents if is_first else []
        return out


@pytest.mark.parametrize("game", [ThrowsAway, Empty])
def test_resets_begin_anew_at_any_time(game: Any) -> None:
    """A reset that raises in mid-episode, or leaves nobody, is found."""
    assert "GK523" in broken(game)


def test_equal_starts_are_no_ignored_reset() -> None:
    """A game that shows the same at every turn may well have been reset."""

    class Blind(Counting):
        def step(self, actions: Any) -> Any:
            _, *rest = super().step(actions)
            return dict.fromkeys(rest[0], 0), *rest

    assert audited(Blind).of("GK523").outcome == "passed"


class NeedsSeed(Rovers):
    """Its seed has no default."""

    def reset(self, seed: int | None, options: Any = None) -> Any:  # type: ignore[override]  # the fault
        """Must be told."""
        return super().reset(seed, options)


def test_a_reset_needs_no_argument() -> None:
    """A seed that has to be given is found, with the call that shows it."""
    verdict = audited(NeedsSeed).of("GK524")
    assert verdict.outcome == "failed"
    assert "reset()" in verdict.findings[0].reproducer


class TakesNoSeed(Rovers):
    """Its reset takes no argument at all."""

    def reset(self) -> Any:  # type: ignore[override]  # the fault
        """Begins always the same."""
        return super().reset(1)


def test_a_reset_that_takes_no_seed_is_one_finding() -> None:
    """What tells the signature says how to fix it; that no episode begins so isn't told again."""
    audit = audited(TakesNoSeed)
    refused = audit.of("GK524")
    assert (refused.outcome, refused.severity) == ("failed", "high")
    assert "unexpected keyword argument 'seed'" in refused.findings[0].actual
    assert audit.of("GK523").outcome != "failed"


@pytest.mark.parametrize(
    ("kind", "outcome"), [(TypeError, "failed"), (KeyError, "passed"), (ValueError, "passed")]
)
def test_an_empty_dictionary_of_options_may_only_lack_entries(kind: Any, outcome: str) -> None:
    """A reset that takes no options but None is found; one that asks for an entry isn't."""

    class Picky(Rovers):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            if options is not None:
                raise kind("map")
            return super().reset(seed)

    assert audited(Picky).of("GK524").outcome == outcome


class NeverResets(Rovers):
    """Its reset has a fault of its own."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Raises, whatever it is given."""
        raise KeyError("a fault of its own")


def test_arguments_are_not_blamed_where_no_reset_succeeds() -> None:
    """What raises with every argument and without any isn't a matter of arguments."""
    assert audited(NeverResets).of("GK524").outcome == "not_exercised"


def test_the_ended_may_be_refused() -> None:
    """An environment that raises at actions of those who are gone is fine."""

    class Strict(Rovers):
        def step(self, actions: Any) -> Any:
            if set(actions) - set(self.agents):
                raise ValueError("somebody isn't here")
            return super().step(actions)

    assert audited(Strict, budget=800).of("GK526").outcome == "passed"


def test_the_ended_are_not_blamed_for_chance() -> None:
    """A game that never goes the same way twice says nothing about those who ended."""

    class Chance(Rovers):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            return super().reset(None if self.rng is not None else seed, options)

    assert audited(Chance, budget=800).of("GK526").outcome == "not_exercised"


def test_the_ended_are_not_blamed_for_what_use_changes() -> None:
    """What another episode of the same instance gives is no answer to those who ended."""

    class Worn(Rovers):
        episodes = 0

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            self.episodes += 1
            return super().reset(seed, options)

        def step(self, actions: dict[str, Any]) -> Any:
            seen, paid, *rest = super().step({agent: actions[agent] for agent in self.agents})
            worn = 1.0 if self.episodes > 3 else 0.0
            return seen, {agent: pay - worn for agent, pay in paid.items()}, *rest

    assert audited(Worn, budget=800).of("GK526").outcome == "not_exercised"


class HeardInState(Rovers):
    """What is said in the name of rovers that have ended shows in the state alone."""

    heard = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing was said."""
        self.heard = 0
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Hears them."""
        self.heard += sum(int(actions[agent]) for agent in actions.keys() - set(self.agents))
        return super().step({agent: actions[agent] for agent in self.agents})

    def state(self) -> Any:
        """Tells it."""
        return np.array([self.heard])


def test_the_ended_that_act_in_the_state_are_found() -> None:
    """What moves nothing but the state is found, and its program compares the state."""
    verdict = audit_here(HeardInState, select=("GK526",), budget=800).of("GK526")
    assert verdict.outcome == "failed"
    assert "given.append(env.state())" in verdict.findings[0].reproducer
