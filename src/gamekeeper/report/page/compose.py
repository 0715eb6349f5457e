"""Runs and documents as one page: its sections, its runs, what is offered side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from numpy.random import Generator

from gamekeeper.core.divergence import Divergence, compare
from gamekeeper.core.evidence import Evidence
from gamekeeper.report.page.agents import agents_blocks
from gamekeeper.report.page.causes import causes_section
from gamekeeper.report.page.compared import compared_block
from gamekeeper.report.page.data import Block, RunCard, Section
from gamekeeper.report.page.evaluation import evaluation_section
from gamekeeper.report.page.failing import failing
from gamekeeper.report.page.figures import Figures, figures_of
from gamekeeper.report.page.form import form_section
from gamekeeper.report.page.learning import learning_section, names_of
from gamekeeper.report.page.pack import Seat, seats_of
from gamekeeper.report.page.provenance import provenance_section
from gamekeeper.report.page.verdicts import verdicts_section

Document = Mapping[str, Any]

PLAYER: Final = "player"


@dataclass(frozen=True, slots=True)
class Shown:
    """A run that stands on a page.

    Attributes:
        key: its letter.
        path: its folder, as it was named.
        name: what the page calls it.
        evidence: what was recorded.
        figures: of every episode and agent.
        failed: by episode.
        condition: in words, when an episode counts as failed.
        seats: its agents.
        labels: failure labels as plain data.
    """

    key: str
    path: str
    name: str
    evidence: Evidence
    figures: Figures
    failed: Sequence[bool | None]
    condition: str
    seats: tuple[Seat, ...]
    labels: Sequence[Mapping[str, Any]] = ()

    @property
    def card(self) -> RunCard:
        """The run as the page names it."""
        manifest = self.evidence.manifest
        environment = manifest.get("environment") or {}
        return RunCard(
            key=self.key,
            name=self.name,
            status=str(manifest.get("status", "in memory")),
            api=str(environment.get("api") or "parallel"),
            environment=str(environment.get("name")),
            episodes=len(self.figures.headers),
            fingerprint=self.evidence.fingerprint,
        )


def shown(
    evidence: Evidence,
    *,
    key: str,
    path: str,
    name: str,
    labels: Sequence[Mapping[str, Any]] = (),
) -> Shown:
    """A run with the figures that all sections share, worked out once."""
    figures = figures_of(evidence)
    failed, condition = failing(evidence, figures)
    return Shown(key, path, name, evidence, figures, failed, condition, seats_of(evidence), labels)


@dataclass(frozen=True, slots=True)
class Documents:
    """What was found out about a run, as its commands print it; None: it wasn't.

    Attributes:
        audit, diagnosis, attribution, evaluation: the documents.
    """

    audit: Document | None = None
    diagnosis: Document | None = None
    attribution: Document | None = None
    evaluation: Document | None = None


def sections_of(
    runs: Sequence[Shown], documents: Documents, *, version: str, rng: Generator
) -> tuple[Section, ...]:
    """All sections in their order; the first run is the one that the documents are about.

    Args:
        runs: at least one; twins aren't among them.
        documents: about the first one.
        version: of gamekeeper.
        rng: draws the resamples of intervals.
    """
    main = runs[0]
    told = documents.attribution
    agents: list[Block] = []
    for run in runs:
        blocks = agents_blocks(
            run.figures, run.evidence.summary, run.seats, key=run.key, labels=run.labels,
            attribution=told if run is main else None, failed=run.failed,
            condition=run.condition, rng=rng,
        )  # fmt: skip
        if len(runs) > 1:
            agents.append(Block(title=f"Run {run.key}: {run.name}", is_heading=True))
        agents += blocks
    for run in runs[1:]:
        names = (main.name, run.name)
        agents.append(compared_block(main.figures, run.figures, names=names, rng=rng))
    same = [(run.key, run.figures) for run in runs if run is main or continues(main, run)]
    return (
        form_section(main.evidence, main.figures, main.seats, audit=documents.audit,
                     attribution=told),
        verdicts_section(documents.audit),
        Section("agents", "Agents", tuple(agents)),
        Section(PLAYER, "Player"),
        causes_section(documents.diagnosis, told, key=main.key),
        learning_section(same, rng),
        evaluation_section(documents.evaluation),
        provenance_section([(run.key, run.path, run.evidence) for run in runs], version=version,
                           audit=documents.audit),
    )  # fmt: skip


def continues(one: Shown, two: Shown) -> bool:
    """The same game played by the same policies, perhaps in other versions: learning went on.

    Another policy, or other arguments of the environment, is another experiment.
    """
    games = [
        (environment.get("name"), {**kwargs, "render_mode": None})
        for run in (one, two)
        for environment in [run.evidence.manifest.get("environment") or {}]
        for kwargs in [environment.get("kwargs") or {}]
    ]
    policies = [
        {agent: each for header in run.figures.headers for agent, each in names_of(header).items()}
        for run in (one, two)
    ]
    return games[0] == games[1] and policies[0] == policies[1]


def lead_of(runs: Sequence[Shown], documents: Documents) -> str:
    """What the page is about, in a sentence or two."""
    main = runs[0]
    card = main.card
    judged = [each for each in main.failed if each is not None]
    told = (
        f"{card.episodes} episodes of {card.environment} ({card.api}), "
        f"{len(main.figures.agents)} agents"
    )
    # None failed and nobody says when one fails are two things; a diagnosis may judge by its own.
    told += f"; {sum(judged)} failed." if judged else "; nothing declares when an episode failed."
    if documents.audit is not None:
        broken = [each for each in documents.audit["verdicts"] if each.get("outcome") == "broken"]
        told += f" Audit: {len(broken)} promises broken."
    if documents.diagnosis is not None:
        named = {
            label for each in documents.diagnosis["agents"].values() for label in each["labels"]
        }
        told += f" Diagnosis: {', '.join(sorted(named)) or 'no cause named'}."
    if len(runs) > 1:
        told += f" Beside {', '.join(run.name for run in runs[1:])}."
    return told


@dataclass(frozen=True, slots=True)
class Pair:
    """Two episodes that are offered side by side.

    Attributes:
        left, right: letter of the run and number of the episode.
        text: what they are.
        divergence: the first place where they part; None: nowhere.
    """

    left: tuple[str, int]
    right: tuple[str, int]
    text: str
    divergence: Divergence | None

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page's script."""
        sides = {
            name: {"run": run, "episode": episode}
            for name, (run, episode) in (("left", self.left), ("right", self.right))
        }
        turn = None if self.divergence is None else self.divergence.turn
        return {**sides, "text": self.text, "turn": turn}


def pairs_of(one: Shown, two: Shown, *, text: str, most: int) -> list[Pair]:
    """Episodes of two runs that began alike: of one number and one seed, failing ones first.

    Args:
        one, two: the runs.
        text: what the second is beside the first.
        most: how many.
    """
    others = {header["episode"]: header for header in two.figures.headers}
    alike = [
        (not one.failed[place], place, header)
        for place, header in enumerate(one.figures.headers)
        if header["episode"] in others
        and header["seed"] is not None
        and header["seed"] == others[header["episode"]]["seed"]
    ]
    found = []
    for _, _, header in sorted(alike, key=lambda each: each[:2])[:most]:
        number = header["episode"]
        traces = one.evidence.trace_of(header), two.evidence.trace_of(others[number])
        volatile = one.evidence.contract.volatile_infos()
        divergence = compare(*traces, volatile=volatile).divergence
        where = "never part" if divergence is None else f"part at turn {divergence.turn or 0}"
        found.append(
            Pair((one.key, number), (two.key, number), f"{text}, episode {number}: {where}",
                 divergence)
        )  # fmt: skip
    return found
