"""Run in a process of its own: loads and uses the package where what only POSIX has is hidden.

    python elsewhere.py FOLDER     # works in FOLDER; prints what it came to as JSON

The real thing can't be had here: this shows that no module asks for such a name while it is
imported, and that recording, reading and reporting, which need no worker process, ask for none.
"""

import faulthandler
import importlib
import json
import os
import select
import signal
import socket
import sys
import time
from pathlib import Path

MODULES = [
    "fcntl",
    "resource",
    "pwd",
    "grp",
    "termios",
    "tty",
    "pty",
    "posix",
    "syslog",
    "readline",
]
HIDDEN = {
    os: "fork forkpty killpg getpgid setsid setpgid waitid WNOHANG WEXITED WNOWAIT P_PID getuid "
    "geteuid getgid uname sysconf sched_getaffinity sched_setaffinity set_blocking pread pwrite "
    "preadv pwritev posix_fallocate posix_fadvise statvfs fstatvfs fchmod fchown chown mkfifo "
    "getloadavg nice ctermid O_NOFOLLOW O_DIRECTORY O_NONBLOCK O_CLOEXEC O_SYNC sync fdatasync "
    "sendfile memfd_create eventfd register_at_fork posix_spawn openpty",
    signal: "SIGKILL SIGHUP SIGUSR1 SIGUSR2 SIGCHLD SIGALRM SIGQUIT SIGPIPE SIGSTOP SIGCONT "
    "alarm setitimer pthread_sigmask pthread_kill sigwait sigtimedwait SIG_SETMASK SIG_BLOCK pause",
    faulthandler: "register unregister",
    select: "poll epoll kqueue",
    socket: "AF_UNIX",
    time: "tzset clock_gettime",
}


def load_all() -> list[str]:
    """Imports every module of the package; returns those that load (some need a trainer)."""
    front = Path(importlib.import_module("gamekeeper").__file__ or "").parent
    paths = (path.relative_to(front.parent).with_suffix("") for path in front.rglob("*.py"))
    loaded = []
    for name in sorted(".".join(path.parts).removesuffix(".__init__") for path in paths):
        if name.endswith(("__main__", ".worker_main")):  # these run what they are
            continue
        try:
            importlib.import_module(name)
        except Exception as error:
            if "isn't installed" not in str(error) and "No module named" not in str(error):
                raise
        else:
            loaded.append(name)
    return loaded


def hide() -> None:
    """Takes away what Windows lacks; libraries are loaded by now and have theirs."""
    for name in [n for n in sys.modules if n.split(".")[0] == "gamekeeper"]:
        del sys.modules[name]
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]  # importing it raises ImportError
    for module, names in HIDDEN.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    sys.platform = "win32"


def use(folder: Path) -> dict[str, object]:
    """Records, reads, compares, verifies and reports within this process."""
    import gamekeeper as gk
    from gamekeeper.runs.run_check import verify

    for name in ("one", "two"):
        gk.rollout("two_robot_line", episodes=2, seed=3, out=folder / name)
    env = gk.record(gk.make("tictactoe"), folder / "three")
    env.reset(seed=1)
    env.step(4)
    env.close()
    gk.report(folder / "one", folder / "report.html")
    return {
        "difference": gk.diff(folder / "one", folder / "two"),
        "ok": [verify(folder / name).ok for name in ("one", "two", "three")],
        "rows": gk.load(folder / "three").agent_steps.num_rows,
        "page": "two_robot_line" in (folder / "report.html").read_text(encoding="utf-8"),
    }


if __name__ == "__main__":
    first = load_all()
    hide()
    second = load_all()
    missing = sorted(set(first) - set(second))
    told = {"loaded": len(first), "missing": missing, **use(Path(sys.argv[1]))}
    sys.stdout.write(json.dumps(told))
