"""Checks of `metadata`."""

import difflib
import math
import re
from dataclasses import replace
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import LOW, Case, Cases, check
from gamekeeper.checks.facts.surface_facts import LaterMetadata, Metadata
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import metadata_has_mode, metadata_lists_modes
from gamekeeper.checks.reproducers import metadata_stays as metadata_unchanged
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json, shown, to_json

NAME_PROOF = "name = make().metadata.get('name')\nassert isinstance(name, str) and name, name"


@check("GK821", LOW, "metadata")
def metadata_names_the_environment(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Metadata is a dictionary and has the environment's name, as text.

    Results and videos are filed under it. Nothing in PettingZoo stops without: `str(env)` then is
    the name of the class.

    Bad:
        metadata = {"render_modes": ["rgb_array"]}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}

    Fix: metadata = {"name": "farm_v0", ...}
    """
    for fact in evidence.facts(Metadata):
        name, kind = fact.value.fields.get("name"), fact.value.kind
        is_named = kind == "dict" and isinstance(name, str) and bool(name.strip())
        seen = name if kind == "dict" else f"metadata is a {kind}"
        where = replace(fact.where, field="metadata.name")
        yield Case(where, is_named, "a name", seen, proof=Reproducer(NAME_PROOF, plays=False))


@check(
    "GK822",
    LOW,
    "metadata",
    looks_at='an entry "render_modes" of the metadata, or a render mode of the environment',
)
def render_modes_are_listed(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """metadata["render_modes"] is a list of texts, and has the mode that is in use.

    Tools choose a mode from it, and find none under any other spelling, such as Gym's former
    "render.modes". Having none to choose from is no fault as long as nothing renders.

    Source: PettingZoo's `render_test`: "Environments that support rendering must define
    render_modes in metadata".

    Bad:
        metadata = {"name": "farm_v0", "render_modes": "rgb_array"}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}

    Fix: metadata = {"render_modes": ["human", "rgb_array"], ...}, with every mode that render()
    knows
    """
    for fact in evidence.facts(Metadata):
        fields, own = fact.value.fields, fact.value.own
        modes = fields.get("render_modes", [])
        is_list = isinstance(modes, list | tuple) and all(isinstance(mode, str) for mode in modes)
        where = replace(fact.where, field="metadata.render_modes")
        if "render_modes" in fields:
            proof = reproducer_of(metadata_lists_modes)
            yield Case(where, is_list, "a list of texts", modes, proof=proof)
        elif (key := misspelt(fields, "render_modes")) is not None:
            yield Case(where, False, "render_modes", key, proof=_has_entry("render_modes"))
        elif fact.value.renders and fact.value.kind == "dict":
            found = "no such entry, and a constructor that takes a render mode"
            yield Case(where, False, "a list of texts", found, proof=_has_entry("render_modes"))
        if own is not None and is_list:
            where = replace(fact.where, field="render_mode")
            proof = reproducer_of(metadata_has_mode)
            seen = list(modes) if modes else "no render modes"
            yield Case(where, own in modes, f"{own!r} among them", seen, proof=proof)


ALIKE: Final = 0.85
"""Ratio of two keys' common letters from which one is taken for the other, misspelt."""


def misspelt(fields: dict[str, Any], key: str) -> str | None:
    """Key of the metadata that is almost `key`; None where there is none, or `key` itself."""
    plain = {re.sub(r"[^a-z]", "", str(each).lower()): str(each) for each in fields}
    near = difflib.get_close_matches(key.replace("_", ""), plain, n=1, cutoff=ALIKE)
    return plain[near[0]] if near and key not in fields else None


def _has_entry(key: str) -> Reproducer:
    return Reproducer(f"fields = make().metadata\nassert {key!r} in fields, fields", plays=False)


PICTURES: Final = ("rgb_array", "rgb_array_list")
FPS_PROOF: Final = (
    "fps = make().metadata.get('render_fps')\nassert fps is not None and fps > 0, fps"
)


