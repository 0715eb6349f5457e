"""`gk.vector.make`: copies of one environment, stepped together by the engine that is asked for."""

from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import Layout
from gamekeeper.errors import SpecError, check_choice
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.interface.slim import slim
from gamekeeper.vector.serial_engine import SerialEngine
from gamekeeper.vector.sub_env_block import AUTORESETS, Autoreset
from gamekeeper.vector.vector_environment import SourceEnv, VectorEnv
from gamekeeper.vector.vector_form import VectorForm, form_of
from gamekeeper.vector.vector_rows import Recording, SlotSink

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
    opened, build = _opened(spec, kwargs)
    declared = declared_contract(contract, opened)
    form, layout = seen_form(opened, declared)
    seen = SourceEnv(
        opened.spec, getattr(opened.env, "metadata", {}), opened.identity, declared, layout
    )
    engine_options: dict[str, Any] = {"autoreset": autoreset, "wants_infos": infos}
    stepping: Any
    if engine == "process":
        from gamekeeper.vector.process_engine import ProcessEngine, SubEnvs

        opened.env.close()
        envs = SubEnvs(
            spec=spec, kwargs=kwargs, contract=declared, num_envs=num_envs, **engine_options
        )
        stepping = ProcessEngine(
            envs, form, workers=workers, timeout_s=timeout_s, goes_on=on_failure == "go_on"
        )
    elif engine == "kernel":
        from gamekeeper.vector.kernel_engine import KernelEngine, kernel_of, leaves_in_turn

        stepping = KernelEngine(
            kernel_of(opened.env),
            form,
            num_envs=num_envs,
            layout=layout,
            threads=threads,
            debug=bool(kwargs.get("debug")),
            in_turn_first=leaves_in_turn(opened.env),
            **engine_options,
        )
    else:
        envs_here = [slim(opened.env), *(slim(build()) for _ in range(num_envs - 1))]
        stepping = SerialEngine(envs_here, form, **engine_options)
    return VectorEnv(
        stepping, form, num_envs=num_envs, seed=seed, autoreset=autoreset, copy=copy, seen=seen
    )


def _opened(spec: object, kwargs: dict[str, Any]) -> tuple[Opened, Callable[[], Any]]:
    opened = open_env(spec, **kwargs)
    if opened.make is None:
        raise SpecError(
            "one environment can't be many",
            where="spec",
            actual=f"the object {opened.spec}",
            expected="a name or a factory, which builds a new instance at every call",
            fix="hand over what builds it, as `lambda: Env()`",
        )
    return opened, opened.make


def seen_form(opened: Opened, contract: Contract | None) -> tuple[VectorForm, Layout]:
    """The form of an open environment and the columns of its evidence; it is reset for them."""
    terms = () if contract is None else tuple(contract.rewards)
    shelf = Recording(terms=terms).shelf(lambda batches: None)
    given: Any = capture_of(opened.env, sink=SlotSink(shelf)).reset(seed=0)
    infos = given[1] if opened.api == "parallel" else opened.env.infos
    return form_of(opened.env, opened.api, contract, infos), shelf.layout


def _check(engine: str, autoreset: str, on_failure: str, **counts: int) -> None:
    for name, value, known in (
        ("engine", engine, ENGINES),
        ("autoreset", autoreset, AUTORESETS),
        ("on_failure", on_failure, ("stop", "go_on")),
    ):
        check_choice(value, known, f"there is no such {name}", where=name)
    for name, count in counts.items():
        if type(count) is not int or count < 1:
            raise SpecError(
                f"{name} is no number of them",
                where=name,
                expected="1 or more",
                actual=repr(count),
                fix="give a whole number, 1 or more",
            )
