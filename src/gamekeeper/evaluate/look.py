"""What an environment and its policies are, looked at without a step: a task for a worker."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from gamekeeper.core.canon import from_json, is_exact, to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import EvidenceError, GamekeeperError
from gamekeeper.evaluate.digests import environment_digest, environment_version, policy_digest
from gamekeeper.evaluate.spec import Choices, EnvironmentSpec, Spec
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.open import open_env
from gamekeeper.game.opening.load import split_file
from gamekeeper.game.opening.opened import Opened
from gamekeeper.record.recording import cast_of
from gamekeeper.record.tasks import error_fields

LOOK: Final = "gamekeeper.evaluate.look:look_task"


@dataclass(frozen=True, slots=True)
class Look:
    """An environment as it is installed here, and the policies that play in it.

    Attributes:
        digest, version, api: of the environment.
        roles: of each agent that may play, in the order of the roster.
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
        """The roles of those who may play, in the order of the roster."""
        return tuple(dict.fromkeys(self.roles.values()))

    def members(self, role: str) -> tuple[str, ...]:
        """The agents of a role."""
        return tuple(agent for agent, its in self.roles.items() if its == role)


def opening_of(environment: EnvironmentSpec, spec: Spec) -> dict[str, Any]:
    """What a task needs to open an environment, as `opened` takes it."""
    contract = environment.contract
    return {
        "spec": placed(environment.spec, spec.folder),
        "kwargs": dict(environment.kwargs),
        "contract": placed(contract, spec.folder) if isinstance(contract, str) else contract,
    }


def crossing(opening: Mapping[str, Any], *options: Mapping[str, Any] | None) -> list[Any]:
    """An opening, and options, as JSON that a worker process builds the same from.

    Raises:
        EvidenceError: there is an object that no text can build again.
    """
    kwargs, contract = to_json(opening["kwargs"]), opening["contract"]
    texts = [None if each is None else to_json(each) for each in options]
    is_plain = isinstance(opening["spec"], str)
    if not (is_plain and all(is_exact(text) for text in (kwargs, *texts) if text is not None)):
        raise EvidenceError(
            "the environment or a policy is an object of this process",
            where="workers", expected="names, which another process can open",
            seen="an object", mend="workers=0 plays in this process",
        )  # fmt: skip
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
            "a policy is an object of this process", where=f"policies.{policy}",
            expected="names, which another process can find", seen="an object",
            mend="workers=0 plays in this process",
        )  # fmt: skip


def given(value: Any) -> Any:
    """What crossed as canonical text, as it was; anything else as it is."""
    return from_json(value) if isinstance(value, str) else value


def opened_with(opening: Mapping[str, Any]) -> tuple[Opened, Contract | None]:
    """The environment of an opening, and the contract that it is under.

    Raises:
        SpecError: it can't be opened.
        ContractError: its contract can't be read.
    """
    kwargs: Any = given(opening["kwargs"])
    opened = open_env(opening["spec"], **kwargs)
    told = opening["contract"]
    try:
        if isinstance(told, Mapping):
            told = Contract.from_json(told)
        return opened, declared_contract(told, opened)
    except BaseException:
        opened.env.close()
        raise


def choices_of(choices: Choices, spec: Spec) -> dict[str, Any]:
    """Who plays, as they are found from here."""
    return {whom: placed(choice, spec.folder) for whom, choice in choices.items()}


def look_task(
    report: Any,
    *,
    opening: Mapping[str, Any],
    options: Mapping[str, Any] | str | None,
    policies: Mapping[str, Sequence[Mapping[str, Any]]],
    files: Mapping[str, Sequence[str]],
) -> dict[str, Any]:
    """Opens an environment and finds its policies.

    Args:
        opening: what opens it.
        options: of its resets.
        policies: by name, of each run who plays.
        files: by name, whose bytes count too.
    Returns:
        The fields of a `Look`; or those of the `error` that was in the way.
    """
    try:
        return asdict(look_at(opening, options, policies, files, report))
    except GamekeeperError as error:
        return {"error": error_fields(error)}


def look_at(
    opening: Mapping[str, Any],
    options: Mapping[str, Any] | str | None,
    policies: Mapping[str, Sequence[Mapping[str, Any]]],
    files: Mapping[str, Sequence[str]],
    report: Any = lambda: None,
) -> Look:
    """The same in this process; the arguments are those of `look_task`.

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
                cast = cast_of(dict(choices), env, contract)
                chosen = {whom: cast.chosen_for(whom) for whom in choices}
                found.append(policy_digest(chosen, files.get(name, ())))
            digests[name] = tuple(found)
        return Look(
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
