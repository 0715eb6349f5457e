"""GK824."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.canon import from_json, shown, to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES: Final = {
    "play": "env.reset(seed=SEED)\nfor action in ACTIONS:\n{step}",
    "render": "env.reset(seed=SEED)\nenv.render()\n",
    "make": "make()\n",
}


@check(
    "GK824",
    needs=("metadata",),
    severity=LOW,
    mend="copy the dictionary before changing it: self.metadata = {**self.metadata, ...}",
)
def metadata_stays(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Metadata doesn't change while the environment is used, nor when another instance is built.

    It stands on the class: what one instance writes there, all others say from then on.

    Bad:
        self.metadata["render_modes"].append("ansi")

    Good:
        self.metadata = {**self.metadata, "render_modes": [*modes, "ansi"]}
    """
    for fact in evidence.facts("metadata", "metadata after"):
        before = fact.value["before"]
        changed = [each for each in fact.value["after"] if each[2] != before]
        done, mode, after = changed[0] if changed else ("make", None, before)
        proof = _proof(evidence.api, done, mode)
        expected, seen = _parted(before, after)
        yield Occasion(fact.where, not changed, expected, f"after {done}: {seen}", proof=proof)


def _parted(before: str, after: str) -> tuple[str, str]:
    """The first field that isn't the same any more, before and after."""
    fields, others = from_json(before), from_json(after)
    if isinstance(fields, dict) and isinstance(others, dict):
        for name in [*fields, *others]:
            if to_json(fields.get(name)) != to_json(others.get(name)):
                return f"{name}: {shown(fields.get(name))}", f"{name}: {shown(others.get(name))}"
    return before, after


def _proof(api: str, done: str, mode: str | None) -> Proof:
    step = "    env.step(action)\n"
    step = step if api == "parallel" else f"    env.last()\n{step}"
    start = "env = make()\n" if mode is None else "env = plain()\n"
    return Proof(
        f"{start}before = copy.deepcopy(env.metadata)\n{LINES[done].format(step=step)}"
        "assert env.metadata == before, (before, env.metadata)",
        plays=False,
        imports=("copy",),
        options={} if mode is None else {"render_mode": mode},
    )
