"""Inspection of an environment and its policies without a step: a task for a worker."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.errors import EvidenceError, GamekeeperError, PolicyError
from gamekeeper.evaluation.spec import Choices, EnvironmentSpec, Spec
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.distributions import normal_name, owner_of
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.identity import source_digest
from gamekeeper.interface.modules import split_file
from gamekeeper.interface.object_source import FILE_MODULE
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.policy import Chosen
from gamekeeper.rollouts.rollout_plan import NAMES, object_of_this_process
from gamekeeper.runs.recording import joint_policy_of

SIZE: Final = 16
"""Bytes of a digest."""
OPENED: Final = ("entry_point", "api", "kwargs", "source_digest")
"""Parts of an environment's identity that count."""


def digest_of(value: Any) -> str:
    """The digest of plain data, whatever the order of its keys."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return blake2b(text.encode("utf-8", "surrogatepass"), digest_size=SIZE).hexdigest()


def environment_digest(
    identity: Mapping[str, Any], options: Mapping[str, Any] | None = None
) -> str:
    """The digest of an environment as it is opened here.

    Args:
        identity: as opening it gives, or as a manifest keeps it.
    """
    kept = {key: identity.get(key) for key in OPENED}
    return digest_of([kept, None if options is None else to_json(dict(options))])


def environment_version(env: Any) -> str | None:
    """`mpe2 1.0.0`: the distribution that has the rules, as it is installed; None where none is."""
    inner = getattr(env, "unwrapped", env)
    guest = getattr(inner, "guest", inner)
    module = type(getattr(guest, "unwrapped", guest)).__module__
    owner = None if module.startswith(FILE_MODULE) else owner_of(module)
    return None if owner is None else f"{normal_name(owner.name)} {owner.version}"


def policy_digest(chosen: Mapping[str, Chosen], files: Iterable[str] = ()) -> str:
    """The digest of the policies that play.

    Args:
        chosen: policies by agent, role or `*`.
        files: more files whose bytes count.
    Raises:
        PolicyError: a file can't be read.
    """
    rows = [
        [place, _named(one.name), one.version, source_digest([one.policy]), _file_named(one.name)]
        for place, one in sorted(chosen.items())
    ]
    return digest_of([rows, [file_digest(name) for name in files]])


def file_digest(name: str) -> str:
    """The digest of a file's bytes.

    Raises:
        PolicyError: it can't be read.
    """
    try:
        with Path(name).expanduser().open("rb") as file:
            return hashlib.file_digest(file, lambda: blake2b(digest_size=SIZE)).hexdigest()
    except OSError as error:
        raise PolicyError(
            "a file of a policy can't be read",
            where=name,
            expected="a file that can be read",
            actual=error.strerror or type(error).__name__,
            fix="check the path, and that the file may be read",
        ) from None


def _named(name: str) -> str:
    """A policy's name without where its file lies."""
    file = split_file(name)
    if file is not None:
        return f"{Path(file[0]).name}:{file[1]}"
    word, colon, rest = name.partition(":")
    return f"{word}:" if colon and Path(rest).is_file() else name


def _file_named(name: str) -> str | None:
    """The digest of the file behind a word's colon (`sb3:model.zip`); None where there is none."""
    _, colon, rest = name.partition(":")
    if split_file(name) is not None or not colon:
        return None
    found = next((path for path in (rest, f"{rest}.zip") if Path(path).is_file()), None)
    return None if found is None else file_digest(found)


INSPECT: Final = "gamekeeper.evaluation.inspection:inspect_task"


@dataclass(frozen=True, slots=True)
class Inspection:
    """An environment as it is installed here, and the policies that play in it.

    Attributes:
        digest, version, api: of the environment.
        roles: of each possible agent, in the order of the roster.
        contract: as plain data; None where none is declared.
        policies: digests by name, one a run.
    """

    digest: str
    version: str | None
    api: str
    roles: Mapping[str, str]
    contract: Mapping[str, Any] | None
    policies: Mapping[str, tuple[str, ...]]

    @property
    def declared(self) -> Contract:
        """Its contract; an empty one where none is declared."""
        return Contract() if self.contract is None else Contract.from_json(self.contract)

    @property
    def role_names(self) -> tuple[str, ...]:
        """The roles of the possible agents, in the order of the roster."""
        return tuple(dict.fromkeys(self.roles.values()))

    def members(self, role: str) -> tuple[str, ...]:
        """The agents of a role."""
        return tuple(agent for agent, its in self.roles.items() if its == role)


def opening_of(environment: EnvironmentSpec, spec: Spec) -> dict[str, Any]:
    """Arguments with which a task opens an environment, as `opened` takes them."""
    contract = environment.contract
    return {
        "spec": placed(environment.spec, spec.folder),
        "kwargs": dict(environment.kwargs),
        "contract": placed(contract, spec.folder) if isinstance(contract, str) else contract,
    }


