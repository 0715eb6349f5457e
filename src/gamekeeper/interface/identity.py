"""Identity of an environment, as evidence keeps it so that another process can open it."""

import functools
import inspect
import json
import platform
import weakref
from collections.abc import Iterable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from gamekeeper.episodes.canonical import to_json
from gamekeeper.errors import SpecError
from gamekeeper.interface.distributions import normal_name, owner_of, requirements, version_of
from gamekeeper.interface.env_source import APIS, Env, Source, api_of

_IN_MEMORY: Final = {"object": "an object", "factory": "a callable"}
"""Kinds of environments that no text can open again."""
_FRAMEWORKS: Final = ("numpy", "gymnasium", "pettingzoo")
_NOT_ITS_OWN: Final = (
    "pettingzoo.utils.",
    "gymnasium.",
    "numpy.",
    "gamekeeper.interface.",
    "typing",
)
"""Modules whose classes an environment inherits without being defined in them."""


def identity_of(source: Source, env: Env, kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """The identity of an environment as JSON.

    `kind` and `entry_point` say where it came from, without anything of this machine (where a file
    lay stands in `path`); `name` is its metadata's; `api` the one it is used with; `kwargs` in
    canonical JSON, of an object those that it was built with, as far as they are known
    (`arguments`: "assumed" where the class's defaults are taken for them); `lost` what to add where
    no text opens it again; `versions` of Python, NumPy, Gymnasium, PettingZoo, the distribution
    that owns it, and what that one requires; `source_digest` the blake2b of the files that define
    it, None where there are no files.
    """
    metadata = getattr(env, "metadata", None)
    name = metadata.get("name") if isinstance(metadata, dict) else None
    return {
        "kind": source.kind,
        "entry_point": source.entry_point,
        "name": name if isinstance(name, str) else None,
        "api": api_of(env),
        "kwargs": json.loads(to_json(dict(kwargs))),
        "versions": _versions(source, env),
        "source_digest": source_digest(
            (source.accepts or source.factory, *class_of(env).__mro__),
            files=(source.facts["path"],) if "path" in source.facts else (),
        ),
        **source.facts,
    }


def spec_of(identity: Mapping[str, Any]) -> str:
    """The text that opens the environment of an identity, with its API in front.

    Raises:
        SpecError: the identity is damaged, or is that of an object or a factory in memory, or of an
            imported data set.
    """
    given = identity if isinstance(identity, Mapping) else {}  # it may come from a damaged file
    kind, entry_point, api = (given.get(key) for key in ("kind", "entry_point", "api"))
    if not (isinstance(kind, str) and isinstance(entry_point, str) and entry_point and api in APIS):
        raise SpecError(
            "the identity of an environment is damaged",
            expected="texts under 'kind' and 'entry_point', 'aec' or 'parallel' under 'api'",
            actual=repr(identity)[:200],
            fix="name the environment yourself",
        )
    if given.get("imported"):
        raise SpecError(
            "an imported data set holds neither environment nor policies, so it can't be played",
            actual=entry_point,
            fix="show, query, report and audit RUN read what it holds; diagnose and attribute play "
            "what you name: --env ENV --policy POLICY (env=, policies=)",
        )
    if kind in _IN_MEMORY:
        raise SpecError(
            f"the environment was handed over in memory, as {_IN_MEMORY[kind]}",
            actual=entry_point,
            fix=str(identity.get("lost") or "hand it over again, or name it as module:factory"),
        )
    path = identity.get("path")
    if kind == "file" and isinstance(path, str) and path:
        entry_point = f"{path}:{entry_point.rpartition(':')[2]}"
    return f"{api}:{entry_point}"


def _versions(source: Source, env: Env) -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in _FRAMEWORKS:
        # Unknown where it is used from a source tree that nothing installed.
        versions[name] = version_of(name) or "unknown"
    module = "" if source.kind == "file" else class_of(env).__module__
    owner = owner_of(module) if module else None
    if owner is not None:
        versions[normal_name(owner.name)] = owner.version
        versions |= requirements(owner, source.extra)
    return dict(sorted(versions.items()))


def source_digest(parts: Iterable[object], *, files: Iterable[str] = ()) -> str | None:
    """The blake2b of the files that define some callables, and of more files; None without any.

    Where the files lie doesn't count. Of an instance its class counts, of a partial what it calls.
    """
    found = set(files)
    for part in parts:
        found |= _file_of(part)
    digests = sorted(digest for file in found if (digest := _digest(file)) is not None)
    return blake2b(b"".join(digests), digest_size=16).hexdigest() if digests else None


def _file_of(part: Any) -> set[str]:
    while isinstance(part, functools.partial):
        part = part.func
    if not (inspect.isclass(part) or inspect.isroutine(part)):
        part = type(part)
    if f"{getattr(part, '__module__', None)}.".startswith(_NOT_ITS_OWN):
        return set()
    try:
        found = inspect.getsourcefile(inspect.unwrap(part))
    except (TypeError, OSError):  # builtins and classes typed at a prompt have no file
        return set()
    return {found} if found else set()


def _digest(file: str) -> bytes | None:
    try:
        return blake2b(Path(file).read_bytes(), digest_size=32).digest()
    except OSError:
        return None


def class_of(env: Env) -> type:
    """The class that has the rules; of an environment of another shape, the guest's own."""
    try:
        inner = env.unwrapped
        guest = getattr(inner, "guest", inner)
        return type(getattr(guest, "unwrapped", guest))
    except Exception:  # a wrapper of the environment's own that keeps no such attribute
        return type(env)


# The one state of this room. Keyed by id, because an environment may define equality; an entry goes
# with its environment.
_ORIGINS: Final[dict[int, dict[str, Any]]] = {}


def remember(env: object, identity: dict[str, Any]) -> None:
    """Notes the identity that `env` was opened under; one that can't be referred to isn't noted."""
    try:
        weakref.finalize(env, _ORIGINS.pop, id(env), None).atexit = False
    except TypeError:  # a class with slots and no place for a reference
        return
    _ORIGINS[id(env)] = identity


def origin_of(env: object) -> dict[str, Any] | None:
    """The identity that `env` was opened under by `gk.make`, or None."""
    return _ORIGINS.get(id(env))
