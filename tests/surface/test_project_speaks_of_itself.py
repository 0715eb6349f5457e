"""What is kept speaks of the project: of no machine, no package index, no way it was written."""

import re

import pytest

from tests.surface.sources import ROOT, kept_files

# A letter stands in brackets in each pattern, so that the pattern doesn't find itself.
FORBIDDEN = {
    "a machine's path": r"(?<![\w.~])/(?:[w]ork|[f]arm|[r]oot|[h]ome/(?!me\b)\w+|[o]pt/\w+)(?!\w)",
    "a temporary path": r"(?<![\w.~])/[t]mp/",
    "a package index": r"[p]ypi\.org|python[h]osted|[a]naconda\.org|registry\.[n]pm|[d]ebian\.org",
    "an address of packages": r"https?://\S+/(?:[s]imple|[p]ackages|[p]ool)/",
    "a choice of index": r"--(?:extra-)?[i]ndex-url[ =]",
    "the way it was written": r"\b[tT]his [s]ession\b|\b[s]ession that\b|[cC]o-[a]uthored-by",
    "a number on a list of work": r"(?<![\w/])[iI]ssue #?\d+\b",
}


def forbidden_words(text: str) -> list[str]:
    """What a text says that it must not, as `line: kind: words`."""
    found = []
    for kind, pattern in FORBIDDEN.items():
        for match in re.finditer(pattern, text, flags=re.MULTILINE):
            line = text.count("\n", 0, match.start()) + 1
            found.append(f"{line}: {kind}: {match.group()}")
    return found


def test_kept_files_speak_of_the_project() -> None:
    """No kept file names a machine, a package index, or how it came about."""
    found = []
    assert ROOT / "README.md" in kept_files(), "the listing is empty: nothing was looked at"
    for path in kept_files():
        data = path.read_bytes()
        if b"\0" in data:
            continue  # not a text
        words = forbidden_words(data.decode("utf-8", errors="replace"))
        found += [f"{path.relative_to(ROOT)}:{word}" for word in words]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "see /[w]ork/main/src",
        "cd /[r]oot",
        "out = '/[t]mp/x'",
        "fetched from files.python[h]osted.org",
        "--[i]ndex-url example",
        "https://example.com/[s]imple/numpy",
        "as found in this [s]ession",
        "fixes [i]ssue #12",
    ],
)
def test_look_finds(text: str) -> None:
    """Each kind of forbidden word is seen; brackets hide it here from the look above."""
    assert len(forbidden_words(text.replace("[", "").replace("]", ""))) == 1


@pytest.mark.parametrize(
    "text",
    [
        "frames/work/x",
        "~/work/",
        "a networked session",
        "tmp_path / 'x'",
        "PettingZoo#1105",
        "homework/",
    ],
)
def test_look_lets_pass(text: str) -> None:
    """Ordinary words are not mistaken for it."""
    assert forbidden_words(text) == []
