"""Workers that outlive an audit: they fork for each task, so importing is paid for once."""

from functools import cache

import pytest

from gamekeeper.auditing import confirm, other_process
from gamekeeper.rollouts.warm_worker import WarmWorker


class KeptWorker(WarmWorker):
    """A worker that isn't ended when an audit is through with it."""

    def __exit__(self, *_: object) -> None:
        return


@cache
def confirming(hash_seed: int | None) -> KeptWorker:
    """Runs programs under a hash seed."""
    return KeptWorker(confirm.MODULES, hash_seed=hash_seed)


@cache
def playing(hash_seed: int | None) -> KeptWorker:
    """Plays elsewhere under a hash seed."""
    return KeptWorker(["gamekeeper.auditing.other_process"], hash_seed=hash_seed)


def keep_workers(patch: pytest.MonkeyPatch) -> None:
    """Audits in this process share workers."""
    patch.setattr(confirm, "WarmWorker", lambda modules, hash_seed: confirming(hash_seed))
    patch.setattr(other_process, "worker_of", lambda session, hash_seed: playing(hash_seed))
