"""What somebody who can write the files can do: change the manifest, and seal it again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gamekeeper.record.files.manifest import MANIFEST, manifest_digest, render


def reseal(run: Path, **entries: Any) -> None:
    """Puts entries into the manifest of a sealed bundle and makes the seal fit."""
    path = run / MANIFEST
    manifest = {**json.loads(path.read_text(encoding="utf-8")), **entries}
    manifest["seal"]["manifest"] = manifest_digest(manifest)
    path.write_bytes(render(manifest))
