"""What made a run fail, and who brings what: diagnosis and attribution in one section."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gamekeeper.report.page.attribution import attribution_blocks
from gamekeeper.report.page.data import Block, Section
from gamekeeper.report.page.diagnosis import diagnosis_blocks

Document = Mapping[str, Any]


def causes_section(
    diagnosis: Document | None, attribution: Document | None, *, key: str
) -> Section:
    """What made the run fail, and who brings what; without either, how to have it.

    Args:
        diagnosis: the document of `gamekeeper diagnose`.
        attribution: that of `gamekeeper attribute`.
        key: the letter of the run.
    """
    blocks: list[Block] = []
    blocks += diagnosis_blocks(diagnosis, key=key) if diagnosis is not None else [
        Block(title="Diagnosis", notes=("Not made: `gamekeeper diagnose RUN`.",))
    ]  # fmt: skip
    blocks += attribution_blocks(attribution) if attribution is not None else [
        Block(title="Attribution", notes=("Not made: `gamekeeper attribute RUN`.",))
    ]  # fmt: skip
    return Section("causes", "Causes and contributions", tuple(blocks))
