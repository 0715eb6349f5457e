"""What somebody who can write the files can do: change them, and seal the bundle again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.record.files.folder import digest_file
from gamekeeper.record.files.manifest import MANIFEST, manifest_digest, render


def reseal(run: Path, **entries: Any) -> None:
    """Puts entries into the manifest of a sealed bundle and makes the seal fit."""
    path = run / MANIFEST
    manifest = {**json.loads(path.read_text(encoding="utf-8")), **entries}
    manifest["seal"]["manifest"] = manifest_digest(manifest)
    path.write_bytes(render(manifest))


def reseal_table(run: Path, name: str, table: pa.Table) -> None:
    """Puts another table into the place of a sealed bundle's, and makes the seal fit."""
    file = run / f"{name}.parquet"
    pq.write_table(table, file)
    size, digest = digest_file(file)
    files = json.loads((run / MANIFEST).read_text(encoding="utf-8"))["seal"]["files"]
    reseal(run, seal={"files": {**files, file.name: {"digest": digest, "size": size}}})