@check("GK823", LOW, "metadata", looks_at="a render mode that gives pictures, such as rgb_array")
def pictures_have_a_rate(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An environment that renders pictures says in metadata["render_fps"] how many make a second.

    Recorders read it; where it is missing they guess (PettingZoo's take 30, which shows a board
    game thirty moves a second), or stop. No environment goes wrong for it, so this is a nuisance.

    Source: Gymnasium's `Env.metadata`; PettingZoo's `RecordVideo`.

    Bad:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"], "render_fps": 5}

    Fix: metadata = {"render_fps": 10, ...}
    """
    for fact in evidence.facts(Metadata):
        fields = fact.value.fields
        modes = fields.get("render_modes", ())
        if isinstance(modes, list | tuple) and any(mode in PICTURES for mode in modes):
            where = replace(fact.where, field="metadata.render_fps")
            fps = fields.get("render_fps")
            proof = Reproducer(FPS_PROOF, plays=False)
            yield Case(where, _is_rate(fps), "a number above 0", fps, proof=proof)


def _is_rate(fps: Any) -> bool:
    try:
        return not isinstance(fps, bool | str) and math.isfinite(fps) and float(fps) > 0
    except TypeError:
        return False


@check("GK824", LOW, "metadata")
def metadata_stays(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Metadata doesn't change while the environment is used, nor when another instance is built.

    It stands on the class: what one instance writes there, all others say from then on.

    Bad:
        self.metadata["render_modes"].append("ansi")

    Good:
        self.metadata = {**self.metadata, "render_modes": [*modes, "ansi"]}

    Fix: copy the dictionary before changing it: self.metadata = {**self.metadata, ...}
    """
    for fact in evidence.facts(LaterMetadata):
        before = fact.value.before
        changed = [each for each in fact.value.after if each[2] != before]
        done, mode, after = changed[0] if changed else ("make", None, before)
        proof = reproducer_of(
            metadata_unchanged, done=done, options={} if mode is None else {"render_mode": mode}
        )
        expected, seen = _parted(before, after)
        yield Case(fact.where, not changed, expected, f"after {done}: {seen}", proof=proof)


def _parted(before: str, after: str) -> tuple[str, str]:
    """The first field that isn't the same any more, before and after."""
    fields, others = from_json(before), from_json(after)
    if isinstance(fields, dict) and isinstance(others, dict):
        for name in [*fields, *others]:
            if to_json(fields.get(name)) != to_json(others.get(name)):
                return f"{name}: {shown(fields.get(name))}", f"{name}: {shown(others.get(name))}"
    return before, after


PARALLELIZABLE_PROOF: Final = (
    "says = make().metadata['is_parallelizable']\nassert isinstance(says, bool), says"
)


@check("GK825", LOW, "metadata", looks_at='an entry "is_parallelizable" of the metadata')
def parallelizable_is_a_bool(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """metadata["is_parallelizable"], where it is there, is True or False.

    A converter asks whether it is true: the text "False" is, and what stands under another
    spelling isn't.

    Bad:
        metadata = {"name": "farm_v0", "is_parallelizable": "False"}

    Good:
        metadata = {"name": "farm_v0", "is_parallelizable": False}

    Fix: metadata = {"is_parallelizable": False, ...}
    """
    for fact in evidence.facts(Metadata):
        fields = fact.value.fields
        if "is_parallelizable" in fields:
            says = fields["is_parallelizable"]
            where = replace(fact.where, field="metadata.is_parallelizable")
            proof = Reproducer(PARALLELIZABLE_PROOF, plays=False)
            yield Case(where, isinstance(says, bool), "True or False", says, proof=proof)
        elif (key := misspelt(fields, "is_parallelizable")) is not None:
            where = replace(fact.where, field="metadata.is_parallelizable")
            proof = _has_entry("is_parallelizable")
            yield Case(where, False, "is_parallelizable", key, proof=proof)
