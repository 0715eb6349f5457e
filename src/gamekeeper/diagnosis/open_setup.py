"""The set-up of a run, read from its evidence, and opened to be played again otherwise."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from typing import Any, Final, Self

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.diagnosis.undos import BoundaryUndo, UndonePolicies
from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.episodes.plain_json import plain
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.interface.identity import spec_of
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.policy import EVERYONE, SAME, reset_policy, shared_with
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.continuations import RecordedEpisode
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, EvidenceOptions, perform
from gamekeeper.rollouts.intervention import Intervention
from gamekeeper.rollouts.reruns import play_of
from gamekeeper.rollouts.rollout_plan import MOST_TURNS, NAMES, object_of_this_process
from gamekeeper.rollouts.tally import tally
from gamekeeper.runs.consent import Consent, consented
from gamekeeper.runs.expanding import whole_evidence
from gamekeeper.runs.recorder import RunRecorder
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.runs.replay_runner import ReplayRunner
from gamekeeper.runs.standing import choices_in, choices_of

CUT: Final = "cut"


@dataclass(frozen=True, slots=True)
class Setup:
    """Everything that is chosen before an episode begins, but for its seed.

    Attributes:
        spec: where the environment comes from.
        kwargs: arguments of the environment.
        options: of the resets, taken in turn: episode k has those at place k modulo their number.
        policies: by agent or role, under `*` for all others.
        settings: attributes of policies, by agent and name.
        layers: attributes of wrappers of the environment, by name.
        forgets: agents whose policy's memory is reset before each of its decisions.
        renews: agents whose policy's object is a fresh one in each episode.
        most_turns: episodes are cut there.
        change: what a rerun does otherwise.
        undos: stand between the game and the policies of some agents, each of other ones.
        typical_turns: median length of the recorded episodes; nothing is played by it.
    """

    spec: Any
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: tuple[Any, ...] = (None,)
    policies: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    layers: Mapping[str, Any] = field(default_factory=dict)
    forgets: tuple[str, ...] = ()
    renews: tuple[str, ...] = ()
    most_turns: int = MOST_TURNS
    change: Intervention | None = None
    undos: tuple[BoundaryUndo, ...] = ()
    typical_turns: int | None = None

    def policy_of(self, agent: str, contract: Contract) -> Any:
        """Policy of an agent: its own choice, its role's, or the common one; None: unknown."""
        role = contract.role_of(agent) or role_in_name(agent)
        found = self.policies.get(agent, self.policies.get(role, self.policies.get("*")))
        return self.policies.get(shared_with(found) or "", found)

    def with_policy(self, agent: str, policy: Any) -> Setup:
        """The set-up with another policy of one agent; those that shared its object still do."""
        heirs = [place for place, x in self.policies.items() if shared_with(x) == agent]
        found = dict(self.policies)
        for heir in heirs:
            found[heir] = found[agent] if heir == heirs[0] else f"{SAME}{heirs[0]}"
        return replace(self, policies={**found, agent: policy})

    def to_json(self) -> dict[str, Any]:
        """Plain data that a worker process builds the same set-up from.

        Raises:
            EvidenceError: it holds an object that no text can build again.
        """
        text = to_json([self.kwargs, self.options, self.settings, self.layers])
        named = all(isinstance(policy, str) for policy in self.policies.values())
        if not (isinstance(self.spec, str) and named and is_exact(text)):
            raise object_of_this_process("workers", self.spec, NAMES)
        names = ("spec", "policies", "forgets", "renews", "most_turns", "change", "undos")
        return {"given": text, **{name: plain(getattr(self, name)) for name in names}}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Setup:
        """Inverse of `to_json`."""
        given: Any = from_json(data["given"])
        kwargs, options, settings, layers = given
        change = data["change"]
        return cls(
            kwargs=kwargs,
            options=tuple(options),
            settings=settings,
            layers=layers,
            change=None if change is None else Intervention.from_json(change),
            undos=tuple(map(BoundaryUndo.from_json, data["undos"])),
            **{name: frozen(data[name]) for name in ("spec", "policies", "forgets", "renews")},
            most_turns=data["most_turns"],
        )


