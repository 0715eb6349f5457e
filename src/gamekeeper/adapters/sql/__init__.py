"""SQL over bundles by DuckDB: read-only, with no way out of the folders that were named."""

from __future__ import annotations

from gamekeeper.adapters.sql.rows import Rows
from gamekeeper.adapters.sql.session import Session, query

__all__ = ["Rows", "Session", "query"]
