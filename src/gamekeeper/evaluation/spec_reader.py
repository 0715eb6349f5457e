"""Reading a specification from TOML or plain data: every key known, every value of its kind."""

import tomllib
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, Final, TypeVar

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.contract.toml import key_lines
from gamekeeper.contract.validation import (
    Path,
    Read,
    SourceLines,
    SourcePath,
    listed,
    nearest,
    number,
    section,
    text,
    truth,
    whole,
    word,
)
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import ContractError, EvidenceError, SpecError
from gamekeeper.evaluation.spec import (
    EVERYONE,
    Choices,
    CrossplaySpec,
    EnvironmentSpec,
    PolicySpec,
    Spec,
    StopSpec,
)
from gamekeeper.statistics.interval import AGENTS_OF_ONE_EPISODE

T = TypeVar("T")

LARGEST_BYTES: Final = 1 << 20
UNITS: Final = ("auto", "episode", "run")
RECORDS: Final = ("digest", "full")


def read_file(path: FilePath) -> Spec:
    """The specification that a TOML file holds.

    Paths in it (of contracts, of policies' files) are looked for beside it first.

    Raises:
        SpecError: it can't be read, isn't TOML, or isn't a specification; names file and key.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise SpecError(
                "the file is too large for a specification",
                where=str(path),
                expected=f"at most {LARGEST_BYTES:,} bytes",
                actual="more",
                fix="name a specification; data belong into files of their own",
            )
        written = data.decode("utf-8-sig").replace("\r\n", "\n")
        found = tomllib.loads(written)
    except OSError as error:
        raise SpecError(
            "the specification can't be opened",
            where=str(path),
            expected="a TOML file",
            actual=error.strerror or type(error).__name__,
            fix="`gamekeeper list suites` names those that come with Gamekeeper",
        ) from None
    except (ValueError, RecursionError) as error:  # also of numbers with too many digits
        raise SpecError(
            "the specification isn't TOML",
            where=str(path),
            expected="TOML 1.0",
            actual=str(error),
            fix="correct the line that is named",
        ) from None
    return read_spec(found, source=str(path), lines=key_lines(written), folder=path.parent)


def read_spec(
    data: object,
    *,
    source: str = "",
    lines: Mapping[Path, int] | None = None,
    folder: FilePath | None = None,
) -> Spec:
    """The specification that plain data holds.

    Args:
        data: as TOML gives it; policies and environments may also be objects in memory.
        source: what errors call it.
        lines: the line of each key, where it is a text.
        folder: where paths in it are looked for first.
    Raises:
        SpecError: a key is unknown, a value isn't of its key's kind, or a name stands for nothing.
    """
    at = SourcePath(SourceLines(source, lines or {}, document="specification", refusal=SpecError))
    found = dict(SECTIONS(data, at))
    for key in ("seeds", "metrics"):
        found |= found.pop(key, {})
    if "run" in found:
        found["seed"] = found.pop("run")
    spec = Spec(**found, folder=None if folder is None else str(folder))
    check_names(spec, at)
    return spec


def check_names(spec: Spec, at: SourcePath) -> None:
    """Refuses a specification whose parts name what isn't there.

    Raises:
        SpecError: there is nothing to play, or a name stands for nothing.
    """
    for key in ("environments", "policies"):
        if not getattr(spec, key):
            raise at.error(
                f"there are no {key}", expected=f"[{key}.NAME]", actual="none", fix="name one"
            )
    names = list(spec.policies)
    for position, pair in enumerate(spec.compare or ()):
        for name in pair:
            _known(name, names, at / "compare" / "pairs" / position, "policy")
    for name in spec.crossplay.partners:
        _known(name, names, at / "crossplay" / "partners", "policy")
    for name in spec.crossplay.roles:
        if name != EVERYONE:
            _known(name, list(spec.environments), at / "crossplay" / "roles", "environment")
    for name, policy in spec.policies.items():
        for environment in policy.environments:
            place = at / "policies" / name / "environments"
            _known(environment, list(spec.environments), place, "environment")
    points = [(each.curve, each.step) for each in spec.policies.values()]
    for name, policy in spec.policies.items():
        if policy.curve is not None and points.count((policy.curve, policy.step)) > 1:
            raise (at / "policies" / name / "step").error(
                "two points of a learning curve are at one step",
                expected="different steps",
                actual=policy.step,
                fix="name the runs of one step under one policy: runs = [...]",
            )
    if spec.stop is not None and spec.stop.most < spec.episodes:
        raise (at / "stop" / "most").error(
            "nothing could be played beyond the first episodes",
            expected=f"at least seeds.episodes ({spec.episodes})",
            actual=spec.stop.most,
            fix="raise stop.most, or lower seeds.episodes",
        )


def _known(name: str, known: list[str], at: SourcePath, noun: str) -> None:
    if name not in known:
        near = nearest(name, known)
        raise at.error(
            f"there is no {noun} {name!r} here",
            expected=", ".join(known),
            actual=name,
            fix=f"write '{near}'" if near else f"name one of the {noun}s, or add it",
        )


def _rows(read: Read[T]) -> Read[dict[str, T]]:
    """Reads a table by names that may also be names of files."""

    def rows(value: object, at: SourcePath) -> dict[str, T]:
        table = at.table(value)
        for name in table:
            if not name.strip() or any(sign in name for sign in "/\\\n\t"):
                raise at.error(
                    f"{name!r} can't be a name",
                    expected="a text without slashes",
                    actual=name,
                    fix="leave slashes and line breaks out",
                )
        return {name: read(item, at / name) for name, item in table.items()}

    return rows


def _table(value: object, at: SourcePath) -> dict[str, Any]:
    return dict(at.table(value))


def _success(value: object, at: SourcePath) -> dict[str, str]:
    rows = {"team": value} if isinstance(value, str) else at.table(value)
    return {scope: _condition(each, at) for scope, each in rows.items()}


def _condition(value: object, at: SourcePath) -> str:
    written = text(value, at)
    try:
        Failure(written)
    except ContractError as error:
        raise at.error(
            error.what.replace("failure ", ""),
            expected=error.expected,
            actual=written,
            fix="write a comparison, as 'undelivered == 0'",
        ) from None
    return written


def _scale(value: object, at: SourcePath) -> tuple[float, float]:
    items: list[Any] = list(value) if isinstance(value, list | tuple) else []
    numbers = [each for each in items if type(each) in (int, float)]
    if not len(numbers) == len(items) == 2 or numbers[0] == numbers[1]:
        raise at.error(
            f"'{at.text}' is no scale",
            actual=value,
            fix="write two returns: score = [0, 10]",
            expected="two different returns: what counts as 0, and what as 1",
        )
    return float(numbers[0]), float(numbers[1])


def _environment(value: object, at: SourcePath) -> EnvironmentSpec:
    return ENVIRONMENT({"spec": value} if isinstance(value, str) else value, at)


def _policy(value: object, at: SourcePath) -> PolicySpec:
    if not isinstance(value, Mapping):
        value = {"runs" if isinstance(value, list | tuple) else "policy": value}
    if not any(key in value for key in POLICY_KEYS):  # policies by role, without more around them
        value = {"policy": value}
    found = POLICY(value, at)
    inner = found.pop("environments", {})
    if (found.get("curve") is None) != (found.get("step") is None):
        raise at.error(
            "a point of a learning curve has a curve and a step",
            expected="both",
            actual="curve" if found.get("step") is None else "step",
            fix='write curve = "mappo", step = 100000',
        )
    runs, is_method = _training_runs(found, at)
    others = {name: _training_runs(row, at / "environments" / name) for name, row in inner.items()}
    if not runs and not others:
        raise at.error(
            "a policy doesn't say who plays",
            expected="policy or runs",
            actual=", ".join(at.table(value)) or "nothing",
            fix='write policy = "random"',
        )
    return PolicySpec(
        **found,
        runs=runs,
        is_method=is_method or any(several for _, several in others.values()),
        environments={name: choices for name, (choices, _) in others.items()},
    )


def _training_runs(table: dict[str, Any], at: SourcePath) -> tuple[tuple[Choices, ...], bool]:
    """Takes `policy` or `runs` out of what was read of a policy."""
    if "policy" in table and "runs" in table:
        raise at.error(
            "a policy is either one policy or several training runs",
            expected="policy or runs",
            actual="both",
            fix="leave one of them out",
        )
    if "policy" in table:
        return (table.pop("policy"),), False
    runs = table.pop("runs", ())
    for position, each in enumerate(runs):
        if each in runs[:position]:
            raise (at / "runs" / position).error(
                "one training run stands twice",
                expected="different runs",
                actual=each,
                fix="leave it out: counted twice, it makes intervals too narrow",
            )
    return runs, bool(runs)


def _choices(value: object, at: SourcePath) -> Choices:
    table = value if isinstance(value, Mapping) else {EVERYONE: value}
    if not table or any(choice is None or choice == "" for choice in table.values()):
        raise at.error(
            f"'{at.text}' names no policy",
            expected="a policy, or policies by role",
            actual=value,
            fix='write policy = "random", or { picker = "random", carrier = "noop" }',
        )
    return {agent_name(place): choice for place, choice in table.items()}


def _unit(value: object, at: SourcePath) -> str:
    if value == "agent":
        raise EvidenceError(
            "no interval over agents of one episode",
            where=at.text,
            expected=" or ".join(UNITS),
            actual=f'"agent": {AGENTS_OF_ONE_EPISODE}',
            fix="leave it out; agents are shown one by one, and by role as means per episode",
        )
    return word(*UNITS)(value, at)


def _positions(value: object, at: SourcePath) -> dict[str, tuple[str, ...]]:
    rows = value if isinstance(value, Mapping) else {EVERYONE: value}
    return {name: TEXTS(each, at) for name, each in rows.items()}


def _crossplay(value: object, at: SourcePath) -> CrossplaySpec:
    if isinstance(value, bool):
        return CrossplaySpec(enabled=value)
    return CROSSPLAY({"enabled": True, **at.table(value)}, at)


def _compare(value: object, at: SourcePath) -> tuple[tuple[str, str], ...] | None:
    return None if value == "all" else COMPARE(value, at).get("pairs")


def _pair(value: object, at: SourcePath) -> tuple[str, str]:
    names = TEXTS(value, at)
    if len(names) != 2 or names[0] == names[1]:
        raise at.error(
            f"'{at.text}' is no pair",
            expected="two different policies",
            actual=value,
            fix='write two names: ["a", "b"]',
        )
    return names[0], names[1]


def _suite(id: str, version: str = "1") -> tuple[str, str]:
    return id, version


TEXTS: Final = listed(text)
ENVIRONMENT: Final = section(
    EnvironmentSpec,
    {
        "spec": lambda value, at: value,
        "kwargs": _table,
        "version": text,
        "options": _table,
        "contract": lambda value, at: value if isinstance(value, Contract) else text(value, at),
        "success": _success,
        "most_turns": whole(1),
        "team": truth,
        "failed_return": number(float("-inf"), float("inf")),
        "score": _scale,
        "digest": text,
    },
    "spec",
    lacking="an environment doesn't say what opens it",
)
RUNS: Final[Mapping[str, Read[Any]]] = {"policy": _choices, "runs": listed(_choices, least=1)}
POLICY_KEYS: Final[Mapping[str, Read[Any]]] = {
    **RUNS,
    "version": text,
    "files": TEXTS,
    "digests": TEXTS,
    "curve": text,
    "step": whole(0),
    "environments": _rows(section(dict, RUNS)),
}
POLICY: Final[Read[dict[str, Any]]] = section(dict, POLICY_KEYS)
CROSSPLAY: Final = section(
    CrossplaySpec, {"enabled": truth, "roles": _positions, "partners": TEXTS, "sample": whole(1)}
)
STOP: Final = section(
    StopSpec,
    {
        "metric": text,
        "who": text,
        "width": number(0.0, float("inf")),
        "most": whole(1),
        "every": whole(1),
    },
    "width",
    lacking="nothing says when to stop",
)
COMPARE: Final[Read[dict[str, Any]]] = section(
    dict, {"pairs": lambda value, at: None if value == "all" else listed(_pair)(value, at)}
)
SECTIONS: Final[Read[dict[str, Any]]] = section(
    dict,
    {
        "name": text,
        "suite": section(_suite, {"id": text, "version": text}, "id", lacking="a suite has no id"),
        "environments": _rows(_environment),
        "policies": _rows(_policy),
        "seeds": section(dict, {"run": whole(0), "episodes": whole(1)}),
        "compare": _compare,
        "crossplay": _crossplay,
        "stop": STOP,
        "metrics": section(
            dict, {"infos": TEXTS, "terms": TEXTS, "unit": _unit, "level": number(0.79, 1.0)}
        ),
        "record": word(*RECORDS),
    },
)
"""The sections of a specification, and how each is read."""
