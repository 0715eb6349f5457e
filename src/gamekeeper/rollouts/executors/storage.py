"""Storage that every worker reaches: a folder, or any pyarrow filesystem by its URL.

What is large goes from a worker to storage; only small receipts of it go to whoever planned the
work. A name shows either nothing or the whole of what was put there: on file systems a draft is
renamed once it is whole, and an object store (S3, GCS, Azure) shows an object only once its upload
is complete, so that there it is written under its own name at once (a rename there would be a
copy). A folder isn't put in one step: whoever puts one says so afterwards, in a receipt.
"""

import os
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import Any, Final, Self
from urllib.parse import urlsplit

from gamekeeper.errors import RunError

URL: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._=@,+-]{0,254}")
"""One part of a name; a draft's begins with a dot, so that no name can be one."""
OBJECTS: Final = ("s3", "gcs", "abfs")
"""Filesystems, by pyarrow's names, that show an object only when its upload is complete."""
CHUNK_BYTES: Final = 1 << 20


class Storage:
    """Files by name, under one root. Names are relative, their parts joined by `/`.

    Attributes:
        place: what opens it again, in any process: an absolute path or the URL.
        folder: where that is a folder of this machine, its path; None: files have to be fetched.
    """

    __slots__ = ("_files", "_is_renamed", "_root", "folder", "place")

    def __init__(
        self, files: Any, root: str, *, place: str = "", folder: Path | None = None
    ) -> None:
        """Takes a `pyarrow.fs.FileSystem` and a path in it; `Storage.at` opens one by its name."""
        self._files, self._root = files, root.rstrip("/")
        self._is_renamed = files.type_name not in OBJECTS
        self.place, self.folder = place, folder

    @classmethod
    def at(cls, place: str | os.PathLike[str]) -> Self:
        """The storage at a path or URL (`s3://bucket/runs`, `gs://...`, `file:///...`).

        A folder needn't exist yet. Credentials come from where their owner's tools look for them.

        Raises:
            RunError: pyarrow knows no such filesystem, or can't reach it.
        """
        from pyarrow import fs

        text = os.fspath(place)
        if not URL.match(text):
            folder = Path(text).absolute()
            return cls(fs.LocalFileSystem(), str(folder), place=str(folder), folder=folder)
        try:
            files, root = fs.FileSystem.from_uri(text)
        except (OSError, ValueError, NotImplementedError) as error:  # Arrow's are ValueErrors
            raise RunError(
                "the storage can't be opened",
                where=_shown(text),
                expected="a folder, or a URL that pyarrow opens: s3://, gs://, abfs://, file://",
                actual=_first_line(error),
                fix="check the URL, and that this machine may reach it",
            ) from None  # the error may quote the URL, with what is secret in it
        return cls(files, root, place=text)

    def __str__(self) -> str:
        return _shown(self.place or self._root)

    # -- single files

    def put(self, name: str, data: bytes, *, durable: bool = True) -> None:
        """The file holds `data`; whoever looks meanwhile sees what was there before.

        Args:
            durable: False where a power cut may tear it, on a folder of this machine.
        Raises:
            RunError: the name leaves the storage, or the storage refuses.
        """
        path = self._path(name)
        with self._doing("writing", name):
            if self.folder is not None:
                _put(Path(path), data, durable=durable)
            elif not self._is_renamed:
                # Ctrl-C reaches the main thread alone. There it would leave the stream in the
                # midst, and pyarrow completes an upload that is left, with what it has so far.
                # The first task only starts the thread: a pool doesn't wait for a thread whose
                # start was interrupted.
                with ThreadPoolExecutor(1) as aside:
                    aside.submit(int).result()
                    aside.submit(self._write, path, data).result()
            else:
                parent, slash, last = path.rpartition("/")
                draft = f"{parent}{slash}.{token_hex(8)}.{last}"
                self._make(parent)
                try:
                    self._write(draft, data)
                    self._files.move(draft, path)
                except BaseException:
                    with suppress(Exception):
                        self._files.delete_file(draft)
                    raise

    def get(self, name: str, *, most_bytes: int | None = None) -> bytes:
        """Bytes of a file.

        Args:
            most_bytes: what is longer isn't read; None: it may be of any length.
        Raises:
            RunError: there is no such file, it is longer, or the storage refuses.
        """
        path = self._path(name)
        with self._doing("reading", name), self._files.open_input_stream(path) as stream:
            data: bytes = stream.read(None if most_bytes is None else most_bytes + 1)
        if most_bytes is not None and len(data) > most_bytes:
            raise RunError(
                f"{name} is larger than such a file can be",
                where=str(self),
                expected=f"at most {most_bytes:,} bytes",
                actual="more",
                fix="name the storage of this run: another file lies there",
            )
        return data

    def exists(self, name: str) -> bool:
        """Tells whether a file or a folder of this name is there.

        Raises:
            RunError: the storage refuses.
        """
        from pyarrow import fs

        path = self._path(name)
        with self._doing("looking at", name):
            return bool(self._files.get_file_info(path).type != fs.FileType.NotFound)

    def names(self, folder: str = "") -> list[str]:
        """The names, without `folder` in front, of the files and folders in it, sorted.

        Raises:
            RunError: the storage refuses.
        """
        from pyarrow import fs

        path = self._path(folder) if folder else self._root
        with self._doing("listing", folder):
            found = self._files.get_file_info(fs.FileSelector(path, allow_not_found=True))
        return sorted(each.base_name for each in found if NAME.fullmatch(each.base_name))

    def delete(self, name: str) -> None:
        """Neither file nor folder of this name is there any more.

        Raises:
            RunError: the storage refuses.
        """
        from pyarrow import fs

        path = self._path(name)
        with self._doing("deleting", name):
            kind = self._files.get_file_info(path).type
            if kind == fs.FileType.Directory:
                self._files.delete_dir(path)
            elif kind != fs.FileType.NotFound:
                self._files.delete_file(path)

    # -- folders

    def put_folder(self, name: str, folder: Path) -> None:
        """Every file of `folder` is there under `name`, one after the other.

        Raises:
            RunError: the storage refuses, or a file's name can't stand in it.
        """
        for path in sorted(folder.rglob("*")):
            if path.is_dir():
                continue
            inner = f"{name}/{path.relative_to(folder).as_posix()}"
            target = self._path(inner)
            with self._doing("writing", inner):
                self._make(target.rpartition("/")[0])
                with path.open("rb") as source, self._files.open_output_stream(target) as sink:
                    shutil.copyfileobj(source, sink, CHUNK_BYTES)

    def fetch_folder(self, name: str, folder: Path) -> None:
        """Every file under `name` is in `folder`, which is made.

        Raises:
            RunError: there is no such folder, a file's name leaves it, or the storage refuses.
        """
        from pyarrow import fs

        path = self._path(name)
        with self._doing("listing", name):
            found = self._files.get_file_info(fs.FileSelector(path, recursive=True))
        folder.mkdir(parents=True, exist_ok=True)
        for each in found:
            if each.type != fs.FileType.File:
                continue
            inner = each.path[len(path) :].lstrip("/")
            self._path(f"{name}/{inner}")  # its parts are names
            target = folder / inner
            target.parent.mkdir(parents=True, exist_ok=True)
            with (
                self._doing("reading", f"{name}/{inner}"),
                self._files.open_input_stream(each.path) as source,
                target.open("wb") as sink,
            ):
                shutil.copyfileobj(source, sink, CHUNK_BYTES)

    def path_of(self, name: str) -> Path | None:
        """Path of a name on this machine; None where it has to be fetched.

        Raises:
            RunError: the name leaves the storage.
        """
        return None if self.folder is None else Path(self._path(name))

    # -- inside

    def _path(self, name: str) -> str:
        parts = name.split("/")
        if not all(NAME.fullmatch(part) for part in parts):
            raise RunError(
                "a name can't stand in storage",
                where=str(self),
                expected=f"parts like {NAME.pattern}, joined by /",
                actual=repr(name)[:200],
                fix="use letters, digits and . _ = @ , + - in names",
            )
        if self.folder is not None:
            path = self.folder
            for part in parts:
                path = path / part
                if path.is_symlink():
                    raise RunError(
                        "a link lies in storage, and may lead out of it",
                        where=str(path),
                        fix="put the file itself in the link's place, or take the link away",
                    )
        return f"{self._root}/{name}" if self._root else name

    def _make(self, folder: str) -> None:
        """The folder exists, where there are folders: object stores have only names."""
        if self._is_renamed and folder:
            self._files.create_dir(folder, recursive=True)

    def _write(self, path: str, data: bytes) -> None:
        with self._files.open_output_stream(path) as stream:
            stream.write(data)

    @contextmanager
    def _doing(self, what: str, name: str) -> Iterator[None]:
        """Turns errors of the filesystem into a RunError."""
        try:
            yield
        except RunError:
            raise
        except (OSError, ValueError, NotImplementedError) as error:
            raise RunError(
                f"{what} {name or 'the storage'} failed",
                where=str(self),
                actual=_first_line(error),
                fix="check that the storage is there, has room and lets you write; what was put "
                "before is whole, and the same command goes on from it",
            ) from error


def _put(path: Path, data: bytes, *, durable: bool) -> None:
    """Tmp, sync, rename: whoever dies at whatever moment, the name shows the whole or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{token_hex(8)}.{path.name[:200]}")
    try:
        with draft.open("xb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def _shown(place: str) -> str:
    """A place as it may be read aloud: without user, password and query."""
    if not URL.match(place):
        return place
    parts = urlsplit(place)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


def _first_line(error: BaseException) -> str:
    text = (str(error) or type(error).__name__).splitlines()[0]
    text = re.sub(r"(://)[^/\s'\"@]*@", r"\1", text)  # user and password, then the query
    return re.sub(r"(://[^\s'\"?]*)\?[^\s'\"]*", r"\1", text)[:300]
