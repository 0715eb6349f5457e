"""GK802."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._films import filmed, nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROMISED: Final = {
    "rgb_array": "a numpy.ndarray of uint8, [height, width, 3]",
    "ansi": "a str",
    "rgb_array_list": "a list of numpy.ndarrays of uint8, [height, width, 3]",
    "ansi_list": "a list of str",
}
PROOFS: Final = {
    "rgb_array": "assert all(isinstance(f, np.ndarray) and f.dtype == np.uint8 and f.ndim == 3\n"
    "           and f.shape[2] == 3 and f.size for f in frames), repr(frames[-1])[:200]",
    "ansi": "assert all(isinstance(f, str) for f in frames), repr(frames[-1])[:200]",
    "rgb_array_list": "assert all(isinstance(f, list) for f in frames), repr(frames[-1])[:200]\n"
    "assert all(f.dtype == np.uint8 and f.ndim == 3 and f.shape[2] == 3\n"
    "           for each in frames for f in each)",
    "ansi_list": "assert all(isinstance(f, list) for f in frames), repr(frames[-1])[:200]",
}


@check(
    "GK802",
    needs=("render",),
    severity=MEDIUM,
    mend="return uint8 in [0, 255] of shape [height, width, 3] in mode 'rgb_array' "
    "((frame * 255).astype(np.uint8) for floats in [0, 1]), a str in mode 'ansi'",
    applies=nothing_to_film,
)
def frames_are_as_promised(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """render() returns what its mode promises: uint8 [height, width, 3] for "rgb_array", a str for "ansi".

    Floats, None, a transposed or an empty picture, or an exception stop whoever writes a video, or
    give a black one. What it does once the episode is over isn't judged.

    Source: PettingZoo's `render_test`; `AECEnv.render`.

    Bad:
        return frame / 255.0

    Good:
        return frame.astype(np.uint8)
    """  # noqa: E501  # the claim is one line
    for fact in evidence.facts("render", "film"):
        mode = fact.value["mode"]
        if mode not in PROMISED:
            continue
        proof = filmed(evidence.api, fact.value["options"], PROOFS[mode])
        for shot in fact.value["shots"]:
            failed = shot["failed"]
            if failed is not None and (shot["over"] or shot["is_missing"]):
                continue
            if shot["over"] and shot["kind"] == "NoneType":
                continue
            where = _at(fact.where, shot["turn"])
            seen = f"it raised {failed}" if failed else _words(shot)
            yield Occasion(where, _is_right(mode, shot), PROMISED[mode], seen, proof=proof)


def _at(where: Any, turn: int) -> Any:
    return type(where)(where.probe, where.play, turn, None, "render")


def _is_right(mode: str, shot: Mapping[str, Any]) -> bool:
    if shot["failed"] is not None:
        return False
    if mode == "ansi":
        return bool(shot["kind"] == "str")
    if mode.endswith("_list") and shot["kind"] != "list":
        return False
    if mode == "ansi_list":
        return True
    pictures = shot["frames"]
    right = all(d == "uint8" and len(s) == 3 and s[2] == 3 and 0 not in s for d, s in pictures)
    return right and (mode == "rgb_array_list" or (len(pictures) == 1 and _is_array(shot)))


def _is_array(shot: Mapping[str, Any]) -> bool:
    return shot["kind"] not in ("list", "tuple")


def _words(shot: Mapping[str, Any]) -> str:
    pictures = [f"{dtype}, {shape}" for dtype, shape in shot["frames"][:1]]
    return " of ".join([f"a {shot['kind']}", *pictures])
