"""`gk.vector.make`: copies of one environment, stepped together by the engine that is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any, Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import Layout
from gamekeeper.errors import SpecError
from gamekeeper.game.converting.slim import slim
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import Opened, open_env
from gamekeeper.vector.block import AUTORESETS, Autoreset
from gamekeeper.vector.env import Seen, VectorEnv
from gamekeeper.vector.form import Form, form_of
from gamekeeper.vector.rows import Recording, SlotSink
from gamekeeper.vector.serial import SerialEngine

ENGINES: Final = ("serial", "process", "kernel")


def make(
    spec: object,
    num_envs: int,
    *,
    engine: str = "serial",
    autoreset: Autoreset = "same_step",
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    workers: int = 2,
    threads: int = 1,
    contract: Contract | str | PathLike[str] | None = None,
    infos: bool = False,
    copy: bool = True,
    timeout_s: float = 60.0,
    on_failure: str = "stop",
) -> VectorEnv:
    """Copies of one environment, stepped together; the same results from every engine.

    Slot i plays the episodes i, i + num_envs, ... of the run, episode k from
    `episode_seed(seed, k)`, so that results don't depend on engine or workers.

    Args:
        spec: where the environment comes from; a text, or a factory.
        num_envs: how many copies.
        engine: `serial`: in this process. `process`: in `workers` processes. `kernel`: compiled.
        autoreset: `same_step` or `next_step`, as Gymnasium has them.
        seed: of the run; `reset(seed=...)` takes another.
        env_kwargs: handed to the factory, a copy for each instance.
        workers: processes of the `process` engine.
        threads: of the `kernel` engine; small batches take one.
        contract: names roles and masks; None: what lies beside the environment.
        infos: also hand out each agent's info at every step, in `infos["agents"]`.
        copy: False: arrays are the engine's own, overwritten by the next step.
        timeout_s: a worker that gives no sign of life for so long has hung.
        on_failure: `stop`: an environment that raises, dies or hangs ends it all. `go_on`: the
            others go on without the copies of that worker.
    Raises:
        SpecError: nothing can be opened under that name, its spaces have no fixed shape, or an
            option isn't known; `kernel`: it has none, or one that plays it otherwise.
    """
    counts = {"num_envs": num_envs, "workers": workers, "threads": threads}
    _check(engine, autoreset, on_failure, **counts)
    kwargs = dict(env_kwargs or {})
    opened = open_env(spec, **kwargs)
    if opened.make is None:
        raise SpecError(
            "one environment can't be many",
            where="spec",
            expected="a name or a factory, which builds a new instance at every call",
            seen=f"the object {opened.spec}",
        )
    declared = declared_contract(contract, opened)
    form, layout = seen_form(opened, declared)
    seen = Seen(opened.spec, getattr(opened.env, "metadata", {}), opened.identity, declared, layout)
    options: dict[str, Any] = {
        "num_envs": num_envs, "seed": seed, "autoreset": autoreset, "copy": copy, "seen": seen,
    }  # fmt: skip
    if engine == "process":
        from gamekeeper.vector.process import ProcessEngine

        opened.env.close()
        many = ProcessEngine(
            spec, kwargs, form, declared, num_envs=num_envs, workers=workers, autoreset=autoreset,
            wants_infos=infos, timeout_s=timeout_s, goes_on=on_failure == "go_on",
        )  # fmt: skip
        return VectorEnv(many, form, **options)
    if engine == "kernel":
        from gamekeeper.vector.kernel import KernelEngine, kernel_of, leaves_in_turn  # loads Numba

        batch = KernelEngine(
            kernel_of(opened.env), form, num_envs=num_envs, autoreset=autoreset,
            wants_infos=infos, layout=layout, threads=threads, debug=bool(kwargs.get("debug")),
            in_turn_first=leaves_in_turn(opened.env),
        )  # fmt: skip
        return VectorEnv(batch, form, **options)
    doors = [slim(opened.env), *(slim(opened.make()) for _ in range(num_envs - 1))]
    here = SerialEngine(doors, form, autoreset=autoreset, wants_infos=infos)
    return VectorEnv(here, form, **options)


def seen_form(opened: Opened, contract: Contract | None) -> tuple[Form, Layout]:
    """The form of an open environment and the columns of its evidence; it is reset for them."""
    terms = () if contract is None else tuple(contract.rewards)
    shelf = Recording(terms=terms).shelf(lambda batches: None)
    given: Any = game_of(opened.env, sink=SlotSink(shelf)).reset(seed=0)
    infos = given[1] if opened.api == "parallel" else opened.env.infos
    return form_of(opened.env, opened.api, contract, infos), shelf.layout


def _check(engine: str, autoreset: str, on_failure: str, **counts: int) -> None:
    for name, value, known in (
        ("engine", engine, ENGINES),
        ("autoreset", autoreset, AUTORESETS),
        ("on_failure", on_failure, ("stop", "go_on")),
    ):
        if value not in known:
            raise SpecError(
                f"there is no such {name}", where=name, expected=" or ".join(known), seen=value
            )
    for name, count in counts.items():
        if type(count) is not int or count < 1:
            raise SpecError(
                f"{name} is no number of them", where=name, expected="1 or more", seen=repr(count)
            )
