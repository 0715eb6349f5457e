"""Who may import whom, what a pure room may not touch: functions from a source to violations."""

import ast
from collections.abc import Iterator

from tests.surface.sources import imports

LAYERS = {
    **dict.fromkeys(["_version", "errors", "import_guard", "plugins", "terminal", "heartbeat"], 0),
    **dict.fromkeys(["contract", "randomness", "statistics"], 0),
    "episodes": 1,
    "interface": 2,
    "checks": 3,
    **dict.fromkeys(["foreign", "kernels", "rollouts"], 4),
    "runs": 5,
    **dict.fromkeys(["tasks", "vector"], 6),
    **dict.fromkeys(["auditing", "diagnosis", "evaluation", "reporting"], 7),
    **dict.fromkeys(["adapters", "scaffold", "viewing"], 8),
    **dict.fromkeys(["cli", "testing"], 9),
}
# `errors` is the floor of the bottom line: its neighbours raise what stands there.
FLOOR = "errors"

# Packages that have one place, and the modules that are that place.
TRAINERS = ["stable_baselines3", "sb3_contrib", "supersuit", "torchrl", "benchmarl", "tianshou"]
TRAINERS += ["agilerl", "skrl", "pufferlib", "torch", "jax", "minari"]
PLACES: dict[str, tuple[str, ...]] = {
    # what `reproducers` imports is imported by the program of a finding, not by the package
    "pettingzoo": (
        "gamekeeper.interface",
        "gamekeeper.foreign",
        "gamekeeper.tasks",
        "gamekeeper.checks.reproducers",
    ),
    "ray": ("gamekeeper.rollouts.executors", "gamekeeper.adapters"),
    **dict.fromkeys(TRAINERS, ("gamekeeper.adapters",)),
}

PURE = ("gamekeeper.contract", "gamekeeper.statistics", "gamekeeper.episodes")
PURE += ("gamekeeper.reporting", "gamekeeper.scaffold", "gamekeeper.checks")
FILES = ("gamekeeper.contract.file",)  # the one place in a pure room where a disk is touched
# Modules that are a file, a clock, a printer, the process's surroundings or a randomness of their
# own; what is HARMLESS in them is data or memory.
IMPURE_MODULES = {"glob", "io", "logging", "multiprocessing", "os", "pathlib", "random", "secrets"}
IMPURE_MODULES |= {"select", "shutil", "signal", "socket", "sqlite3", "subprocess", "tempfile"}
IMPURE_MODULES |= {"threading", "time", "urllib", "uuid", "warnings", "webbrowser"}
HARMLESS = {
    "io.BytesIO",
    "io.StringIO",
    "os.PathLike",
    "os.fspath",
    "pathlib.PurePath",
    "pathlib.PurePosixPath",
}
IMPURE_CALLS = {"open", "print", "input", "breakpoint", "exec", "eval", "__import__"}
# Ends of attribute chains: `sys.stdout`, `datetime.datetime.now`.
IMPURE_ATTRIBUTES = {"sys.stdin", "sys.stdout", "sys.stderr", "sys.argv"}
IMPURE_ATTRIBUTES |= {"datetime.now", "datetime.utcnow", "datetime.today", "date.today"}
# Of numpy.random only what is made from a seed that was handed in, and with one.
SEEDED = {"Generator", "PCG64", "PCG64DXSM", "Philox", "SFC64", "SeedSequence", "BitGenerator"}
SEEDED |= {"default_rng"}


def upward_imports(module: str, tree: ast.AST, *, is_package: bool = False) -> Iterator[str]:
    """Imports that go up, to a neighbour, to what has no layer, or to the package's own front."""
    room = module.split(".")[1] if "." in module else ""
    if room in {"", "__main__"}:
        return  # the front loads names from every room
    for line, name in imports(tree, module, is_package=is_package):
        parts = name.split(".")
        if parts[0] != "gamekeeper":
            continue
        other = parts[1] if len(parts) > 1 else ""
        if other not in LAYERS:
            yield f"{module}:{line} imports {name}, which has no layer"
        elif other not in {room, FLOOR} and LAYERS[other] >= LAYERS[room]:
            yield f"{module}:{line} (layer {LAYERS[room]}) imports {name} (layer {LAYERS[other]})"


def misplaced_imports(module: str, tree: ast.AST, *, is_package: bool = False) -> Iterator[str]:
    """Imports of a package outside the modules that are its one place."""
    for line, name in imports(tree, module, is_package=is_package):
        places = PLACES.get(name.split(".")[0], (module,))
        if not within(module, places):
            yield f"{module}:{line} imports {name}, which belongs in {', '.join(places)}"


def impurities(module: str, tree: ast.AST, *, is_package: bool = False) -> Iterator[str]:
    """Files, clocks, prints, surroundings and unseeded randomness in a pure room."""
    if not within(module, PURE) or within(module, FILES):
        return
    for line, name in imports(tree, module, is_package=is_package):
        if name.split(".")[0] in IMPURE_MODULES and name not in HARMLESS:
            yield f"{module}:{line} imports {name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            unseeded = called.removeprefix("numpy.random.").removeprefix("np.random.") in SEEDED
            if called in IMPURE_CALLS or (unseeded and not node.args and not node.keywords):
                yield f"{module}:{node.lineno} calls {called}()"
        elif isinstance(node, ast.Attribute):
            chain = ast.unparse(node)
            if ".".join(chain.split(".")[-2:]) in IMPURE_ATTRIBUTES:
                yield f"{module}:{node.lineno} reads {chain}"
            if ast.unparse(node.value) in {"np.random", "numpy.random"} and node.attr not in SEEDED:
                yield f"{module}:{node.lineno} uses {chain}, the generator that all share"


def within(module: str, places: tuple[str, ...]) -> bool:
    """Whether a module is one of these or stands inside one."""
    return any(module == place or module.startswith(f"{place}.") for place in places)
