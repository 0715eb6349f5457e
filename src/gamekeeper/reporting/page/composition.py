"""Runs and documents as one page: its sections, its runs, and pairs of episodes to compare."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from numpy.random import Generator

from gamekeeper.episodes.divergence import Divergence, compare, shown_pair
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import TEAM
from gamekeeper.reporting.page.agent_section import agents_blocks
from gamekeeper.reporting.page.answers import state_texts
from gamekeeper.reporting.page.audit_sections import agents_text, form_section, verdicts_section
from gamekeeper.reporting.page.diagnosis_sections import causes_section
from gamekeeper.reporting.page.episode_figures import Figures, compared_block, failing, figures_of
from gamekeeper.reporting.page.evaluation_section import evaluation_section
from gamekeeper.reporting.page.learning_section import learning_section, names_of
from gamekeeper.reporting.page.packed_episode import PackedAgent, packed_agents
from gamekeeper.reporting.page.page_data import PageBlock, PageSection, RunCard
from gamekeeper.reporting.page.page_html import provenance_section
from gamekeeper.reporting.page.pivots_section import pivots_section
from gamekeeper.reporting.results_text import few

Document = Mapping[str, Any]

PLAYER: Final = "player"
MOST_POLICIES: Final = 3
"""Most policies beside the usual one that the first sentence names."""


@dataclass(frozen=True, slots=True)
class ShownRun:
    """A run that stands on a page.

    Attributes:
        path: its folder, as it was named.
        figures: of every episode and agent.
        failed: True for each episode that failed; None where it isn't known.
        condition: condition of a failed episode, in words.
        asked: condition of the team that documents were asked for, in place of the contract's.
    """

    key: str
    path: str
    name: str
    evidence: Evidence
    figures: Figures
    failed: Sequence[bool | None]
    condition: str
    roster: tuple[PackedAgent, ...]
    labels: Sequence[Mapping[str, Any]] = ()
    asked: str | None = None

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
            agents=tuple((member.name, member.role) for member in self.roster),
        )


def shown(
    evidence: Evidence,
    *,
    key: str,
    path: str,
    name: str,
    labels: Sequence[Mapping[str, Any]] = (),
    condition: str | None = None,
) -> ShownRun:
    """Computes the figures of a run that all sections share; `condition` as `failing` takes it."""
    figures = figures_of(evidence)
    declared = evidence.contract.failure
    if declared and TEAM in declared and declared[TEAM].text == condition:
        condition = None
    failed, text = failing(evidence, figures, condition)
    agents = packed_agents(evidence)
    return ShownRun(key, path, name, evidence, figures, failed, text, agents, labels, condition)


@dataclass(frozen=True, slots=True)
class Documents:
    """JSON documents about a run, as the commands print them; None: not given."""

    audit: Document | None = None
    diagnosis: Document | None = None
    attribution: Document | None = None
    pivots: Document | None = None
    evaluation: Document | None = None


def sections_of(
    runs: Sequence[ShownRun], documents: Documents, *, version: str, rng: Generator
) -> tuple[PageSection, ...]:
    """All sections in their order; the first run is the one that the documents are about.

    Args:
        runs: at least one; counterfactuals aren't among them.
    """
    main = runs[0]
    agents: list[PageBlock] = []
    for run in runs:
        blocks = agents_blocks(
            run.figures,
            run.evidence.summary,
            run.roster,
            key=run.key,
            labels=run.labels,
            attribution=documents.attribution if run is main else None,
            failed=run.failed,
            condition=run.condition,
            rng=rng,
        )
        if len(runs) > 1:
            agents.append(PageBlock(title=f"Run {run.key}: {run.name}", is_heading=True))
        agents += blocks
    for run in runs[1:]:
        names = (main.name, run.name)
        agents.append(compared_block(main.figures, run.figures, names=names, rng=rng))
    same = [(run.key, run.figures) for run in runs if run is main or continues(main, run)]
    form = form_section(
        main.evidence,
        main.figures,
        main.roster,
        audit=documents.audit,
        attribution=documents.attribution,
    )
    provenance = provenance_section(
        [(run.key, run.path, run.evidence) for run in runs], version=version, audit=documents.audit
    )
    causes = causes_section(documents.diagnosis, documents.attribution, key=main.key)
    by_agent = PageSection("agents", "Agents", tuple(agents))
    backing = (
        pivots_section(documents.pivots, key=main.key),
        verdicts_section(documents.audit),
        *((by_agent, causes) if documents.diagnosis is None else (causes, by_agent)),
        form,
        learning_section(same, rng),
        evaluation_section(documents.evaluation),
        provenance,
    )
    return (PageSection(PLAYER, "Player"), *(each for each in backing if each is not None))


def continues(one: ShownRun, two: ShownRun) -> bool:
    """Tells if two runs have the same game and policies, maybe in other versions, as in learning.

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


