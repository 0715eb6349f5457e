"""What RLlib has learnt as a policy: `rllib:CHECKPOINT`, or an algorithm in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from ray import cloudpickle
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModule
from ray.rllib.utils.spaces.space_utils import unsquash_action

from gamekeeper.adapters.rllib.setup import Mapped
from gamekeeper.errors import PolicyError

CONSTRUCTED: Final = "class_and_ctor_args.pkl"
MODULES: Final = "learner_group/learner/rl_module"
CONNECTORS: Final = ("_env_to_module_connector", "_module_to_env_connector")


class ModulePolicy:
    """Modules of RLlib that play the agents that they learnt to play.

    Args:
        modules: by name.
        mapped: who is played by which, and how it sees.
        version: kept with the evidence.
        deterministic: takes the likeliest action; else one is drawn.
        unsquash: whether continuous actions were learnt in [-1, 1].
    """

    def __init__(
        self,
        modules: Mapping[str, Any],
        mapped: Mapped,
        *,
        version: str,
        deterministic: bool = True,
        unsquash: bool = True,
    ) -> None:
        self.modules, self.mapped, self.version = modules, mapped, version
        self.deterministic, self._unsquash = deterministic, unsquash

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        name = str(agent)
        sight = self.mapped.sights.get(name)
        if sight is None:
            raise PolicyError(
                f"{name!r} isn't among those who learnt", where=name, seen=name,
                expected=", ".join(self.mapped.sights), mend="give it a policy of its own",
            )  # fmt: skip
        module = self.modules[self.mapped(name)]
        batch = {Columns.OBS: _tensors(sight.shown(observation, info))}
        with torch.no_grad(), torch.random.fork_rng(devices=[]):
            if self.deterministic:
                logits = module.forward_inference(batch)[Columns.ACTION_DIST_INPUTS]
                kind = module.get_inference_action_dist_cls()
                drawn = kind.from_logits(logits).to_deterministic().sample()
            else:
                torch.manual_seed(int(rng.integers(2**31)))
                logits = module.forward_exploration(batch)[Columns.ACTION_DIST_INPUTS]
                drawn = module.get_exploration_action_dist_cls().from_logits(logits).sample()
        action = _bare(drawn)
        if self._unsquash:
            action = unsquash_action(action, sight.action_space)
        return sight.meant(action)


def policy(model: Any, *, deterministic: bool = True, version: str | None = None) -> ModulePolicy:
    """A policy of an algorithm in memory as it is now, or of its checkpoint.

    A checkpoint is code as well as numbers: it is unpickled.

    Args:
        model: an algorithm whose config has `policy_mapping`'s, or the folder that its
            `save_to_path` made.
        deterministic: takes the likeliest action.
        version: kept with the evidence; None: the digest of its weights.
    Raises:
        PolicyError: there is no such checkpoint, or one that can't be played from here.
    """
    if not isinstance(model, str | Path):
        with tempfile.TemporaryDirectory() as folder:
            model.save_to_path(folder)
            return policy(folder, deterministic=deterministic, version=version)
    path = Path(model).resolve()
    config = _config(path)
    mapped = config.get("policy_mapping_fn")
    if not isinstance(mapped, Mapped):
        raise PolicyError(
            "the checkpoint doesn't say who is played by which module", where=str(path),
            expected="a config with multi_agent(**policy_mapping(spec))", seen=repr(mapped)[:200],
            mend="train with gamekeeper.adapters.rllib.policy_mapping",
        )  # fmt: skip
    own = [name for name in CONNECTORS if config.get(name) is not None]
    modules = dict(MultiRLModule.from_checkpoint(str(path / MODULES)).items())
    if own or any(module.is_stateful() for module in modules.values()):
        raise PolicyError(
            "what it decides depends on more than an observation",
            where=str(path), expected="modules without a memory, and RLlib's own connectors",
            seen=", ".join(own) or "a module with a memory",
            mend="flatten=True in place of a connector; a policy of your own for the rest",
        )  # fmt: skip
    return ModulePolicy(
        modules, mapped, version=version or _digest(modules), deterministic=deterministic,
        unsquash=bool(config.get("normalize_actions", True)),
    )  # fmt: skip


def _config(path: Path) -> Mapping[str, Any]:
    file = path / CONSTRUCTED
    if not (file.is_file() and (path / MODULES).is_dir()):
        raise PolicyError(
            "there is no checkpoint of an algorithm", where=str(path),
            expected=f"{CONSTRUCTED} and {MODULES} in it",
            seen="no such folder" if not path.is_dir() else "a folder of something else",
            mend="algorithm.save_to_path(FOLDER)",
        )  # fmt: skip
    with file.open("rb") as stream:
        arguments, keywords = cloudpickle.load(stream)["ctor_args_and_kwargs"]
    config = keywords.get("config", arguments[0] if arguments else {})
    return config if isinstance(config, Mapping) else config.to_dict()


def _tensors(observation: Any) -> Any:
    """One observation as a batch of tensors."""
    if isinstance(observation, dict):
        return {key: _tensors(part) for key, part in observation.items()}
    array = np.asarray(observation)
    if np.issubdtype(array.dtype, np.floating):
        array = array.astype(np.float32)
    return torch.from_numpy(np.ascontiguousarray(array)[None])


def _bare(drawn: Any) -> Any:
    """A batch of one action as an action: numbers and arrays in the form of the space."""
    if isinstance(drawn, dict):
        return {key: _bare(part) for key, part in drawn.items()}
    if isinstance(drawn, tuple | list):
        return tuple(_bare(part) for part in drawn)
    value = drawn[0].cpu().numpy()
    return int(value) if value.ndim == 0 and np.issubdtype(value.dtype, np.integer) else value


def _digest(modules: Mapping[str, Any]) -> str:
    digest = blake2b(digest_size=8)
    for name in sorted(modules):
        for key, value in sorted(modules[name].state_dict().items()):
            digest.update(f"{name}.{key}".encode())
            digest.update(np.ascontiguousarray(value.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()
