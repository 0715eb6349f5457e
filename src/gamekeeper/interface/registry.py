"""PettingZoo's two registries, with ours in them, as the openers of ids read them."""

import difflib
import functools
import importlib
from collections.abc import Iterable
from typing import Final

import pettingzoo

from gamekeeper import plugins
from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import VERSION, did_you_mean, modules_called
from gamekeeper.interface.env_source import NotHereError, Source
from gamekeeper.interface.modules import load_module
from gamekeeper.plugins import BrokenPlugin

OURS: Final = "gamekeeper"
"""The namespace of our own environments."""


def with_ours() -> tuple[BrokenPlugin, ...]:
    """Our environments and those of third parties stand in the registries, but for broken ones."""
    importlib.import_module(f"{OURS}.tasks")  # registers them; each is imported when it is made
    return plugins.load(f"{OURS}.tasks").broken


def canonical(env_id: str) -> str:
    """The id as the registries spell it: `tictactoe_v3` is `tictactoe-v3`."""
    return VERSION.sub(r"-v\1", env_id.strip())


def newest(env_id: str) -> str | None:
    """The id itself where it names a version, else in its highest; None where there is none."""
    if VERSION.search(env_id):
        return env_id if env_id in ids() else None
    versions = [(_version(known), known) for known in ids() if VERSION.sub("", known) == env_id]
    return max(versions)[1] if versions else None


def ids() -> set[str]:
    """Every id that is registered for either API."""
    return {*pettingzoo.aec_registry, *pettingzoo.parallel_registry}


def apis() -> dict[str, tuple[str, ...]]:
    """Every registered id with the APIs it is registered for."""
    registries = {"Parallel": pettingzoo.parallel_registry, "AEC": pettingzoo.aec_registry}
    return {
        env_id: tuple(name for name, registry in registries.items() if env_id in registry)
        for env_id in sorted(ids())
    }


def source_of(env_id: str, api: str | None) -> Source:
    """The source of a registered id; parallel by default where both APIs have it.

    Raises:
        SpecError: its module can't be imported.
    """
    registries = {"parallel": pettingzoo.parallel_registry, "aec": pettingzoo.aec_registry}
    has = [name for name, registry in registries.items() if env_id in registry]
    chosen = api if api in has else has[0]
    entry = registries[chosen][env_id]
    pip = (
        f"pip install 'pettingzoo[{entry.namespace}]'" if _is_pettingzoo(entry.entry_point) else ""
    )
    accepts = entry.entry_point
    if isinstance(accepts, str):
        module, _, name = accepts.partition(":")
        accepts = getattr(load_module(module, pip=pip), name, None)
    if accepts is None:
        raise SpecError(
            f"{env_id} is registered with an entry point that isn't there",
            where=env_id,
            expected="a callable, or 'module:callable'",
            actual=repr(entry.entry_point),
            fix="register it again",
        )
    return Source(
        kind="id",
        factory=functools.partial(pettingzoo.make, chosen, env_id),
        spec=env_id,
        entry_point=env_id,
        default_api=has[0],
        accepts=functools.partial(accepts, **entry.kwargs),
        pip=pip,
        extra=entry.namespace or "",
    )


def unknown(env_id: str, broken: Iterable[BrokenPlugin] = ()) -> NotHereError:
    """The error for an id that no registry has, with what comes near it."""
    meant = likely(env_id)
    seen = f"nothing there{_moved(env_id)}" + "".join(f"; {plugin}" for plugin in broken)
    return NotHereError(
        f"no environment is registered as {env_id}",
        where=env_id,
        expected="an id that pettingzoo.make knows",
        actual=seen,
        fix=did_you_mean(meant)
        or "import the package that registers it first, or name it as module:factory",
    )


def likely(env_id: str) -> list[str]:
    """Names that may be meant by an id that no registry has, at most three; the likeliest first.

    The same name in another version or namespace, else a module of an installed package that is
    called so, else ids that are spelled alike.
    """
    group, _, tail = env_id.rpartition("/")
    name = VERSION.sub("", tail)
    same = [known for known in ids() if VERSION.sub("", known.rpartition("/")[2]) == name]
    if same:
        parts = {known: known.rpartition("/") for known in same}
        same.sort(key=lambda known: (parts[known][2] != tail, parts[known][0] != group, known))
        return [known.removeprefix(f"{OURS}/") for known in same[:3]]
    modules = modules_called(group, name) if group.isidentifier() else []
    if modules:
        return modules
    tails = {known.rpartition("/")[2]: known for known in sorted(ids())}
    spelled = {VERSION.sub("", each): known for each, known in tails.items()}
    close = difflib.get_close_matches(name, spelled, n=3, cutoff=0.75)
    return [spelled[each].removeprefix(f"{OURS}/") for each in close]


def _moved(env_id: str) -> str:
    """PettingZoo's own words about a group of environments that moved to another package."""
    group = env_id.partition("/")[0]
    is_known = any(known.startswith(f"{group}/") for known in ids())
    if is_known or not group.isidentifier():
        return ""
    try:
        importlib.import_module(f"pettingzoo.{group}")
    except ModuleNotFoundError:
        return ""
    except ImportError as error:
        return f"; {error}"
    return ""


def _version(env_id: str) -> int:
    found = VERSION.search(env_id)
    return int(found[1]) if found else -1


def _is_pettingzoo(entry_point: object) -> bool:
    return isinstance(entry_point, str) and entry_point.startswith("pettingzoo.")
