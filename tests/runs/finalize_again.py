"""What somebody who can write the files can do: change them, and checksums the run again."""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.runs.files.folder import MANIFEST, digest_file
from gamekeeper.runs.files.manifest import manifest_digest, render


def finalize_again(run: Path, **entries: Any) -> None:
    """Puts entries into the manifest of a finalized run and makes the checksums fit."""
    path = run / MANIFEST
    manifest = {**json.loads(path.read_text(encoding="utf-8")), **entries}
    manifest["checksums"]["manifest"] = manifest_digest(manifest)
    path.write_bytes(render(manifest))


def finalize_again_table(run: Path, name: str, table: pa.Table) -> None:
    """Puts another table into the place of a finalized run's, and makes the checksums fit."""
    file = run / f"{name}.parquet"
    pq.write_table(table, file)
    size, digest = digest_file(file)
    checksums = json.loads((run / MANIFEST).read_text(encoding="utf-8"))["checksums"]
    checksums["files"][file.name] = {"digest": digest, "size": size}
    finalize_again(run, checksums=checksums)
