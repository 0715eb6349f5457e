"""The structure as an audit measured it, beside what the contract declares."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.crowd import crowd_rows
from gamekeeper.reporting.influence_text import influence_text, lag_unit
from gamekeeper.reporting.results_text import table_lines
from gamekeeper.reporting.text_columns import column_lines, indented
from gamekeeper.statistics.significance import p_text

Document = Mapping[str, Any]

APART: Final = (
    *("influence", "looked_ahead", "advice", "because", "why", "errors", "not_measured"),
    *("order_ticks", "near_limits"),
)
"""Keys of `measured` that aren't rows of the table."""
DECLARED: Final[Mapping[str, tuple[str, ...]]] = {
    "stages": ("schedule", "stages"),
    "order": ("schedule", "order"),
    "observe": ("schedule", "observe"),
    "conflicts": ("schedule", "conflicts"),
    "messages": ("roles", "*", "messages"),
    "deterministic": ("seeds", "deterministic"),
    "horizon": ("schedule", "horizon"),
    "reward": ("rewards",),
    "endings": ("endings",),
    "symmetric": ("roles", "*", "symmetric"),
    "may_join": ("roles", "*", "may_join"),
    "may_leave": ("roles", "*", "may_leave"),
}
"""Place of a contract that declares a key of `measured`; `*`: each name."""
BY_AGENT: Final = "by_agent"
COLUMNS: Final = {"least": "min reward", "most": "max reward", "open": "not ended"}
"""Names of columns that are more than their key."""
LEFT_OUT: Final = ("positive", "negative")
"""Figures by agent that only the JSON document has."""
SPOKEN: Final = {"zero_sum": "zero-sum", "after_end": "after the end"}
"""Keys that are shown in other words; names of agents and roles stay."""
LABELS: Final = {
    "deterministic": "deterministic by its seed",
    "legality": "actions change others' masks",
    "order_sensitive": "order of actions matters",
}
"""Rows of the table whose label is more than their key."""
ORDER_MATTERS: Final = {
    "none": "no difference seen",
    "draws": "only in which random numbers are drawn",
    "outcome": "yes, it changes the outcome",
}
"""Effect of the order of the actions of one tick."""
FITS: Final = {
    "aec": "AEC fits",
    "parallel": "Parallel fits",
    "either": "AEC and Parallel fit alike",
}
ERRORS: Final = "The environment raised exceptions, so this was left out of the measurement"
ADVICE: Final = "AEC or Parallel"
BESIDE_DECLARED: Final = "Measured beside declared"
ALONE: Final = "Measured (nothing is declared)"
UNDECLARED: Final = "not declared"
TICK: Final = "tick: one step in which every live agent acts once."
SCHEDULE: Final = (
    'stages: roles that act together; order: of the agents of a stage ("none": all at once); '
    "observe: when observations are taken; conflicts: what settles actions that exclude each "
    'other ("joint rule": all actions together, without an order).'
)
SYMMETRIC: Final = (
    "symmetric: agents of one role seem interchangeable. p-value: how likely returns as unequal as "
    "these would be if they were; 0.01 or less counts as no."
)
MOST_COLUMNS: Final = 150
"""Characters of one value in the table; the JSON document has all of it."""


def measured_text(audit: Document, *, width: int) -> str:
    """Measured beside declared, by agent, influence of agents, the API that fits; maybe empty."""
    measured, declared = audit["measured"], audit.get("declared") or {}
    rows, missing = [], []
    for key in (key for key in measured if key not in APART):
        label, value = LABELS.get(key, key.replace("_", " ")), measured[key]
        text = _cut(_value(key, value, measured))
        stated = _declared(declared_as(declared, key), value)
        if not text and stated == UNDECLARED:
            missing.append(label)
        else:
            rows.append((label, text or unmeasured(measured, key), stated))
    if missing:
        rows.append(("not measured", f"{', '.join(missing)} (reasons: --json)", UNDECLARED))
    parts = []
    if rows:
        are_any = any(row[2] != UNDECLARED for row in rows)
        table = [("", "measured", "declared"), *rows] if are_any else [row[:2] for row in rows]
        lines = list(column_lines(table, width=width))
        legends = {"stages": SCHEDULE, "symmetric": SYMMETRIC}
        for legend in [TICK, *(text for key, text in legends.items() if measured.get(key))]:
            lines += indented(legend, width)
        parts.append("\n".join([BESIDE_DECLARED if are_any else ALONE, *lines]))
    parts.append(agents_text(measured, width=width))
    lag = lag_unit(str(audit.get("api")))
    influence = influence_text(measured.get("influence") or (), width=width, lag=lag)
    if influence and measured.get("looked_ahead"):
        text = f"Searched: 0 to {measured['looked_ahead']} {lag} later."
        influence = "\n".join([influence, *indented(text, width)])
    parts.append(influence)
    parts.append(_errors_text(measured.get("errors") or (), width=width))
    if measured.get("advice"):
        api = FITS.get(measured["advice"], measured["advice"])
        why = one_line(f"{api}: {measured.get('why', '')}".removesuffix(": "))
        parts.append("\n".join([ADVICE, *indented(why, width)]))
    return "\n\n".join(filter(None, parts))


