"""Inputs that once brought out another error than a documented one don't do so again."""

import random
from pathlib import Path

import pytest

from benchmarks.fuzz import Corpus, play_again, run, sampler
from benchmarks.fuzzing.places import Places
from gamekeeper.errors import GamekeeperError

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Places:
    """Sound evidence of every kind, to be damaged."""
    return Places(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.parametrize("found", CORPUS, ids=lambda path: path.name)
def test_corpus_is_refused_with_documented_errors(places: Places, found: Path) -> None:
    """Each is read as it was when it was found."""
    with pytest.raises(GamekeeperError):
        play_again(places, found)


@pytest.mark.parametrize("target", ["contract", "spec-data", "manifest", "receipt", "run-line"])
def test_fuzzer_finds_nothing_in_a_few_inputs(places: Places, target: str, tmp_path: Path) -> None:
    """The fuzzer itself works; what it plays at length is on the page about security."""
    sample = sampler(target, places, random.Random(7))
    done = run(target, 20, sample, Corpus(tmp_path, target))
    assert done["other_errors"] == {}
    assert list(tmp_path.iterdir()) == []


def test_fuzzer_tells_and_keeps_what_it_finds(places: Places, tmp_path: Path) -> None:
    """An error that isn't documented is counted, and its input is in the corpus' folder."""

    def broken() -> None:
        raise KeyError("x")

    done = run("spec", 2, lambda: ("text", b"abc", broken), Corpus(tmp_path, "spec"))
    assert done["other_errors"] == {"KeyError: 'x'": 2}
    (kept,) = tmp_path.iterdir()
    assert kept.read_bytes() == b"abc"
