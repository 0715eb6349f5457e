"""SQL over runs by DuckDB: read-only, and restricted to the folders that were named."""

from gamekeeper.viewing.sql.query_session import Rows, Session, query

__all__ = ["Rows", "Session", "query"]
