"""Reading a specification from TOML or plain data: every key known, every value of its kind."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.contract.places import nearest, path_text
from gamekeeper.core.evaluation.refusals import AGENTS_OF_ONE_EPISODE
from gamekeeper.core.layout import agent_name
from gamekeeper.errors import ContractError, EvidenceError, SpecError
from gamekeeper.evaluate import values
from gamekeeper.evaluate.spec import (
    EVERYONE,
    CrossplaySpec,
    EnvironmentSpec,
    PolicySpec,
    Spec,
    StopSpec,
)
from gamekeeper.evaluate.values import Place

LARGEST_BYTES: Final = 1 << 20
UNITS: Final = ("auto", "episode", "run")
RECORDS: Final = ("digest", "full")


def read_file(path: Path) -> Spec:
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
                "the file is too large for a specification", where=str(path),
                expected=f"at most {LARGEST_BYTES:,} bytes", seen="more",
            )  # fmt: skip
        found = tomllib.loads(data.decode("utf-8-sig"))
    except OSError as error:
        raise SpecError(
            "the specification can't be opened", where=str(path), expected="a TOML file",
            seen=error.strerror or type(error).__name__,
            mend="`gamekeeper list suites` names those that come with Gamekeeper",
        ) from None  # fmt: skip
    except (ValueError, RecursionError) as error:  # also of numbers with too many digits
        raise SpecError(
            "the specification isn't TOML", where=str(path), expected="TOML 1.0", seen=str(error)
        ) from None
    return read_spec(found, source=str(path), folder=path.parent)


def read_spec(data: object, *, source: str = "", folder: Path | None = None) -> Spec:
    """The specification that plain data holds.

    Args:
        data: as TOML gives it; policies and environments may also be objects in memory.
        source: what errors call it.
        folder: where paths in it are looked for first.
    Raises:
        SpecError: a key is unknown, a value isn't of its key's kind, or a name stands for nothing.
    """
    at = Place(source)
    top = values.table(
        data, at,
        ("name", "suite", "environments", "policies", "seeds", "compare", "crossplay", "stop",
         "metrics", "record"),
    )  # fmt: skip
    found: dict[str, Any] = {}
    if "name" in top:
        found["name"] = values.text(top["name"], at / "name")
    if "suite" in top:
        found["suite"] = _suite(top["suite"], at / "suite")
    found["environments"] = _named(top, "environments", at, _environment)
    found["policies"] = _named(top, "policies", at, _policy)
    found |= _seeds(top.get("seeds", {}), at / "seeds")
    found |= _metrics(top.get("metrics", {}), at / "metrics")
    if "record" in top:
        found["record"] = values.word(top["record"], at / "record", RECORDS)
    if "crossplay" in top:
        found["crossplay"] = _crossplay(top["crossplay"], at / "crossplay")
    if "stop" in top:
        found["stop"] = _stop(top["stop"], at / "stop")
    if "compare" in top:
        found["compare"] = _compare(top["compare"], at / "compare")
    spec = Spec(**found, folder=None if folder is None else str(folder))
    check_names(spec, source)
    return spec


def check_names(spec: Spec, source: str = "") -> None:
    """Refuses a specification whose parts name what isn't there.

    Raises:
        SpecError: there is nothing to play, or a name stands for nothing.
    """
    at = Place(source)
    for key in ("environments", "policies"):
        if not getattr(spec, key):
            raise at.error(
                f"there are no {key}", expected=f"[{key}.NAME]", seen="none", mend="name one"
            )
    names = list(spec.policies)
    for number, pair in enumerate(spec.compare or ()):
        for name in pair:
            _known(name, names, at / "compare" / "pairs" / number, "policy")
    for name in spec.crossplay.partners:
        _known(name, names, at / "crossplay" / "partners", "policy")
    for name in spec.crossplay.roles:
        if name != EVERYONE:
            _known(name, list(spec.environments), at / "crossplay" / "roles", "environment")
    for name, policy in spec.policies.items():
        for environment in policy.environments:
            place = at / "policies" / name / "environments"
            _known(environment, list(spec.environments), place, "environment")
    if spec.stop is not None and spec.stop.most < spec.episodes:
        raise (at / "stop" / "most").error(
            "nothing could be played beyond the first episodes",
            expected=f"at least seeds.episodes ({spec.episodes})", seen=spec.stop.most,
        )  # fmt: skip


def _known(name: str, known: list[str], at: Place, noun: str) -> None:
    if name not in known:
        near = nearest(name, known)
        raise at.error(
            f"there is no {noun} {name!r} here", expected=", ".join(known), seen=name,
            mend=f"write '{near}'" if near else "",
        )  # fmt: skip


def _named(
    top: Mapping[str, Any], key: str, at: Place, read: Callable[[Any, Place], Any]
) -> dict[str, Any]:
    rows = values.table(top.get(key, {}), at / key)
    for name in rows:
        if not name.strip() or any(sign in name for sign in "/\\\n\t"):
            raise (at / key).error(
                f"{name!r} can't be a name", expected="a text without slashes", seen=name
            )
    return {name: read(value, at / key / name) for name, value in rows.items()}


def _suite(value: object, at: Place) -> tuple[str, str]:
    table = values.table(value, at, ("id", "version"))
    if "id" not in table:
        raise at.error("a suite has no id", expected="id", seen=", ".join(table))
    return values.text(table["id"], at / "id"), values.text(
        table.get("version", "1"), at / "version"
    )


def _environment(value: object, at: Place) -> EnvironmentSpec:
    known = ("spec", "kwargs", "version", "options", "contract", "success", "most_turns", "team",
             "score", "digest")  # fmt: skip
    if isinstance(value, str):
        value = {"spec": value}
    table = values.table(value, at, known)
    if "spec" not in table:
        raise at.error(
            "an environment doesn't say what opens it", expected='spec = "warehouse"',
            seen=", ".join(table) or "nothing",
        )  # fmt: skip
    spec, contract = table["spec"], table.get("contract")
    if contract is not None and not isinstance(contract, Contract):
        contract = values.text(contract, at / "contract")
    success = table.get("success", {})
    success = (
        {"team": success} if isinstance(success, str) else values.table(success, at / "success")
    )
    return EnvironmentSpec(
        spec=spec,
        kwargs=dict(values.table(table.get("kwargs", {}), at / "kwargs")),
        options=dict(values.table(table["options"], at / "options"))
        if "options" in table
        else None,
        contract=contract,
        success={scope: _condition(text, at / "success") for scope, text in success.items()},
        most_turns=values.maybe(table, "most_turns", at, values.whole),
        team=values.maybe(table, "team", at, values.truth),
        score=values.maybe(table, "score", at, _scale),
        version=values.maybe(table, "version", at, values.text),
        digest=values.maybe(table, "digest", at, values.text),
    )


def _scale(value: object, at: Place) -> tuple[float, float]:
    items: list[Any] = list(value) if isinstance(value, list | tuple) else []
    numbers = [each for each in items if type(each) in (int, float)]
    if not len(numbers) == len(items) == 2 or numbers[0] == numbers[1]:
        raise at.wrong(value, "two different returns: what counts as 0, and what as 1")
    return float(numbers[0]), float(numbers[1])


def _condition(value: object, at: Place) -> str:
    text = values.text(value, at)
    try:
        Failure(text)
    except ContractError as error:
        raise at.error(
            error.what.replace("failure ", ""), expected=error.expected, seen=text,
            mend="write a comparison, as 'undelivered == 0'",
        ) from None  # fmt: skip
    return text


def _policy(value: object, at: Place) -> PolicySpec:
    if not isinstance(value, Mapping):
        many = isinstance(value, list | tuple)
        value = {"runs": value} if many else {"policy": value}
    known = ("policy", "runs", "version", "files", "digests", "environments")
    if not any(key in value for key in known):  # policies by role, without more around them
        value = {"policy": value}
    table = values.table(value, at, known)
    runs, is_method = _runs(table, at)
    others: dict[str, tuple[Mapping[str, Any], ...]] = {}
    for name, inner in values.table(table.get("environments", {}), at / "environments").items():
        place = at / "environments" / name
        others[name], several = _runs(values.table(inner, place, ("policy", "runs")), place)
        is_method = is_method or several
    if not runs and not others:
        raise at.error(
            "a policy doesn't say who plays", expected="policy or runs",
            seen=", ".join(table) or "nothing",
        )  # fmt: skip
    return PolicySpec(
        runs=runs, is_method=is_method, environments=others,
        files=values.texts(table.get("files", ()), at / "files"),
        version=values.maybe(table, "version", at, values.text),
        digests=values.texts(table.get("digests", ()), at / "digests"),
    )  # fmt: skip


def _runs(table: Mapping[str, Any], at: Place) -> tuple[tuple[Mapping[str, Any], ...], bool]:
    if "policy" in table and "runs" in table:
        raise at.error(
            "a policy is one checkpoint or several runs", expected="policy or runs", seen="both"
        )
    if "policy" in table:
        return (_choices(table["policy"], at / "policy"),), False
    runs = table.get("runs", ())
    if not isinstance(runs, list | tuple) or ("runs" in table and not runs):
        raise (at / "runs").wrong(runs, "a list of policies, one a training run")
    found = tuple(_choices(each, at / "runs" / k) for k, each in enumerate(runs))
    for number, each in enumerate(found):
        if each in found[:number]:
            raise (at / "runs" / number).error(
                "one training run stands twice", expected="different runs", seen=runs[number],
                mend="leave it out: counted twice, it makes intervals too narrow",
            )  # fmt: skip
    return found, bool(found)


def _choices(value: object, at: Place) -> Mapping[str, Any]:
    table = value if isinstance(value, Mapping) else {EVERYONE: value}
    if not table or any(choice is None or choice == "" for choice in table.values()):
        raise at.wrong(value, "a policy, or policies by role")
    return {agent_name(whom): choice for whom, choice in table.items()}


def _seeds(value: object, at: Place) -> dict[str, Any]:
    table = values.table(value, at, ("run", "episodes"))
    found = {}
    if "run" in table:
        found["seed"] = values.whole(table["run"], at / "run", 0)
    if "episodes" in table:
        found["episodes"] = values.whole(table["episodes"], at / "episodes")
    return found


def _metrics(value: object, at: Place) -> dict[str, Any]:
    table = values.table(value, at, ("infos", "terms", "unit", "level"))
    found: dict[str, Any] = {
        key: values.texts(table[key], at / key) for key in ("infos", "terms") if key in table
    }
    if "level" in table:
        found["level"] = values.number(table["level"], at / "level", 0.79, 1.0)
    if table.get("unit") == "agent":
        raise EvidenceError(
            "no interval over agents of one episode", where=path_text((*at.path, "unit")),
            expected=" or ".join(UNITS), seen=f'"agent": {AGENTS_OF_ONE_EPISODE}',
            mend="leave it out; agents are shown one by one, and by role as means per episode",
        )  # fmt: skip
    if "unit" in table:
        found["unit"] = values.word(table["unit"], at / "unit", UNITS)
    return found


def _crossplay(value: object, at: Place) -> CrossplaySpec:
    if isinstance(value, bool):
        return CrossplaySpec(enabled=value)
    table = values.table(value, at, ("enabled", "roles", "partners", "sample"))
    roles = table.get("roles", {})
    by_environment = roles if isinstance(roles, Mapping) else {EVERYONE: roles}
    return CrossplaySpec(
        enabled=values.truth(table.get("enabled", True), at / "enabled"),
        roles={name: values.texts(each, at / "roles") for name, each in by_environment.items()},
        partners=values.texts(table.get("partners", ()), at / "partners"),
        sample=values.maybe(table, "sample", at, values.whole),
    )


def _stop(value: object, at: Place) -> StopSpec:
    table = values.table(value, at, ("metric", "who", "width", "most", "every"))
    if "width" not in table:
        raise at.error("nothing says when to stop", expected="width", seen=", ".join(table))
    found = {key: values.text(table[key], at / key) for key in ("metric", "who") if key in table}
    counts = {key: values.whole(table[key], at / key) for key in ("most", "every") if key in table}
    width = values.number(table["width"], at / "width", 0.0, float("inf"))
    return StopSpec(**found, **counts, width=width)  # type: ignore[arg-type]  # by their keys


def _compare(value: object, at: Place) -> tuple[tuple[str, str], ...] | None:
    if value == "all":
        return None
    table = values.table(value, at, ("pairs",))
    pairs = table.get("pairs", "all")
    if pairs == "all":
        return None
    if not isinstance(pairs, list | tuple):
        raise (at / "pairs").wrong(pairs, 'pairs of policies, or "all"')
    found = []
    for number, pair in enumerate(pairs):
        names = values.texts(pair, at / "pairs" / number)
        if len(names) != 2 or names[0] == names[1]:
            raise (at / "pairs" / number).wrong(pair, "two different policies")
        found.append((names[0], names[1]))
    return tuple(found)