def unmeasured(measured: Document, key: str) -> str:
    """`not measured`, with the reason where the audit has one."""
    why = (measured.get("not_measured") or {}).get(key)
    return f"not measured: {one_line(str(why))}" if why else "not measured"


def _errors_text(errors: Sequence[Document], *, width: int) -> str:
    """Exceptions of the environment while it was measured, a line each; empty without any."""
    lines = [ERRORS] if errors else []
    for each in errors:
        text = f"{each['during']}, in {each['episodes']} episodes: {one_line(each['error'])}"
        lines += indented(text, width)
    return "\n".join(lines)


def _declared(declared: Any, measured: Any) -> str:
    """A declaration in words, marked where it is another than a measured word or number."""
    text = _cut(words(declared)) or UNDECLARED
    is_plain = isinstance(measured, str | int) and type(measured) is type(declared)
    return f"{text} (differs)" if is_plain and measured != declared else text


def _value(key: str, value: Any, measured: Document) -> str:
    if key == "order_sensitive":
        text, ticks = ORDER_MATTERS.get(str(value), ""), measured.get("order_ticks")
        return f"{text} in {ticks:,} ticks" if value == "none" and ticks else text
    if key == "horizon" and measured.get("near_limits"):
        return near_horizon(measured)
    if key in ("may_join", "may_leave") and value == []:
        return (
            "no agent came later"
            if key == "may_join"
            else "no agent left without being terminated or truncated"
        )
    if key == "stages" and value:
        return ", then ".join(" and ".join(stage) for stage in value)
    return words(value)


def near_horizon(measured: Document) -> str:
    """The measured horizon beside what is called like a limit and misses it; empty without such."""
    near = [f"{name} is {limit}" for name, limit in (measured.get("near_limits") or {}).items()]
    return f"{measured.get('horizon')}, though {', '.join(near)}" if near else ""


def agents_text(measured: Document, *, width: int) -> str:
    """Measured figures of each of the first agents, a row each; empty if there are none."""
    by_agent = measured_by_agent(measured)
    fields = dict.fromkeys(key for row in by_agent.values() for key in row)
    shown = [key for key in fields if key not in LEFT_OUT]
    if not shown:
        return ""
    rows = [("agent", *(COLUMNS.get(key) or key.replace("_", " ") for key in shown))]
    found = [(name, *(words(row.get(key)) for key in shown)) for name, row in by_agent.items()]
    firsts = [row.get(shown[0]) for row in by_agent.values()]
    values = [float(each) if isinstance(each, int | float) else None for each in firsts]
    right = range(1, len(shown) + 1)
    table = [*rows, *crowd_rows(found, values, words)]
    lines = list(table_lines(table, width=max(width, 60), right=right))
    return "\n".join(["Measured by agent", *lines])


def measured_by_agent(measured: Document) -> dict[str, dict[str, Any]]:
    """All figures that were measured for each agent, by agent and name."""
    found: dict[str, dict[str, Any]] = {}
    for each in measured.values():
        table = each.get(BY_AGENT) if isinstance(each, Mapping) else None
        for agent, row in table.items() if isinstance(table, Mapping) else ():
            found.setdefault(agent, {}).update(row)
    return found


def declared_as(declared: Document, key: str) -> Any:
    """The declaration of a measured key; None where the contract has none."""
    value = _at(declared, DECLARED[key]) if key in DECLARED else None
    return None if value == {} else value


def _at(declared: Any, path: Sequence[str]) -> Any:
    for place, key in enumerate(path):
        if not isinstance(declared, Mapping):
            return None
        if key == "*":
            inner = {name: _at(each, path[place + 1 :]) for name, each in declared.items()}
            return {name: value for name, value in inner.items() if value is not None}
        declared = declared.get(key)
    return declared