def evidence_to_play(
    run: str | PathLike[str] | Evidence, *, env: object | None = None, allow_import: bool = False
) -> Evidence:
    """The whole evidence of a run that will be played again.

    Raises:
        SpecError: it is an imported data set, and no environment is named.
        GamekeeperError: as `whole_evidence`.
    """
    evidence = whole_evidence(run, env=env, allow_import=allow_import)
    identity = evidence.manifest["environment"]
    if env is None and identity.get("imported"):
        spec_of(identity)  # says what to do
    return evidence


def setup_of(
    evidence: Evidence, *, env: object | None = None, policies: Mapping[str, Any] | None = None
) -> Setup:
    """The set-up of a recorded run.

    Args:
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`; agents that none of
            them is for keep their recorded policy.
    Raises:
        EvidenceError: it names no policies, or an argument that can't be built again.
        SpecError: the environment was an object in memory, and none is given.
    """
    identity = evidence.manifest["environment"]
    named = _named_policies(evidence, dict(policies or {}))
    spec = spec_of(identity) if env is None else env
    # Without `aec:` or `parallel:` (9 characters) in front it is opened as what was recorded.
    if isinstance(spec, str) and env is not None and ":" not in spec.split("/")[0][:9]:
        spec = f"{identity.get('api')}:{spec}" if identity.get("api") else spec
    text = json.dumps(identity.get("kwargs") or {}, separators=(",", ":"))
    if not is_exact(text):
        raise EvidenceError(
            "an argument of the environment was an object that no text can build again",
            where="kwargs",
            actual=text[:200],
            fix="record with plain arguments",
        )
    kwargs: Any = from_json(text)
    rows = evidence.episode_table.to_pylist()
    options = [row["options"] for row in rows] or [None]
    lengths = [row["turns"] for row in rows if row["turns"]]
    return Setup(
        spec=spec,
        kwargs=kwargs,
        options=tuple(None if each is None else from_json(each) for each in options),
        policies=named,
        most_turns=_most_turns(evidence, rows),
        typical_turns=sorted(lengths)[len(lengths) // 2] if lengths else None,
    )


def _most_turns(evidence: Evidence, rows: Sequence[Mapping[str, Any]]) -> int:
    """The turns at which a run cut its episodes.

    A run that doesn't say so had a limit where several were cut after as many turns, and none is
    longer: one that a policy or Ctrl-C broke off is cut, too.
    """
    told = evidence.manifest.get("most_turns")
    if told is not None:
        return int(told)
    cuts = [row["turns"] for row in rows if row["end"] == CUT]
    longest = max((row["turns"] or 0 for row in rows), default=0)
    return longest if len(cuts) > 1 and set(cuts) == {longest} else MOST_TURNS


def consent_to(
    evidence: Evidence,
    setup: Setup,
    *,
    env: object | None = None,
    policies: Mapping[str, Any] | None,
    allow_import: bool,
    tried: Sequence[object] = (),
) -> AbstractContextManager[Consent]:
    """Consent to play a set-up meanwhile; see `consented`.

    Args:
        evidence: the run.
        setup: of it, as `setup_of` gave it for `env` and `policies`.
        env: named by the user.
        policies: named by the user.
        allow_import: the user allows whatever the run names.
        tried: further policies that the user named.
    """
    return consented(
        evidence,
        doing="playing this run again",
        env=env,
        allow_import=allow_import,
        policies=[str(x) for key, x in setup.policies.items() if key not in (policies or {})],
        chosen=[*(policies or {}).values(), *tried],
    )


def contract_of(evidence: Evidence, contract: Contract | str | PathLike[str] | None) -> Contract:
    """The contract to go by: the one that is given, a path is read, else the recording's."""
    if contract is None:
        return evidence.contract
    return contract if isinstance(contract, Contract) else Contract.load(contract)


def _named_policies(evidence: Evidence, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """The chosen policies, and the recorded ones of agents that none is chosen for."""
    if EVERYONE in chosen:
        return dict(chosen)
    recorded, role_of = choices_of(evidence), evidence.contract.role_of
    players = evidence.agent_steps["agent"].unique().to_pylist()
    left = [name for name in players if name not in chosen and role_of(name) not in chosen]
    if left and not recorded:
        raise EvidenceError(
            "the run doesn't name the policies that played it",
            where="policies",
            expected="a run of gk.rollout or gamekeeper rollout, or a policy for every agent",
            actual=f"no policy for {', '.join(map(str, left))}",
            fix="name the policy of the others too, as in --policy random --policy picker=...",
        )
    kept = {
        place: name
        for place, name in recorded.items()
        if place not in chosen and role_of(place) not in chosen
    }
    heirs: dict[str, str] = {}  # those that shared an object still do
    for place, name in kept.items():
        owner = shared_with(name)
        if owner is not None and owner not in kept:
            heir = heirs.setdefault(owner, place)
            kept[place] = recorded[owner] if heir == place else f"{SAME}{heir}"
    return {**kept, **chosen}


def other_policies(evidence: Evidence, setup: Setup) -> dict[str, str]:
    """The policies of a set-up that the run doesn't name for the same players."""
    recorded = choices_of(evidence)
    return {
        place: name if isinstance(name, str) else f"your {type(name).__name__}"
        for place, name in setup.policies.items()
        if recorded.get(place) != name
    }


def longest_of(evidence: Evidence) -> int:
    """Env steps of the longest recorded episode, at least 1."""
    return max([1, *(evidence.turns_of(header) for header in evidence.headers)])


def recorder_of(
    opened: Opened, folder: str | PathLike[str], declared: Contract, **more: Any
) -> RunRecorder:
    """Recorder of a new run of an open environment.

    Args:
        more: arguments of the recorder; they go before what follows from the contract.
    """
    terms, volatile = tuple(declared.rewards), declared.volatile_infos()
    given = {"contract": declared, "terms": terms, "volatile": volatile, **more}
    return RunRecorder(folder, environment=opened.identity, **given)


class OpenSetup:
    """A set-up, ready to be played. Use as a context: it closes the environment.

    Attributes:
        opened, env: the environment.
        described: its policies, as evidence names them.
        joint_policy: its policies; None where it has none.
        contract: names reward terms and volatile infos.
    """

    def __init__(self, setup: Setup, contract: Contract) -> None:
        """Opens the environment and finds the policies.

        Raises:
            SpecError: the environment can't be opened, or has no such attribute.
            PolicyError: a policy can't be found.
        """
        self.setup, self.contract = setup, contract
        self.opened = open_env(setup.spec, **setup.kwargs)
        self.env: Any = self.opened.env
        self._undo: list[Callable[[], None]] = []
        self._renew: Callable[[], None] | None = None
        try:
            self.joint_policy: Any = None
            self.described = to_json(None)
            if setup.policies:
                self.joint_policy = joint_policy_of(dict(setup.policies), self.env, contract)
                agents = list(getattr(self.env, "possible_agents", ()))
                self.described = to_json(self.joint_policy.described(agents))
            self._set()
            if setup.renews:
                self._renew = self.joint_policy.renewer(setup.renews)
            if setup.forgets:
                self.joint_policy = _Forgetful(self.joint_policy, setup.forgets)
            for undo in setup.undos:
                self.joint_policy = UndonePolicies(self.joint_policy, undo, self.env, contract)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the environment; policies are as they were."""
        for undo in reversed(self._undo):
            undo()
        self._undo = []
        self.env.close()

    def outcome(
        self, run_seed: int, episode: int, *, on_step: Callable[[], None] | None = None
    ) -> Outcome:
        """Outcome of episode number `episode` of a run."""
        return tally(
            self.plan(run_seed, episode),
            self.env,
            joint_policy=self.joint_policy,
            policy_seed=run_seed,
            change=self.setup.change,
            contract=self.contract,
            on_step=on_step,
        )

    def played(
        self, run_seed: int, episode: int, *, change: Intervention | None = None
    ) -> EpisodeResult:
        """The same episode with all its rows.

        Args:
            change: in place of the set-up's own.
        """
        return perform(
            self.plan(run_seed, episode),
            self.env,
            joint_policy=self.joint_policy,
            policy_seed=run_seed,
            change=change or self.setup.change,
            contract=self.contract,
            keep=EvidenceOptions(number=episode),
        )

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of an experiment: source, arguments, options and policies."""
        kept = ("entry_point", "api", "kwargs", "source_digest", "versions")
        plain = {key: self.opened.identity.get(key) for key in kept}
        plain |= {"options": list(self.setup.options), "policies": json.loads(self.described)}
        found: dict[str, Any] = json.loads(json.dumps(plain, default=repr))
        return found

    def plan(self, run_seed: int, episode: int) -> EpisodePlan:
        """Plan of an episode of a run; objects that the set-up renews are new."""
        if self._renew is not None:
            self._renew()
        options = self.setup.options
        return EpisodePlan(
            seed=episode_seed(run_seed, episode),
            stream=episode,
            most_turns=self.setup.most_turns,
            options=options[episode % len(options)],
        )

    def _set(self) -> None:
        for agent, settings in self.setup.settings.items():
            policy = self.joint_policy.chosen_for(agent).policy
            self._set_all(policy, settings, f"the policy of {agent}")
        for name, value in self.setup.layers.items():
            self._set_all(_layer_with(self.env, name), {name: value}, "the wrapper")

    def _set_all(self, thing: Any, settings: Mapping[str, Any], shown: str) -> None:
        for name, value in settings.items():
            if not hasattr(thing, name):
                raise SpecError(
                    f"{shown} has no setting {name!r}",
                    where=f"knobs.{name}",
                    actual=repr(thing)[:200],
                    fix=f"correct knobs.{name} in the contract, or give the object that attribute",
                )
            before = getattr(thing, name)
            setattr(thing, name, value)
            self._undo.append(partial(setattr, thing, name, before))


@dataclass(frozen=True, slots=True)
class SetupTraits:
    """Traits of a set-up that show only once it is opened.

    Attributes:
        agents: all that may play, by name.
        settings: values of policies' attributes that knobs name, by the agents that one object
            plays.
        layers: values of wrappers' attributes that knobs name.
        resettable: the agents of each object that has a memory that can be reset.
        renewable: the agents of each object that can be copied.
        ways: policies that the environment brings, by name.
        unfit: by change and agent, why a perturbation can't be tried.
        cuts: arguments by which the environment cuts episodes off, where every failed one was.
    """

    agents: tuple[str, ...]
    settings: Mapping[tuple[str, ...], Mapping[str, Any]] = field(default_factory=dict)
    layers: Mapping[str, Any] = field(default_factory=dict)
    resettable: tuple[tuple[str, ...], ...] = ()
    renewable: tuple[tuple[str, ...], ...] = ()
    ways: tuple[str, ...] = ()
    unfit: Mapping[tuple[str, str], str] = field(default_factory=dict)
    cuts: Mapping[str, int] = field(default_factory=dict)


def traits_of(
    open_setup: OpenSetup, perturbations: Mapping[str, type[Intervention]]
) -> SetupTraits:
    """Traits of an opened set-up."""
    env, knobs = open_setup.env, open_setup.contract.knobs
    agents = [agent_name(agent) for agent in getattr(env, "possible_agents", ())]
    names = [name for name, knob in knobs.items() if knob.of == "policy"]
    by_object: dict[str, list[str]] = {}
    for agent in agents:
        by_object.setdefault(open_setup.joint_policy.object_of(agent), []).append(agent)
    policies = {
        tuple(sharers): open_setup.joint_policy.chosen_for(sharers[0]).policy
        for sharers in by_object.values()
    }
    settings = {
        sharers: {n: getattr(policy, n) for n in names if hasattr(policy, n)}
        for sharers, policy in policies.items()
    }
    layers: dict[str, Any] = {}
    for name, knob in knobs.items():
        layer = _layer_with(env, name) if knob.of == "wrapper" else None
        if layer is not None and hasattr(layer, name):
            layers[name] = getattr(layer, name)
    own = getattr(env.unwrapped, "policies", None)
    ways = tuple(map(str, own)) if isinstance(own, Mapping) else ()
    unfit = {
        (name, agent): why
        for name, kind in perturbations.items()
        for agent in agents
        if (why := kind.applies(open_setup.contract, env, agent)) is not None
    }
    resettable = [
        sharers for sharers, policy in policies.items() if callable(getattr(policy, "reset", None))
    ]
    renewable = [sharers for sharers in policies if open_setup.joint_policy.is_renewed(sharers[0])]
    return SetupTraits(
        tuple(agents), settings, layers, tuple(resettable), tuple(renewable), ways, unfit
    )


def _layer_with(env: Any, name: str) -> Any:
    """The outermost layer of an environment that has an attribute of its own by this name."""
    while not (name in vars(env) or hasattr(type(env), name)):
        inner = vars(env).get("env")
        if inner is None:
            return env
        env = inner
    return env


class _Forgetful:
    """A joint policy in which policies of some agents are reset before each of their decisions."""

    def __init__(self, joint_policy: Any, agents: tuple[str, ...]) -> None:
        self._joint_policy, self._agents, self._seed = joint_policy, frozenset(agents), 0

    def begin(self, run_seed: int, episode: int) -> None:
        self._seed = episode_seed(run_seed, episode)
        self._joint_policy.begin(run_seed, episode)

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        self._forget(agent)
        return self._joint_policy.act(agent, observation, info)

    def asked(self, agent: Any, *given: Any, anew: bool) -> list[Any]:
        self._forget(agent)
        return list(self._joint_policy.asked(agent, *given, anew=anew))

    def _forget(self, agent: Any) -> None:
        if agent_name(agent) in self._agents:
            reset_policy(self._joint_policy.chosen_for(agent).policy, self._seed)


# -- a recorded episode in an opened set-up, ready to be played on


def recorded_episode_of(evidence: Evidence, open_setup: OpenSetup, number: int) -> RecordedEpisode:
    """The recorded episode, once it has been replayed and is as it was recorded.

    Args:
        evidence: full evidence of the run.
        open_setup: its set-up, or one with other policies.
    Raises:
        EvidenceError: played by itself, the episode doesn't come out as it was recorded.
    """
    _check_alone(evidence, open_setup.opened, number)
    episode, header = evidence.episode(number), evidence.header(number)
    return RecordedEpisode(
        play_of(episode, open_setup.env, evidence.manifest.get("action_types")),
        open_setup.env,
        open_setup.joint_policy,
        evidence.manifest.get("seed") or 0,
        open_setup.contract,
        open_setup.setup.most_turns,
        dict(open_setup.setup.policies) == choices_in(header["policies"]),
    )


def check_agents(evidence: Evidence, open_setup: OpenSetup) -> None:
    """Checks that the agents of a run are those of the environment that was named for it.

    Raises:
        SpecError: the environment says who its agents are, and some of the run aren't there.
    """
    agents = [str(name) for name in evidence.agent_steps["agent"].unique().to_pylist()]
    possible = getattr(open_setup.env, "possible_agents", None) or ()
    there = [agent_name(agent) for agent in possible]
    if there and not set(agents) <= set(there):
        raise SpecError(
            "the environment that was named has other agents than the run",
            where="env",
            expected=", ".join(agents),
            actual=", ".join(there),
            fix="name the run's own environment; agents of a data set get their names as it is "
            "imported (--agent NAME)",
        )


def check_last(evidence: Evidence, opened: Opened) -> None:
    """Checks that the last episode with a seed comes out by itself as it was recorded.

    Raises:
        EvidenceError: it doesn't, as where it depends on those before it.
    """
    rows = evidence.episode_table.select(["episode", "seed"]).to_pylist()
    seeded = [row["episode"] for row in rows if row["seed"] is not None]
    if seeded:
        _check_alone(evidence, opened, seeded[-1])


def _check_alone(evidence: Evidence, opened: Opened, number: int) -> None:
    header, again = evidence.header(number), None
    if header["seed"] is not None:
        again = ReplayRunner(evidence, opened).play(header)
    if again is None or again["fingerprint"] != header["fingerprint"]:
        raise EvidenceError(
            "the episode doesn't come out the same when it is played again by itself",
            where=f"episode {number}",
            actual="it was reset without a seed" if again is None else "another fingerprint",
            fix="gamekeeper replay RUN: where it verifies, the episode depends on those before it "
            "(gamekeeper audit ENV --select GK604); else it looks for the cause",
        )
