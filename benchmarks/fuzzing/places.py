"""The folders that inputs are read from: sound evidence of every kind, and a copy to damage."""

import contextlib
import io
import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gamekeeper as gk
from benchmarks.fuzzing.lines import READING, damaged_line, play
from benchmarks.fuzzing.run_folders import Run, make_runs

Input = tuple[str, bytes, Callable[[], Any]]


class Places:
    """Everything that inputs are made of, in one folder; each part made when first asked for."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._made: dict[str, Path] = {}
        self._kept: dict[str, Run] = {}
        with contextlib.redirect_stderr(io.StringIO()):
            self._sources = make_runs(root)

    @property
    def finalized(self) -> Path:
        """A finalized run with a label."""
        return self._sources["line"]

    @property
    def evaluated(self) -> Path:
        """The folder of an evaluation."""
        if "evaluated" not in self._made:
            folder = self._root / "source-evaluated"
            with contextlib.redirect_stderr(io.StringIO()):
                gk.evaluate(
                    {
                        "name": "small",
                        "environments": {"line": "two_robot_line"},
                        "policies": {"random": "random", "first": "first-legal"},
                        "seeds": {"episodes": 2},
                    },
                    out=folder,
                    workers=0,
                )
            self._made["evaluated"] = folder
        return self._made["evaluated"]

    def of_texts(self) -> Path:
        """A folder with a run, an evaluation and a storage of parts, all to be damaged."""
        if "texts" not in self._made:
            folder = self._root / "texts"
            shutil.copytree(self.finalized, folder / "run_files")
            shutil.copytree(self.evaluated, folder / "evaluated")
            (folder / "storage" / "parts").mkdir(parents=True)
            self._made["texts"] = folder
        return self._made["texts"]

    def run_files(self, kind: str) -> Run:
        """A run to be damaged."""
        if kind not in self._kept:
            self._kept[kind] = Run(self._sources[kind], self._root / f"work-{kind}")
        return self._kept[kind]

    def line(self, rng: random.Random) -> Input:
        """A damaged command line over sound evidence."""
        line = damaged_line(rng)
        return "line", json.dumps(line).encode(), lambda: self.play(line)

    def play(self, line: list[str]) -> None:
        """Plays a line, in a folder whose contents go afterwards."""
        out = self._root / "out"
        out.mkdir()
        try:
            with contextlib.chdir(out):
                play(line, run=self.finalized, sound=self._sources["games"], out=out)
        finally:
            shutil.rmtree(out)

    def command(self, rng: random.Random) -> Input:
        """A sound command line over a damaged run."""
        kind, number = rng.choice(list(self._sources)), rng.randrange(len(READING))
        run_files = self.run_files(kind)
        name, data = (run_files.damage if rng.random() < 0.3 else run_files.alter)(rng)
        label = f"{kind}-{number}-{name}"
        return label, data, lambda: self.command_again(label, data)

    def command_again(self, label: str, data: bytes) -> None:
        """Plays the command over the run that `label` names."""
        kind, number, name = label.split("-", 2)
        line = READING[int(number)].split(" ")
        out, sound = self._root / "out", self._sources["games"]

        def read(folder: Path) -> None:
            out.mkdir()
            try:
                play(line, run=folder, sound=sound, out=out)
            finally:
                shutil.rmtree(out)

        self.run_files(kind).read(name, data, with_hashes=True, by=read)
