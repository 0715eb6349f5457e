"""What arms say, on outcomes made by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gamekeeper.diagnosis.failure_causes import scope_answer
from gamekeeper.diagnosis.judgement import (
    EITHER,
    OR_KEPT,
    ScopeFinding,
    _labels,
    is_failing,
    judged,
    recovered,
)
from gamekeeper.diagnosis.trials import MEMORY, POLICY, IdealSubstitute, joined, over_undos, undone
from gamekeeper.diagnosis.undo_search import _kept
from gamekeeper.diagnosis.undos import BoundaryUndo

N = 64
NOISE = IdealSubstitute("noise = 0", "perception", ("a",), (("argument", "", "noise", 0),))
BLUR = IdealSubstitute("blur = 0", "perception", ("a",), (("argument", "", "blur", 0),))
SLIP = IdealSubstitute("slip = 0", "control", ("b",), (("argument", "", "slip", 0),))
TRUTH = IdealSubstitute(
    "truth = 1",
    "state estimation",
    ("a",),
    (("argument", "", "truth", 1),),
    frozenset({"noise = 0"}),
)


def share(p: float) -> Any:
    """[N] of which a part succeeds."""
    return (np.arange(N) < round(p * N)).astype(float)


def found(unchanged: float, everything: float | None = None, **arms: float) -> ScopeFinding:
    """The finding for arms named by the ideal substitutes above."""
    substitutes = {"noise": NOISE, "blur": BLUR, "slip": SLIP, "truth": TRUTH}
    substitutes["pair"] = joined([NOISE, SLIP])
    substitutes["more"] = joined([joined([NOISE, BLUR], "perception: all"), SLIP])
    return judged(
        share(unchanged),
        {substitutes[name]: share(p) for name, p in arms.items()},
        everything=None if everything is None else share(everything),
        rng=np.random.default_rng(0),
    )


def test_one_that_restores_alone_is_isolated() -> None:
    """The decoy that was at its ideal too changes nothing."""
    answer = found(0.1, noise=0.95, slip=0.1)
    assert (answer.answer, answer.labels) == ("isolated", ("perception",))
    assert answer.substitutes == (NOISE,)


def test_a_larger_effect_that_may_be_chance_leaves_the_cause_open() -> None:
    """What passes the correction by its small variance isn't shown to be the only cause."""
    unchanged = share(43 / N)
    steady, unsteady = unchanged.copy(), unchanged.copy()
    steady[43:56] = 1
    unsteady[43:], unsteady[:6] = 1, 0
    arms = {NOISE: steady, SLIP: unsteady}

    answer = judged(unchanged, arms, dropped=20, rng=np.random.default_rng(0))

    assert [one.restores for one in answer.tried] == [True, False]
    assert (answer.answer, answer.labels) == ("ambiguous", ("perception", "control"))
    assert answer.substitutes == (NOISE, SLIP)
    assert answer.why.endswith("as much changes by slip = 0, not yet beyond chance")
    del arms[SLIP]
    alone = judged(unchanged, arms, dropped=20, rng=np.random.default_rng(0))
    assert (alone.answer, alone.labels) == ("isolated", ("perception",))


def test_what_contains_a_restoring_substitute_says_nothing() -> None:
    """The true state cures noise by declaration, so it isn't a second cause."""
    assert found(0.1, noise=0.95, truth=0.95).labels == ("perception",)


def test_a_containing_substitute_that_restores_alone_is_the_cause() -> None:
    """What it contains doesn't restore: then it is the estimation."""
    assert found(0.1, noise=0.1, truth=0.95).labels == ("state estimation",)


def test_two_that_restore_each_cannot_be_told_apart() -> None:
    """Of different labels: ambiguous. Of one label: that label is isolated."""
    assert found(0.1, noise=0.95, slip=0.95).answer == "ambiguous"
    answer = found(0.1, noise=0.95, blur=0.95)
    assert (answer.answer, answer.labels) == ("isolated", ("perception",))


def test_either_of_two_agents_cannot_be_told_apart() -> None:
    """The same component of both restores by itself: whose fault it is stays open."""
    names = [
        IdealSubstitute(f"policy[{a}] = reference", POLICY, (a,), (("policies", a, "", "x"),))
        for a in "ab"
    ]
    arms = {one: share(0.95) for one in names}
    either = judged(share(0.1), arms, rng=np.random.default_rng(0))
    assert (either.answer, either.labels) == ("ambiguous", ())
    one = judged(share(0.1), {names[0]: share(0.95)}, rng=np.random.default_rng(0))
    assert (one.answer, one.labels) == ("isolated", ())
    assert "it is a's policy; which part of it can't be told apart" in one.why


