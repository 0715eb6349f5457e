"""Contract first, trainer after: a quick audit before the first step, once for each source."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.audit.front import audit
from gamekeeper.core.canon import to_json
from gamekeeper.errors import ContractError, SpecError
from gamekeeper.game.open import open_env

_passed: Final[dict[str, object]] = {}
"""What was audited in this process and kept its contract, by identity as JSON.

What is no text is told from others of its name by where it stands in memory, and kept there.
"""


def checked(
    spec: object, check: str | None, *, env_kwargs: Mapping[str, Any] | None = None
) -> None:
    """Audits an environment that is about to be trained on, unless that was done in this process.

    Args:
        spec: where it comes from.
        check: "quick", or None: nothing is looked at.
        env_kwargs: handed to it.
    Raises:
        SpecError: there is no such check.
        ContractError: it breaks its contract, which no trainer would notice.
    """
    if check is None:
        return
    if check != "quick":
        raise SpecError(
            "there is no such check", where="check", expected='"quick" or None', seen=check
        )
    opened = open_env(spec, **dict(env_kwargs or {}))
    opened.env.close()
    name = to_json({**opened.identity, "at": None if isinstance(spec, str) else id(spec)})
    if name in _passed:
        return
    sys.stderr.write(f"gamekeeper: audits {opened.spec} before training (check=None: doesn't)\n")
    found = audit(spec, quick=True, env_kwargs=env_kwargs)
    high = [verdict for verdict in found.broken if verdict.severity == "high"]
    if high:
        told = "; ".join(f"{verdict.id} {verdict.claim}" for verdict in high)
        raise ContractError(
            f"{opened.spec} breaks its contract",
            where=", ".join(verdict.id for verdict in high),
            expected="nothing of high severity is broken",
            seen=told[:800],
            mend=f"gamekeeper audit {opened.spec} shows how to see it again; "
            "check=None trains all the same",
        )
    for verdict in found.broken:
        sys.stderr.write(f"gamekeeper: {verdict.id} is broken: {verdict.claim}\n")
    _passed[name] = spec