def portable(opening: Mapping[str, Any], *options: Mapping[str, Any] | None) -> list[Any]:
    """An opening and options as plain JSON, from which a worker process builds the same.

    Raises:
        EvidenceError: there is an object that no text can build again.
    """
    kwargs, contract = to_json(opening["kwargs"]), opening["contract"]
    texts = [None if each is None else to_json(each) for each in options]
    is_plain = isinstance(opening["spec"], str)
    if not (is_plain and all(is_exact(text) for text in (kwargs, *texts) if text is not None)):
        raise object_of_this_process("workers", opening["spec"], NAMES)
    if isinstance(contract, Contract):
        contract = contract.to_json()
    return [{**opening, "kwargs": kwargs, "contract": contract}, *texts]


def check_named(policy: str, runs: Iterable[Choices]) -> None:
    """Refuses a policy that no other process can find.

    Raises:
        EvidenceError: it is an object.
    """
    if not all(isinstance(choice, str) for choices in runs for choice in choices.values()):
        raise EvidenceError(
            "a policy is an object of this process",
            where=f"policies.{policy}",
            expected="names, which another process can find",
            actual="an object",
            fix="workers=0 plays in this process",
        )


def given(value: Any) -> Any:
    """Value of canonical text from another process; any other value as it is."""
    return from_json(value) if isinstance(value, str) else value


def opened_with(opening: Mapping[str, Any]) -> tuple[Opened, Contract | None]:
    """The environment of an opening, and the contract that it is under.

    Raises:
        SpecError: it can't be opened.
        ContractError: its contract can't be read.
    """
    kwargs: Any = given(opening["kwargs"])
    opened = open_env(opening["spec"], **kwargs)
    contract = opening["contract"]
    try:
        if isinstance(contract, Mapping):
            contract = Contract.from_json(contract)
        return opened, declared_contract(contract, opened)
    except BaseException:
        opened.env.close()
        raise


def choices_of(choices: Choices, spec: Spec) -> dict[str, Any]:
    """Policies, as they are found from here."""
    return {place: placed(choice, spec.folder) for place, choice in choices.items()}


def inspect_task(
    report: Any,
    *,
    opening: Mapping[str, Any],
    options: Mapping[str, Any] | str | None,
    policies: Mapping[str, Sequence[Mapping[str, Any]]],
    files: Mapping[str, Sequence[str]],
) -> dict[str, Any]:
    """Opens an environment and finds its policies.

    Args:
        policies: by name, the choices of each run.
        files: by name, files whose bytes count too.
    Returns:
        The fields of an `Inspection`; or those of the `error` that was in the way.
    """
    try:
        return asdict(inspect_env(opening, options, policies, files, report))
    except GamekeeperError as error:
        return {"error": error.to_json()}


def inspect_env(
    opening: Mapping[str, Any],
    options: Mapping[str, Any] | str | None,
    policies: Mapping[str, Sequence[Mapping[str, Any]]],
    files: Mapping[str, Sequence[str]],
    report: Any = lambda: None,
) -> Inspection:
    """The same in this process; the arguments are those of `inspect_task`.

    Raises:
        SpecError: the environment can't be opened.
        PolicyError: a policy can't be found.
    """
    opened, contract = opened_with(opening)
    env: Any = opened.env
    try:
        agents = [agent_name(agent) for agent in getattr(env, "possible_agents", ())]
        declared = contract or Contract()
        digests: dict[str, tuple[str, ...]] = {}
        for name, runs in policies.items():
            found = []
            for choices in runs:
                report()
                joint_policy = joint_policy_of(dict(choices), env, contract)
                chosen = {place: joint_policy.chosen_for(place) for place in choices}
                found.append(policy_digest(chosen, files.get(name, ())))
            digests[name] = tuple(found)
        return Inspection(
            digest=environment_digest(opened.identity, given(options)),
            version=environment_version(env),
            api=opened.api,
            roles={agent: declared.role_of(agent) or role_in_name(agent) for agent in agents},
            contract=None if contract is None else contract.to_json(),
            policies=digests,
        )
    finally:
        if opened.make is not None:  # an object stays open: it is the one that is to be played
            env.close()


def placed(text: Any, folder: str | None) -> Any:
    """A path in a specification as it is found from here; anything else as it is.

    The path may stand before `:name` (`file.py:function`), behind a word (`sb3:model.zip`), or
    alone. It is looked for beside the specification, else in the current folder.
    """
    if folder is None or not isinstance(text, str):
        return text
    beside = Path(folder).absolute()
    file = split_file(text)
    if file is not None and (beside / file[0]).is_file():
        return f"{beside / file[0]}:{file[1]}" if file[1] else str(beside / file[0])
    head, colon, tail = text.partition(":")
    if colon and tail and (beside / tail).is_file():
        return f"{head}:{beside / tail}"
    return str(beside / text) if (beside / text).is_file() else text
