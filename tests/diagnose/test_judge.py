"""What arms say, on outcomes made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gamekeeper.diagnose.judge import Finding, is_failing, judged, recovered
from gamekeeper.diagnose.remedies import Remedy, joined

N = 64
NOISE = Remedy("noise = 0", "perception", ("a",), (("argument", "", "noise", 0),))
BLUR = Remedy("blur = 0", "perception", ("a",), (("argument", "", "blur", 0),))
SLIP = Remedy("slip = 0", "control", ("b",), (("argument", "", "slip", 0),))
TRUTH = Remedy(
    "truth = 1", "state estimation", ("a",), (("argument", "", "truth", 1),),
    frozenset({"noise = 0"}),
)  # fmt: skip


def share(p: float) -> Any:
    """[N] of which a part succeeds."""
    return (np.arange(N) < round(p * N)).astype(float)


def found(sham: float, everything: float | None = None, **arms: float) -> Finding:
    """The finding for arms named by the remedies above."""
    remedies = {"noise": NOISE, "blur": BLUR, "slip": SLIP, "truth": TRUTH}
    remedies["pair"] = joined([NOISE, SLIP])
    remedies["more"] = joined([joined([NOISE, BLUR], "perception: all"), SLIP])
    return judged(
        share(sham), {remedies[name]: share(p) for name, p in arms.items()},
        everything=None if everything is None else share(everything),
        rng=np.random.default_rng(0),
    )  # fmt: skip


def test_one_that_restores_alone_is_isolated() -> None:
    """The decoy that was at its ideal too changes nothing."""
    answer = found(0.1, noise=0.95, slip=0.1)
    assert (answer.answer, answer.labels) == ("isolated", ("perception",))
    assert answer.remedies == (NOISE,)


def test_what_contains_a_restoring_remedy_says_nothing() -> None:
    """The true state cures noise by declaration, so it isn't a second cause."""
    assert found(0.1, noise=0.95, truth=0.95).labels == ("perception",)


def test_a_containing_remedy_that_restores_alone_is_the_cause() -> None:
    """What it contains doesn't restore: then it is the estimation."""
    assert found(0.1, noise=0.1, truth=0.95).labels == ("state estimation",)


def test_two_that_restore_each_cannot_be_told_apart() -> None:
    """Of different labels: compatible. Of one label: that label is isolated."""
    assert found(0.1, noise=0.95, slip=0.95).answer == "compatible"
    answer = found(0.1, noise=0.95, blur=0.95)
    assert (answer.answer, answer.labels) == ("isolated", ("perception",))


def test_a_pair_that_neither_part_replaces_is_joint() -> None:
    """Both together, and neither alone."""
    answer = found(0.1, noise=0.15, slip=0.1, pair=0.95)
    assert (answer.answer, answer.labels) == ("joint", ("perception", "control"))


def test_a_pair_that_needs_less_goes_before_one_that_does_more() -> None:
    """So nobody is named whose handle does no harm."""
    answer = found(0.1, noise=0.15, slip=0.1, blur=0.1, pair=0.95, more=0.95)
    assert answer.answer == "joint"
    assert [remedy.name for remedy in answer.remedies] == ["noise = 0 + slip = 0"]


def test_a_pair_no_better_than_its_part_is_not_joint() -> None:
    """One part nearly restores: more episodes have to tell."""
    answer = found(0.1, noise=0.64, slip=0.1, pair=0.68)
    assert answer.answer == "compatible"
    assert "more episodes would tell" in answer.why


def test_all_at_once_without_a_pair_is_compatible() -> None:
    """Something among them is it."""
    assert found(0.1, 0.95, noise=0.1, slip=0.1).answer == "compatible"


def test_nothing_that_restores_is_untested() -> None:
    """The cause has no handle; no label is named."""
    answer = found(0.1, 0.1, noise=0.15, slip=0.1)
    assert (answer.answer, answer.labels) == ("untested", ())
    assert "no remedy restores" in answer.why


@pytest.mark.parametrize("sham", [0.98, 0.92, 0.85])
def test_who_does_not_fail_beyond_chance_has_no_cause(sham: float) -> None:
    """However good a remedy looks, there is nothing to restore."""
    answer = found(sham, noise=1.0)
    assert (answer.answer, answer.labels) == ("untested", ())
    assert not is_failing(share(sham), 0.9)


def test_recovered_is_the_part_of_the_gap() -> None:
    """From 0.5 to 0.7 is half of the way to 0.9."""
    sham, arm = (np.arange(100) < 50).astype(float), (np.arange(100) < 70).astype(float)
    assert recovered(sham, arm, 0.9) == pytest.approx(0.5)
    assert recovered(arm, sham, 0.5) == 0.0
