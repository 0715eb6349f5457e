"""Reading a specification from TOML or plain data: every key known, every value of its kind."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.contract.places import nearest, path_text, shown
from gamekeeper.core.evaluation.refusals import AGENTS_OF_ONE_EPISODE
from gamekeeper.errors import ContractError, EvidenceError, SpecError
from gamekeeper.evaluate.spec import (
    EVERYONE,
    CrossplaySpec,
    EnvironmentSpec,
    PolicySpec,
    Spec,
    StopSpec,
)

LARGEST_BYTES: Final = 1 << 20
UNITS: Final = ("auto", "episode", "run")
RECORDS: Final = ("digest", "full")


class Place:
    """Where in a specification a value stands, for errors that say so."""

    def __init__(self, source: str, path: tuple[str | int, ...] = ()) -> None:
        self.source, self.path = source, path

    def __truediv__(self, key: str | int) -> Place:
        return Place(self.source, (*self.path, key))

    def error(self, what: str, *, expected: str, seen: object, mend: str = "") -> SpecError:
        """An error that names this place."""
        where = ", ".join(part for part in (self.source, path_text(self.path)) if part)
        return SpecError(what, where=where, expected=expected, seen=shown(seen), mend=mend)

    def wrong(self, value: object, expected: str) -> SpecError:
        """An error for a value that isn't of its key's kind."""
        return self.error(f"'{path_text(self.path)}' can't be read", expected=expected, seen=value)


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
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
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
    top = _table(
        data, at,
        ("name", "suite", "environments", "policies", "seeds", "compare", "crossplay", "stop",
         "metrics", "record"),
    )  # fmt: skip
    found: dict[str, Any] = {}
    if "name" in top:
        found["name"] = _text(top["name"], at / "name")
    if "suite" in top:
        found["suite"] = _suite(top["suite"], at / "suite")
    found["environments"] = _named(top, "environments", at, _environment)
    found["policies"] = _named(top, "policies", at, _policy)
    found |= _seeds(top.get("seeds", {}), at / "seeds")
    found |= _metrics(top.get("metrics", {}), at / "metrics")
    if "record" in top:
        found["record"] = _word(top["record"], at / "record", RECORDS)
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


def _table(value: object, at: Place, known: tuple[str, ...] | None = None) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise at.wrong(value, "a table of names and values")
    for key in value if known is not None else ():
        if key not in (known or ()):
            near = nearest(key, known or ())
            inside = f"in [{path_text(at.path)}]" if at.path else "at the top"
            raise (at / key).error(
                f"{key!r} is no key {inside} of a specification", expected=", ".join(known or ()),
                seen=key, mend=f"write '{near}'" if near else "leave it out",
            )  # fmt: skip
    return value


def _named(
    top: Mapping[str, Any], key: str, at: Place, read: Callable[[Any, Place], Any]
) -> dict[str, Any]:
    rows = _table(top.get(key, {}), at / key)
    for name in rows:
        if not name.strip() or any(sign in name for sign in "/\\\n\t"):
            raise (at / key).error(
                f"{name!r} can't be a name", expected="a text without slashes", seen=name
            )
    return {name: read(value, at / key / name) for name, value in rows.items()}


def _text(value: object, at: Place) -> str:
    if not isinstance(value, str) or not value.strip():
        raise at.wrong(value, "text in quotes")
    return value


def _texts(value: object, at: Place) -> tuple[str, ...]:
    if not isinstance(value, list | tuple):
        raise at.wrong(value, "a list of texts")
    return tuple(_text(each, at / number) for number, each in enumerate(value))


def _word(value: object, at: Place, allowed: tuple[str, ...]) -> str:
    if value not in allowed:
        near = nearest(value, allowed)
        raise at.error(
            f"'{path_text(at.path)}' can't be {shown(value)}", expected=" or ".join(allowed),
            seen=value, mend=f"write '{near}'" if near else "",
        )  # fmt: skip
    return str(value)


def _whole(value: object, at: Place, least: int = 1) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise at.wrong(value, f"a whole number from {least} on")
    return value


def _truth(value: object, at: Place) -> bool:
    if not isinstance(value, bool):
        raise at.wrong(value, "true or false")
    return value


def _number(value: object, at: Place, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low < value < high:
        raise at.wrong(value, f"a number between {low:g} and {high:g}")
    return float(value)


def _suite(value: object, at: Place) -> tuple[str, str]:
    table = _table(value, at, ("id", "version"))
    if "id" not in table:
        raise at.error("a suite has no id", expected="id", seen=", ".join(table))
    return _text(table["id"], at / "id"), _text(table.get("version", "1"), at / "version")


def _environment(value: object, at: Place) -> EnvironmentSpec:
    known = ("spec", "kwargs", "version", "options", "contract", "success", "most_turns", "team",
             "score", "digest")  # fmt: skip
    if isinstance(value, str):
        value = {"spec": value}
    table = _table(value, at, known)
    if "spec" not in table:
        raise at.error(
            "an environment doesn't say what opens it", expected='spec = "warehouse"',
            seen=", ".join(table) or "nothing",
        )  # fmt: skip
    spec, contract = table["spec"], table.get("contract")
    if contract is not None and not isinstance(contract, Contract):
        contract = _text(contract, at / "contract")
    success = table.get("success", {})
    success = {"team": success} if isinstance(success, str) else _table(success, at / "success")
    return EnvironmentSpec(
        spec=spec,
        kwargs=dict(_table(table.get("kwargs", {}), at / "kwargs")),
        options=dict(_table(table["options"], at / "options")) if "options" in table else None,
        contract=contract,
        success={scope: _condition(text, at / "success") for scope, text in success.items()},
        most_turns=_maybe(table, "most_turns", at, _whole),
        team=_maybe(table, "team", at, _truth),
        score=_maybe(table, "score", at, _scale),
        version=_maybe(table, "version", at, _text),
        digest=_maybe(table, "digest", at, _text),
    )


def _maybe(table: Mapping[str, Any], key: str, at: Place, read: Callable[[Any, Place], Any]) -> Any:
    return read(table[key], at / key) if key in table else None


def _scale(value: object, at: Place) -> tuple[float, float]:
    items: list[Any] = list(value) if isinstance(value, list | tuple) else []
    numbers = [each for each in items if type(each) in (int, float)]
    if not len(numbers) == len(items) == 2 or numbers[0] == numbers[1]:
        raise at.wrong(value, "two different returns: what counts as 0, and what as 1")
    return float(numbers[0]), float(numbers[1])


def _condition(value: object, at: Place) -> str:
    text = _text(value, at)
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
    table = _table(value, at, known)
    runs, is_method = _runs(table, at)
    others: dict[str, tuple[Mapping[str, Any], ...]] = {}
    for name, inner in _table(table.get("environments", {}), at / "environments").items():
        place = at / "environments" / name
        others[name], several = _runs(_table(inner, place, ("policy", "runs")), place)
        is_method = is_method or several
    if not runs and not others:
        raise at.error(
            "a policy doesn't say who plays", expected="policy or runs",
            seen=", ".join(table) or "nothing",
        )  # fmt: skip
    return PolicySpec(
        runs=runs, is_method=is_method, environments=others,
        files=_texts(table.get("files", ()), at / "files"),
        version=_maybe(table, "version", at, _text),
        digests=_texts(table.get("digests", ()), at / "digests"),
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
    return {str(whom): choice for whom, choice in table.items()}


def _seeds(value: object, at: Place) -> dict[str, Any]:
    table = _table(value, at, ("run", "episodes"))
    found = {}
    if "run" in table:
        found["seed"] = _whole(table["run"], at / "run", 0)
    if "episodes" in table:
        found["episodes"] = _whole(table["episodes"], at / "episodes")
    return found


def _metrics(value: object, at: Place) -> dict[str, Any]:
    table = _table(value, at, ("infos", "terms", "unit", "level"))
    found: dict[str, Any] = {
        key: _texts(table[key], at / key) for key in ("infos", "terms") if key in table
    }
    if "level" in table:
        found["level"] = _number(table["level"], at / "level", 0.79, 1.0)
    if table.get("unit") == "agent":
        raise EvidenceError(
            "no interval over agents of one episode", where=path_text((*at.path, "unit")),
            expected=" or ".join(UNITS), seen=f'"agent": {AGENTS_OF_ONE_EPISODE}',
            mend="leave it out; agents are shown one by one, and by role as means per episode",
        )  # fmt: skip
    if "unit" in table:
        found["unit"] = _word(table["unit"], at / "unit", UNITS)
    return found


def _crossplay(value: object, at: Place) -> CrossplaySpec:
    if isinstance(value, bool):
        return CrossplaySpec(enabled=value)
    table = _table(value, at, ("enabled", "roles", "partners", "sample"))
    roles = table.get("roles", {})
    by_environment = roles if isinstance(roles, Mapping) else {EVERYONE: roles}
    return CrossplaySpec(
        enabled=_truth(table.get("enabled", True), at / "enabled"),
        roles={name: _texts(each, at / "roles") for name, each in by_environment.items()},
        partners=_texts(table.get("partners", ()), at / "partners"),
        sample=_maybe(table, "sample", at, _whole),
    )


def _stop(value: object, at: Place) -> StopSpec:
    table = _table(value, at, ("metric", "who", "width", "most", "every"))
    if "width" not in table:
        raise at.error("nothing says when to stop", expected="width", seen=", ".join(table))
    found = {key: _text(table[key], at / key) for key in ("metric", "who") if key in table}
    counts = {key: _whole(table[key], at / key) for key in ("most", "every") if key in table}
    width = _number(table["width"], at / "width", 0.0, float("inf"))
    return StopSpec(**found, **counts, width=width)  # type: ignore[arg-type]  # by their keys


def _compare(value: object, at: Place) -> tuple[tuple[str, str], ...] | None:
    if value == "all":
        return None
    table = _table(value, at, ("pairs",))
    pairs = table.get("pairs", "all")
    if pairs == "all":
        return None
    if not isinstance(pairs, list | tuple):
        raise (at / "pairs").wrong(pairs, 'pairs of policies, or "all"')
    found = []
    for number, pair in enumerate(pairs):
        names = _texts(pair, at / "pairs" / number)
        if len(names) != 2 or names[0] == names[1]:
            raise (at / "pairs" / number).wrong(pair, "two different policies")
        found.append((names[0], names[1]))
    return tuple(found)