def words(value: Any) -> str:
    """A measured or declared value in words, without figures that other tables have."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        sentence = _sentence(value)
        if sentence is not None:
            return sentence
        inner = [_pair(str(name), each) for name, each in value.items() if name != BY_AGENT]
        return "; ".join(filter(None, inner))
    if isinstance(value, list | tuple):
        return ", ".join(filter(None, map(_inner, value))) or "none"
    return one_line(str(value))


def _sentence(value: Document) -> str | None:
    """A measured value that has a sentence of its own; None for any other table."""
    return next((say(value) for key, say in SENTENCES.items() if key in value), None)


def _symmetry(value: Document) -> str:
    episodes = f", {value['n']} episodes" if "n" in value else ""
    seems = "seems so" if value["seems"] else "seems not"
    p = "" if value.get("p") is None else f", permutation test, {p_text(value['p'])}"
    return f"{seems}{p}{episodes}" + (f": {value['why']}" if value.get("why") else "")


def _message(value: Document) -> str:
    """A role's action as a message or as more, the roles that observe it, and the looks."""
    if not value["message"]:
        more = "its actions change more than what others observe"
        why = more if value["to"] else "no effect on what others observe was seen"
        return f"none ({why}; {value['n']:,} comparisons)"
    return f"its action is a message to {words(value['to'])} ({value['n']:,} comparisons)"


def _payments(value: Document) -> str:
    """Rewards: the same for all agents or not, summing to zero or not."""
    parts = []
    for key, yes, no in (
        ("shared", "the same for all agents", "not the same for all agents"),
        ("zero_sum", "sums to 0 over the agents", "doesn't sum to 0 over them"),
    ):
        if value.get(key) is not None:
            parts.append(yes if value[key] else no)
    if "n" in value:
        parts.append(f"{value['n']:,} env steps had a reward other than 0")
    return "; ".join(parts)


def _lengths(value: Document) -> str:
    """Number of episodes that ended by themselves, and their length in ticks."""
    text = f"{value.get('ended', 0)} of {value['episodes']} episodes ended by themselves"
    told = value.get("kinds") or ()
    by_agent = _by_agent(value)
    counted = {key: any(each.get(key) for each in by_agent) for key in FLAGS.values()}
    beside = {kind: "" if counted[key] or not by_agent else BESIDE for kind, key in FLAGS.items()}
    kinds = [f"{end['kind']} of {_owner(end['owner'])}{beside[end['kind']]}" for end in told]
    both = value.get("both") or 0
    missed = set(FLAGS) - {end["kind"] for end in told} if told and not both else ()
    kinds += [f"{kind} (owner not measured)" for kind in sorted(missed) if counted[FLAGS[kind]]]
    text = ": ".join(filter(None, [", ".join(kinds), text]))
    text += f", {both} of them terminated and truncated at once" if both else ""
    ticks = value.get("ticks")
    if not isinstance(ticks, Mapping):
        return text
    least, median, most = (words(ticks.get(key)) for key in ("least", "median", "most"))
    span = f"{least}" if least == most else f"{least} to {most} (median {median})"
    return f"{text}, after {span} ticks"


FLAGS: Final = {"termination": "terminated", "truncation": "truncated"}
"""Kinds of endings, by the keys that count them."""
BESIDE: Final = " (in other episodes)"


def _by_agent(value: Document) -> Sequence[Document]:
    table = value.get(BY_AGENT)
    return tuple(table.values()) if isinstance(table, Mapping) else ()


def _owner(owner: str) -> str:
    return "one agent" if owner == "agent" else owner


SENTENCES: Final[Mapping[str, Callable[[Document], str]]] = {
    "seems": _symmetry,
    "message": _message,
    "shared": _payments,
    "episodes": _lengths,
}
"""Sentences for measured values, by a key that only such a value has."""


def _pair(name: str, value: Any) -> str:
    """A name and its value; of a declared term or ending its kind is enough."""
    if isinstance(value, Mapping) and isinstance(value.get("kind"), str):
        return f"{name} ({value['kind']})"
    text = _inner(value)
    return f"{SPOKEN.get(name, name)}: {text}" if text else ""


def _inner(value: Any) -> str:
    text = words(value)
    is_nested = isinstance(value, list | tuple) or (
        isinstance(value, Mapping) and _sentence(value) is None
    )
    return f"({text})" if is_nested and text else text


def _cut(text: str) -> str:
    """The beginning of a long text, up to the end of a word."""
    return textwrap.shorten(text, MOST_COLUMNS, placeholder=" ...", break_on_hyphens=False)
