"""From what a user names to a live environment, and whether evidence may name it."""

import json
import weakref
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper import plugins
from gamekeeper.episodes.canonical import from_json, is_exact
from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.interface.construction import build, did_you_mean, foreign
from gamekeeper.interface.env_source import (
    APIS,
    Env,
    NotHereError,
    Opened,
    Opener,
    Source,
    api_of,
    convert,
)
from gamekeeper.interface.identity import identity_of, origin_of, spec_of
from gamekeeper.interface.registry import canonical, likely

__all__ = ["GROUP", "Opened", "distrust", "open_env", "reopen"]

GROUP: Final = "gamekeeper.openers"
BUILT_IN: Final = ("gamekeeper.interface.openers", "gamekeeper.foreign")
_USUAL_ORDER: Final = 50
_MANIFEST: Final = "manifest.json"
"""Name of the file in every folder of evidence."""


def open_env(spec: object, /, *, api: str | None = None, **kwargs: Any) -> Opened:
    """A live environment from an id, a module, a file, a factory or an object.

    `butterfly/pistonball-v6`, `mpe2.simple_spread_v3:parallel_env`, `path/to/file.py:factory`,
    `warehouse` (one of ours), a callable, an AECEnv or a ParallelEnv. `parallel:` or `aec:` in
    front of a text asks for an API as `api` does; an environment that has only the other one is
    converted. What foreign code prints goes to stderr. Without `:factory` a module's
    `parallel_env`, `env` or `make` is taken, else the only environment class defined in it.

    Args:
        spec: what to open.
        api: `aec` or `parallel`; None for what the environment is made for, parallel where it is
            for both.
        **kwargs: handed to the factory, a copy for each instance.
    Raises:
        SpecError: nothing can be opened under that name; says what was looked for and why each look
            failed.
    """
    asked, bare = _split(spec, api)
    source = _locate(bare, asked, shown=spec)
    if source.is_single and kwargs:
        raise SpecError(
            f"{source.spec} is an environment object, which takes no keyword arguments",
            where="keyword arguments",
            actual=", ".join(kwargs),
            fix="pass its class or factory instead of the object",
        )
    built = build(source, kwargs)
    native = source.default_api or api_of(built)
    env = _converted(built, asked, source)
    used = api_of(env) or ""
    prefix = "" if used == native or source.kind in ("object", "factory") else f"{used}:"
    return Opened(
        env=env,
        api=used,
        spec=f"{prefix}{source.spec}",
        identity=origin_of(env) or _identified(source, env, kwargs),
        make=None if source.is_single else _maker(source, used, kwargs, first=built),
    )


def reopen(identity: Mapping[str, Any]) -> Opened:
    """The environment that evidence names, opened anew with its arguments; ask `distrust` first.

    Raises:
        SpecError: it was an object or a factory in memory, an argument can't be rebuilt from its
            text, or it can't be opened here.
        EvidenceError: the text of an argument is damaged.
    """
    spec = spec_of(identity)
    text = json.dumps(identity.get("kwargs", {}), separators=(",", ":"))  # as canonical text is
    kwargs = from_json(text)
    if not (is_exact(text) and isinstance(kwargs, dict) and all(type(k) is str for k in kwargs)):
        raise SpecError(
            "an argument of the environment was an object that no text can build again",
            where="kwargs",
            actual=text[:200],
            fix="open the environment yourself and hand it over",
        )
    return open_env(spec, **kwargs)


def distrust(identity: Mapping[str, Any]) -> str | None:
    """Reason why evidence from elsewhere needs consent to open its environment, or None.

    Nothing of the environment runs to find out, but for the import of a module that an installed
    distribution with PettingZoo among its requirements has brought.
    """
    try:
        _, spec = _split(spec_of(identity), None)
    except SpecError as error:
        return error.what
    is_read = False
    for name, opener in _openers():
        ask: Callable[[object], str | None] | None = getattr(opener, "distrust", None)
        try:
            if not _matches(name, opener, spec):
                continue
            if ask is None:
                return f"the opener '{name}' vouches for nothing"
            with foreign(f"the opener '{name}'", where=str(spec)):
                reason = ask(spec)
        except GamekeeperError as error:
            return error.what
        if reason is not None:
            return reason
        is_read = True
    return None if is_read else f"no opener reads {spec!r}"[:200]


