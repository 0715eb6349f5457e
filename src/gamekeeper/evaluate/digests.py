"""Digests of environments and policies: what a result was measured with, and whether it still is.

An environment's covers its entry point, API, arguments, options of its resets, and the files that
define it; its version (of the distribution that installed it) stands beside it. A policy's covers
what it is called, its version, the file that defines it, and the bytes of files that it names.
Folders, machines and versions of NumPy don't count.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.canon import to_json
from gamekeeper.errors import PolicyError
from gamekeeper.game.opening.identity import source_digest
from gamekeeper.game.opening.installed import normal_name, owner_of
from gamekeeper.game.opening.load import FILE_MODULE, split_file
from gamekeeper.game.policy import Chosen

SIZE: Final = 16
"""Bytes of a digest."""
OPENED: Final = ("entry_point", "api", "kwargs", "source_digest")
"""What of an environment's identity counts."""


def digest_of(value: Any) -> str:
    """The digest of plain data, whatever the order of its keys."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return blake2b(text.encode("utf-8", "surrogatepass"), digest_size=SIZE).hexdigest()


def environment_digest(
    identity: Mapping[str, Any], options: Mapping[str, Any] | None = None
) -> str:
    """The digest of an environment as it is opened here.

    Args:
        identity: as opening it gives, or as a manifest keeps it.
        options: of its resets.
    """
    kept = {key: identity.get(key) for key in OPENED}
    return digest_of([kept, None if options is None else to_json(dict(options))])


def environment_version(env: Any) -> str | None:
    """`mpe2 1.0.0`: the distribution that has the rules, as it is installed; None where none is."""
    inner = getattr(env, "unwrapped", env)
    guest = getattr(inner, "guest", inner)
    module = type(getattr(guest, "unwrapped", guest)).__module__
    owner = None if module.startswith(FILE_MODULE) else owner_of(module)
    return None if owner is None else f"{normal_name(owner.name)} {owner.version}"


def policy_digest(chosen: Mapping[str, Chosen], files: Iterable[str] = ()) -> str:
    """The digest of who plays.

    Args:
        chosen: policies by whom they play.
        files: more files whose bytes count.
    Raises:
        PolicyError: a file can't be read.
    """
    rows = [
        [whom, _named(one.name), one.version, source_digest([one.policy]), _file_named(one.name)]
        for whom, one in sorted(chosen.items())
    ]
    return digest_of([rows, [file_digest(name) for name in files]])


def file_digest(name: str) -> str:
    """The digest of a file's bytes.

    Raises:
        PolicyError: it can't be read.
    """
    try:
        with Path(name).expanduser().open("rb") as file:
            digest = blake2b(digest_size=SIZE)
            while chunk := file.read(1 << 20):
                digest.update(chunk)
    except OSError as error:
        raise PolicyError(
            "a file of a policy can't be read", where=name, expected="a file that can be read",
            seen=error.strerror or type(error).__name__,
        ) from None  # fmt: skip
    return digest.hexdigest()


def _named(name: str) -> str:
    """A policy's name without where its file lies."""
    file = split_file(name)
    if file is not None:
        return f"{Path(file[0]).name}:{file[1]}"
    word, colon, rest = name.partition(":")
    return f"{word}:" if colon and Path(rest).is_file() else name


def _file_named(name: str) -> str | None:
    """The digest of the file behind a word's colon (`sb3:model.zip`); None where there is none."""
    _, colon, rest = name.partition(":")
    if split_file(name) is not None or not colon:
        return None
    found = next((path for path in (rest, f"{rest}.zip") if Path(path).is_file()), None)
    return None if found is None else file_digest(found)