def test_an_undo_whose_rivals_were_not_played_is_ambiguous_with_their_labels() -> None:
    """No label alone, as another boundary of the same agent may be it."""
    seen, done = (undone(BoundaryUndo(("a",), way, (0,))) for way in ("mirror field", "hold"))
    rng = np.random.default_rng(0)
    answer = judged(share(0.0), {seen: share(1.0)}, skipped=[done], rng=rng)
    assert (answer.answer, answer.labels) == ("ambiguous", ("perception", "timing"))
    assert "1 other undos from outside weren't played" in answer.why
    assert judged(share(0.0), {seen: share(1.0)}, rng=rng).answer == "isolated"


def test_a_pair_that_neither_part_replaces_is_joint() -> None:
    """Both together, and neither alone."""
    answer = found(0.1, noise=0.15, slip=0.1, pair=0.95)
    assert (answer.answer, answer.labels) == ("joint", ("perception", "control"))


def test_policies_of_two_agents_that_are_both_needed_are_joint() -> None:
    """Isolated is one change alone; where a part wasn't tried, no more is said."""
    parts = [IdealSubstitute(f"giving {a} x", POLICY, (a,), (("", a, "", "x"),)) for a in "ab"]
    arms = {joined(parts, "both"): share(1.0), parts[0]: share(0.1), parts[1]: share(0.0)}
    answer = judged(share(0.0), arms, rng=np.random.default_rng(0))
    assert answer.answer == "joint"
    arms.popitem()
    assert judged(share(0.0), arms, rng=np.random.default_rng(0)).answer == "isolated"


def test_an_undo_without_a_counterpart_has_no_label() -> None:
    """The agent is shown, and not whether it misreads or does it."""
    one = undone(BoundaryUndo(("a",), "mirror field", (0,)), open_as=EITHER)
    answer = judged(share(0.0), {one: share(1.0)}, rng=np.random.default_rng(0))
    assert (answer.answer, answer.labels) == ("isolated", ())
    assert "a's perception or control" in answer.why


def test_a_part_that_restores_less_than_the_whole_policy_has_no_label() -> None:
    """Beyond chance less: it makes up for some of what is wrong, and shows no part of it."""
    part = undone(BoundaryUndo(("a",), "exchange fields", (0, 1)))
    swap = IdealSubstitute("giving a b's policy", "policy", ("a",), (("policy", "a", "", "x"),))
    for reached, labels in ((1.0, ("perception",)), (0.8, ())):
        arms = {one: share(1.0) for one in over_undos([swap, part]) if one.name == swap.name}
        answer = judged(share(0.0), {**arms, part: share(reached)}, rng=np.random.default_rng(0))
        assert (answer.answer, answer.labels) == ("isolated", labels)
    assert [one.shown for one in answer.substitutes] == ["a's policy"]


@pytest.mark.parametrize(("alone", "expected"), [(0.2, "joint"), (0.55, "unexplained")])
def test_an_undo_that_eases_what_another_undoes_blames_no_agent(
    alone: float, expected: str
) -> None:
    """Two faults that hide each other: neither undo alone does most of what both do."""
    undos = [undone(BoundaryUndo((a,), way)) for a, way in (("a", "mirror field"), ("b", "settle"))]
    shares = {joined(undos): share(1.0), undos[0]: share(alone), undos[1]: share(0.0)}
    assert judged(share(0.0), shares, rng=np.random.default_rng(0)).answer == expected


def test_an_action_that_is_held_hides_what_a_policy_keeps() -> None:
    """Where a reset of its memory restores too, it isn't shown to be one of timing."""
    one = undone(BoundaryUndo(("a",), "hold", amount=4.0), open_as=OR_KEPT)
    memory = IdealSubstitute("reset", MEMORY, ("a",), (("forgets", "a", "", True),))
    arms = {one: share(1.0) for one in over_undos([memory, one])}
    answer = judged(share(0.0), arms, rng=np.random.default_rng(0))
    assert (answer.answer, answer.labels) == ("isolated", ())
    assert "it is a's timing or what it keeps" in answer.why
    experiment: Any = SimpleNamespace(finding=lambda scope: answer, open_scopes=["team"])
    assert _kept(experiment) == {"a"}