def alerts_of(runs: Sequence[ShownRun], *, answered: ShownRun | None = None) -> tuple[str, ...]:
    """Alerts of runs that are open, damaged or have unfinished episodes.

    Args:
        answered: the one whose state stands among the page's answers.
    """
    return tuple(
        f"{f'Run {run.key} ({run.name}): ' if len(runs) > 1 else ''}{text}"
        for run in runs
        for text in _alerts(run, has_state=run is not answered)
    )


def _alerts(run: ShownRun, *, has_state: bool) -> Iterator[str]:
    if has_state:
        yield from state_texts(run)
    if run.evidence.kept_text:
        yield f"The run is of level {run.evidence.kept_text}"
    if run.evidence.retained_text:
        yield run.evidence.retained_text


def lead_of(runs: Sequence[ShownRun]) -> str:
    """The subject of the page, in a sentence or two."""
    main = runs[0]
    card = main.card
    text = (
        f"{card.episodes} episode{'' if card.episodes == 1 else 's'} of {card.environment} "
        f"({card.api}), {agents_text(len(main.figures.agents))}{_played_by(main)}."
    )
    if len(runs) > 1:
        text += f" Compared with {', '.join(run.name for run in runs[1:])}."
    return text


def _played_by(run: ShownRun) -> str:
    """The policies of the first episode; the one of most agents comes first."""
    agents: dict[str, list[str]] = {}
    for agent, policy in names_of(run.figures.headers[0]).items() if run.figures.headers else ():
        agents.setdefault(policy, []).append(agent)
    ranked = sorted(agents, key=lambda policy: -len(agents[policy]))
    others = [f"; {few(agents[each], most=2)} by {each}" for each in ranked[1 : 1 + MOST_POLICIES]]
    return f", policy {ranked[0]}{''.join(others)}" if ranked else ""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two episodes that the player can show side by side.

    Attributes:
        left, right: letter of the run and number of the episode.
        divergence: the first place where they differ; None: they are the same.
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
        found = self.divergence
        if found is None:
            return {**sides, "text": self.text, "divergence": None}
        values = shown_pair(found.recorded, found.replayed)
        where = {"turn": found.turn, "agent": found.agent, "field": found.field}
        return {**sides, "text": self.text, "divergence": {**where, "values": values}}


def pairs_of(one: ShownRun, two: ShownRun, *, text: str, most: int) -> list[Pair]:
    """Episodes of two runs with the same number and seed, failing ones first."""
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
        episodes = one.evidence.episode_of(header), two.evidence.episode_of(others[number])
        volatile = one.evidence.contract.volatile_infos()
        divergence = compare(*episodes, volatile=volatile).divergence
        about = f"{text}, episode {number}: {_where(divergence)}"
        found.append(Pair((one.key, number), (two.key, number), about, divergence))
    return found


def _where(divergence: Divergence | None) -> str:
    if divergence is None:
        return "the same"
    if divergence.turn is None:
        return f"the same turns, other {divergence.field}"
    return f"first difference at turn {divergence.turn}"
