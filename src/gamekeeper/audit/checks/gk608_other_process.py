"""GK608."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.played_twice import parted, program, settled_by_seed, told_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK608",
    needs=("other_process",),
    severity=HIGH,
    mend="sort a set before its order matters (agents, items, draws), and derive nothing from "
    "hash(), id(), the process's number or the clock",
    applies=settled_by_seed,
)
def other_processes_play_the_same(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The same seed and actions give the same play in other processes; no set's order decides.

    Python shuffles the order of sets of text anew in every process, so that results repeat within
    one run and never in the next. The other process runs under another PYTHONHASHSEED.

    Bad: `agents` in the order of a set.

    ```python
    self.agents = list({*self.hunters, *self.prey})
    ```

    Good:

    ```python
    self.agents = [*self.hunters, *self.prey]
    ```
    """
    for look in evidence.looks.get("other_process", ()):
        seed = next((fact.value for fact in look.facts if fact.name == "hash seed"), None)
        for twin in look.twins:
            proof = _proof(evidence.api, seed, told_of(contract, twin))
            yield from parted(twin, proof, expected="the same play as in this process")


def _proof(api: str, seed: int | None, tells: frozenset[str]) -> Proof:
    """Starts itself again under hash seeds, each of which prints its play."""
    return program(
        api,
        'if "HASHED" in os.environ:',
        "    print(play(make()))",
        "    sys.exit()",
        "def played(hash_seed):",
        '    surroundings = {**os.environ, "HASHED": "1", "PYTHONHASHSEED": str(hash_seed)}',
        "    again = [sys.executable, *sys.orig_argv[1:]]",
        "    return subprocess.run(again, env=surroundings, capture_output=True).stdout",
        f"assert len({{played(hash_seed) for hash_seed in ({seed}, 11, 12, 13, 14, 15)}}) == 1",
        tells=tells,
        imports=("os", "subprocess", "sys"),
    )
