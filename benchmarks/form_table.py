"""Measured structures beside known ones: right, wrong and silent, by field.

    python benchmarks/form_table.py [--budget 20000] [--seed 0] [--only NAME ...] [--held]

Measures every environment of `benchmarks/forms` with the probes that the measured form reads, each
with the steps that it has in a whole audit of that budget, and compares each field with the form
that its author wrote down; doubtful fields aren't judged. `--held` takes the environments that are
kept back, and prints sums alone. With `--only`, all of the measurement is printed.

Rules: a field is *silent* where the measurement has no value. Roles are compared, not agents.
`influence` is right where the pairs of roles, and the least lag of each, are those of the form;
`links` counts single pairs. `earner and payee` is right where every part's pair is found with its
lag, and nothing that the form doesn't have; where a role earns what the same role is paid, the form
doesn't say of the same agent or of another, and either is right. `messages` is right where some
role's whole action is called a message, if and only if the form has one. `advice` of None (not
judged) is passed over.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.forms.form import Form
from gamekeeper.auditing.gather import gather, session_of
from gamekeeper.auditing.measured_form import PROBES, measured
from gamekeeper.auditing.probe import probes
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import role
from gamekeeper.interface.opening import open_env

RIGHT, WRONG, SILENT = "right", "wrong", "silent"
Answer = tuple[str, str]
"""A field and its result."""


def told(is_right: bool) -> str:
    """The word of a result."""
    return RIGHT if is_right else WRONG


def answers(form: Form, found: Mapping[str, Any], roles: tuple[str, ...]) -> Iterator[Answer]:
    """Yields each judged field with its result."""
    for field, result in _answers(form, found, roles):
        if field.split()[0] not in form.doubtful and field not in form.doubtful:
            yield field, result


def _answers(form: Form, found: Mapping[str, Any], roles: tuple[str, ...]) -> Iterator[Answer]:
    yield "stages", _stages(form, found.get("stages"))
    for field in ("order", "observe", "conflicts", "legality", "deterministic"):
        truth, value = getattr(form, field), found.get(field)
        if truth is not None:
            yield field, SILENT if value is None else told(value == truth)
    if form.api == "parallel" and form.order_sensitive is not None:
        value = found.get("order_sensitive")
        yield "order_sensitive", SILENT if value is None else told(value == form.order_sensitive)
    horizon = found.get("horizon")
    is_silent = horizon is None and form.horizon is not None
    yield "horizon", SILENT if is_silent else told(horizon == form.horizon)
    yield from _kinds(form, found.get("reward") or {})
    if "rewards" not in form.doubtful:
        pairs = (found.get("reward") or {}).get("pairs")
        yield "earner and payee", _pairs(form, pairs, roles)
    ends = (found.get("endings") or {}).get("kinds")
    truth = {(end.kind, end.owner) for end in form.endings.values()}
    kinds = None if ends is None else {(end["kind"], end["owner"]) for end in ends}
    yield "endings", SILENT if kinds is None else told(kinds == truth)
    for field in ("may_join", "may_leave"):
        value = found.get(field)
        yield field, SILENT if value is None else told(set(value) == set(getattr(form, field)))
    by_role = found.get("symmetric") or {}
    for name, truth in form.symmetric.items():
        if truth is not None:
            seems = (by_role.get(name) or {}).get("seems")
            yield "symmetric", SILENT if seems is None else told(seems == truth)
    said = found.get("messages")
    is_said = said is not None and any(each["message"] for each in said.values())
    yield "messages", SILENT if said is None else told(is_said == ("action" in form.messages))
    yield from _influence(form, found.get("influence"))
    yield from _advice(form, found)


def _stages(form: Form, value: Any) -> str:
    if value is None:
        return SILENT
    return told([set(stage) for stage in value] == [set(stage) for stage in form.stages])


def _kinds(form: Form, reward: Mapping[str, Any]) -> Iterator[Answer]:
    kinds = {part.kind for part in form.rewards.values()}
    many = sum(1 for _ in form.symmetric) > 1 or None not in form.symmetric.values()
    for field, kind in (("shared", "shared"), ("zero_sum", "zero-sum")):
        if many:
            value = reward.get(field)
            yield field, SILENT if value is None else told(value == (kinds == {kind}))


def _pairs(form: Form, pairs: Any, roles: tuple[str, ...]) -> str:
    """Earner and payee; a pair is (from, to, is the agent's own, lag)."""
    if pairs is None:
        return SILENT
    found = {(each["from"], each["to"], each["own"]): each["lag"] for each in pairs}
    allowed = {(one, to, False) for one, to, on, _ in form.influence if on == "reward"}
    for part in form.rewards.values():
        for earner in roles if part.earner == "all" else (part.earner,):
            wanted = [(earner, earner, True)] if part.payee in ("earner", "all") else []
            if part.payee == "all":
                allowed |= {(earner, to, False) for to in roles}
            elif part.payee != "earner":
                is_own = earner == part.payee and (earner, earner, False) not in found
                wanted.append((earner, part.payee, is_own))
                allowed.add((earner, part.payee, False))
            for key in wanted:
                allowed.add(key)
                if key not in found or (part.lag is not None and found[key] > part.lag):
                    return WRONG
    return told(all(own or (one, to, own) in allowed for one, to, own in found))


def _influence(form: Form, rows: Any) -> Iterator[Answer]:
    if rows is None:
        yield "influence", SILENT
        return
    least: dict[tuple[str, str, str], int] = {}
    for row in rows:
        if row["p"] > 0 and row["from"] != row["to"]:
            key = role(row["from"]), role(row["to"]), row["on"]
            least[key] = min(row["lag"], least.get(key, row["lag"]))
    truth = {(one, to, on): lag for one, to, on, lag in form.influence}
    yield "influence", told(least == truth)
    for key, lag in truth.items():
        yield "links", SILENT if key not in least else told(least[key] == lag)
    yield from (("links", WRONG) for key in least if key not in truth)


def _advice(form: Form, found: Mapping[str, Any]) -> Iterator[Answer]:
    if form.advice is not None:
        advice = found.get("advice")
        yield "advice", SILENT if advice is None else told(advice == form.advice)
        if advice == form.advice == "aec":
            because = found.get("because")
            yield "because", SILENT if because is None else told(set(form.because) <= set(because))


def measurement(make: Any, *, budget: int, seed: int) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """The measured form as a whole audit has it, and the roles of the agents."""
    shares = {name: each.share for name, each in probes().items()}
    sharing = {name for name in PROBES if shares[name]}
    part = sum(shares[name] for name in sharing) / sum(shares.values())
    looks: dict[str, Any] = {}
    holds_entropy = False
    for names, steps in ((sharing, int(budget * part)), (set(PROBES) - sharing, budget)):
        session = session_of(open_env(make), None, spec=make, kwargs={}, seed=seed, budget=steps)
        session.holds_entropy = holds_entropy
        evidence = gather(session, names, died={}, on_probe=lambda *_: None).gathered()
        holds_entropy = session.holds_entropy
        looks.update(evidence.looks)
    whole = ProbeEvidence(api=evidence.api, agents=evidence.agents, looks=looks)
    roles = tuple(dict.fromkeys(role(name) for name in evidence.agents))
    return measured(Contract(), whole), roles


def catalogue(is_held: bool) -> list[tuple[Any, Form]]:
    """Factories with their forms."""
    if is_held:
        from benchmarks.forms.held.catalogue import forms as held

        return held()
    from benchmarks.forms.catalogue import forms

    return forms()


def table(by_field: Mapping[str, Counter[str]]) -> str:
    """Counts by field, with the share that is answered, and of these the share that is right."""
    lines = [f"{'field':18}{'right':>7}{'wrong':>7}{'silent':>7}{'answered':>10}{'right of':>10}"]
    for field, counts in by_field.items():
        given = counts[RIGHT] + counts[WRONG]
        shares = given / (given + counts[SILENT]), counts[RIGHT] / max(given, 1)
        numbers = "".join(f"{counts[each]:7}" for each in (RIGHT, WRONG, SILENT))
        lines.append(f"{field:18}{numbers}{shares[0]:10.0%}{shares[1]:10.0%}")
    return "\n".join(lines)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--budget", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=())
    parser.add_argument("--held", action="store_true")
    options = parser.parse_args()
    by_field: dict[str, Counter[str]] = {}
    begun_s, count = time.perf_counter(), 0
    for make, form in catalogue(options.held):
        if options.only and form.name not in options.only:
            continue
        found, roles = measurement(make, budget=options.budget, seed=options.seed)
        count += 1
        if options.only:
            print(json.dumps(found, indent=1, default=str))
        faults = []
        for field, answer in answers(form, found, roles):
            by_field.setdefault(field, Counter())[answer] += 1
            faults += [f"{field} {answer}"] if answer != RIGHT else []
        if not options.held:
            print(f"{form.name}: {', '.join(faults)}", file=sys.stderr)
    print(table(by_field))
    seconds = time.perf_counter() - begun_s
    print(f"{count} environments, budget {options.budget}, seed {options.seed}, {seconds:.0f} s")


if __name__ == "__main__":
    main()