def test_a_pair_that_needs_less_goes_before_one_that_does_more() -> None:
    """So nobody is named whose handle does no harm."""
    answer = found(0.1, noise=0.15, slip=0.1, blur=0.1, pair=0.95, more=0.95)
    assert answer.answer == "joint"
    assert [substitute.name for substitute in answer.substitutes] == ["noise = 0 + slip = 0"]


def test_a_pair_no_better_than_its_part_is_not_joint() -> None:
    """One part nearly restores: more episodes have to tell."""
    answer = found(0.1, noise=0.64, slip=0.1, pair=0.68)
    assert answer.answer == "ambiguous"
    assert "more episodes would tell" in answer.why


def test_all_at_once_without_a_pair_is_ambiguous() -> None:
    """Something among them is it."""
    assert found(0.1, 0.95, noise=0.1, slip=0.1).answer == "ambiguous"


def test_nothing_that_restores_is_unexplained() -> None:
    """The cause has no handle; no label is named."""
    answer = found(0.1, 0.1, noise=0.15, slip=0.1)
    assert (answer.answer, answer.labels) == ("unexplained", ())
    assert "no ideal substitute restores" in answer.why


@pytest.mark.parametrize("unchanged", [0.98, 0.92, 0.85])
def test_who_does_not_fail_beyond_chance_has_no_cause(unchanged: float) -> None:
    """However good an ideal substitute looks, there is nothing to restore."""
    answer = found(unchanged, noise=1.0)
    assert answer.answer == ("healthy" if unchanged >= 0.9 else "not_failing")
    assert answer.labels == ()
    assert not is_failing(share(unchanged), 0.9)


def test_recovered_is_the_part_of_the_gap() -> None:
    """From 0.5 to 0.7 is half of the way to 0.9."""
    unchanged, arm = (np.arange(100) < 50).astype(float), (np.arange(100) < 70).astype(float)
    assert recovered(unchanged, arm, 0.9) == pytest.approx(0.5)
    assert recovered(arm, unchanged, 0.5) == 0.0


def test_what_was_not_tried_is_said_before_unexplained() -> None:
    """The answer claims nothing of what the budget didn't reach."""
    answer = found(0.1, 0.1, noise=0.15, slip=0.1)
    experiment: Any = SimpleNamespace(
        finding=lambda scope: answer,
        not_played=["88 of 88 undos from outside"],
        is_broken_off=False,
    )
    why = scope_answer(experiment, "team", None).why
    assert why.startswith("not tried: 88 of 88 undos from outside; of what was, no ideal")
    experiment.not_played = []
    assert scope_answer(experiment, "team", None) == answer


def test_pairs_that_restore_at_either_boundary_have_both_labels() -> None:
    """A label is open only while the other boundary of that agent has no undo that restores."""
    mirrored = {
        agent: undone(BoundaryUndo((agent,), "mirror field", (0,)), open_as="") for agent in "ab"
    }
    turned = {
        agent: undone(BoundaryUndo((agent,), "exchange actions", (0, 0, 1)), open_as=EITHER)
        for agent in "ab"
    }
    both = joined([mirrored["a"], mirrored["b"]]), joined([mirrored["a"], turned["b"]])
    failing = {part: share(0.0) for pair in both for part in pair.parts}
    answer = judged(
        share(0.0), {**failing, **{pair: share(1.0) for pair in both}}, rng=np.random.default_rng(0)
    )
    assert (answer.answer, answer.labels) == ("ambiguous", ("perception", "control"))
    alone = judged(share(0.0), {**failing, both[1]: share(1.0)}, rng=np.random.default_rng(0))
    assert (alone.answer, alone.labels) == ("joint", ("perception",))


def test_different_gains_leave_the_label_of_an_action_open_too() -> None:
    """What is observed or what is done, multiplied, does alike: neither is shown to be wrong."""
    twice, tenfold = (undone(BoundaryUndo(("a",), "rescale fields", (), by)) for by in (2.0, 10.0))
    stronger = undone(BoundaryUndo(("a",), "rescale axes", (), 2.0))
    assert _labels([stronger]) == ("control",)
    assert _labels([stronger, twice]) == ()
    assert _labels([stronger, twice, tenfold]) == ()
    half, tenth = (undone(BoundaryUndo(("a",), "rescale fields", (), by)) for by in (0.5, 0.1))
    weaker = undone(BoundaryUndo(("a",), "rescale axes", (), 0.5))
    assert _labels([weaker, half]) == ("perception", "control")
    assert _labels([weaker, half, tenth]) == ()