def _split(spec: object, api: str | None) -> tuple[str | None, object]:
    if api is not None and api not in APIS:
        raise SpecError(
            "there is no such API",
            where="api",
            expected="aec or parallel",
            actual=repr(api),
            fix="write api='aec' or api='parallel'",
        )
    if not isinstance(spec, str):
        return api, spec
    prefix, colon, rest = spec.strip().partition(":")
    if not colon or prefix not in APIS:
        return api, spec.strip()
    if api not in (None, prefix):
        raise SpecError(
            "two APIs are asked for",
            where=spec,
            expected="one",
            actual=f"{prefix} and api={api!r}",
            fix="leave one of the two out",
        )
    return prefix, rest.strip()


def _openers() -> list[tuple[str, Opener]]:
    found = plugins.load(GROUP, *BUILT_IN).found
    fitting = [(name, part) for name, part in found.items() if isinstance(part, Opener)]
    return sorted(fitting, key=lambda named: getattr(named[1], "ORDER", _USUAL_ORDER))


def _matches(name: str, opener: Opener, spec: object) -> bool:
    # A third party's opener that fails to read a text of another form is in nobody's way.
    try:
        with foreign(f"the opener '{name}'", where=""):
            return bool(opener.matches(spec))
    except SpecError as error:
        raise NotHereError(f"the opener '{name}' is broken", actual=error.what) from error


def _locate(spec: object, api: str | None, *, shown: object) -> Source:
    openers = _openers()
    misses: list[NotHereError] = []
    for name, opener in openers:
        try:
            if _matches(name, opener, spec):
                with foreign(f"the opener '{name}'", where=shown if type(shown) is str else ""):
                    return opener.locate(spec, api)
        except NotHereError as absent:
            misses.append(absent)
    if isinstance(spec, str) and _is_evidence(spec):
        raise SpecError(
            "this is a recorded run, and an environment is asked for",
            where=spec,
            expected="an environment",
            actual="the folder of a run",
            fix=f"name what it was recorded of: gamekeeper show {spec} says it",
        )
    if len(misses) == 1:
        (miss,) = misses
        raise SpecError(**miss.parts())
    raise SpecError(
        f"no environment can be found as {shown!r}",
        actual=_misses_text(misses) or f"a {type(spec).__qualname__} of another form",
        fix=did_you_mean(likely(canonical(spec)) if isinstance(spec, str) else ())
        or f"name it in one of these forms:{_forms(opener for _, opener in openers)}",
    )


def _is_evidence(text: str) -> bool:
    try:
        return (Path(text) / _MANIFEST).is_file()
    except (OSError, ValueError):  # too long, a null byte
        return False


def _forms(openers: Iterable[Opener]) -> str:
    known = plugins.load(GROUP, *BUILT_IN)
    left_out = [str(plugin) for plugin in known.broken]
    left_out += [
        f"{GROUP}: {name} is left out: it has no SYNTAX, matches and locate"
        for name, part in known.found.items()
        if not isinstance(part, Opener)
    ]
    notes = "".join(f"\n    ({note})" for note in left_out)
    return "".join(f"\n    {opener.SYNTAX}" for opener in openers) + notes


def _misses_text(misses: Iterable[NotHereError]) -> str:
    return "".join(f"\n    {miss.what}: {miss.actual}" for miss in misses)


def _converted(env: Env, api: str | None, source: Source) -> Env:
    if api is None or api == api_of(env):
        return env
    with foreign(f"converting {source.spec} to {api}", where=source.spec):
        return convert(env, api)


def _identified(source: Source, env: Env, kwargs: Mapping[str, Any]) -> dict[str, Any]:
    with foreign(f"looking at {source.spec}", where=source.spec):  # metadata may be a property
        return identity_of(source, env, kwargs)


def _maker(
    source: Source, api: str, kwargs: Mapping[str, Any], *, first: Env
) -> Callable[..., Env]:
    earlier = weakref.ref(first)

    def make(**more: Any) -> Env:
        env = build(source, {**kwargs, **more})
        if env is earlier():
            raise SpecError(
                f"{source.spec} hands out the same environment again",
                where=source.spec,
                expected="a new instance at every call",
                actual="the object of the first call",
                fix="build the environment inside the factory",
            )
        return _converted(env, api, source)

    return make
