"""A page put where a user wants it: what lies there is lost only if it is a page too."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import replace, system_error

DOCTYPE: Final = b"<!doctype html>"


def put(target: Path, page: bytes) -> None:
    """The page is there, in place of an earlier one; a device or a pipe is written to.

    Raises:
        BundleError: a file lies there that is no page, or the disk refuses.
    """
    if target.exists() and not target.is_file():  # whatever it is, nothing takes its place
        try:
            target.write_bytes(page)
        except OSError as error:
            raise system_error(f"writing {target.name}", target, error) from error
        return
    if not _is_free(target):
        raise BundleError(
            "a file lies where the report should go", where=str(target),
            expected="a new name, or that of an earlier page", seen="a file that is no page",
            mend="name another one with --out, or move it away first",
        )  # fmt: skip
    replace(target.resolve(), page, durable=False)


def _is_free(target: Path) -> bool:
    try:
        with target.open("rb") as file:
            begun = file.read(len(DOCTYPE))
    except OSError:  # not there, or not to be read: then replacing says why
        return True
    return begun.lower() in (DOCTYPE, b"")
