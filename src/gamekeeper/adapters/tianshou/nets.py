"""Networks that are given masks beside what is seen."""

from __future__ import annotations

from typing import Any

import torch
from tianshou.utils.net.common import AbstractDiscreteActor, ModuleWithVectorOutput

from gamekeeper.errors import SpecError


def masked(actor: Any) -> Masked:
    """An actor that never takes an action that its mask forbids; it gives logits, not shares.

    Tianshou's Q-learning policies look at masks themselves; its actors don't.

    Raises:
        SpecError: the actor ends in a softmax.
    """
    if getattr(actor, "softmax_output", False):
        raise SpecError(
            "shares can't be masked", where="actor", expected="logits",
            seen="softmax_output=True", mend="DiscreteActor(..., softmax_output=False)",
        )  # fmt: skip
    return Masked(actor)


def unmasked(net: Any) -> Unmasked:
    """A critic (or any network) that is given what is seen alone."""
    return Unmasked(net)


class Masked(AbstractDiscreteActor):
    """Use `masked`."""

    def __init__(self, actor: Any) -> None:
        """Takes over an actor."""
        super().__init__(actor.get_output_dim())
        self.actor = actor

    def get_preprocess_net(self) -> Any:
        """The actor's."""
        return self.actor.get_preprocess_net()

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        """Logits and hidden state; of what is masked out, as good as nothing."""
        logits, hidden = self.actor(obs.obs, state=state, info=info)
        legal = torch.as_tensor(obs.mask, device=logits.device).bool()
        return logits.masked_fill(~legal, torch.finfo(logits.dtype).min), hidden


class Unmasked(ModuleWithVectorOutput):
    """Use `unmasked`."""

    def __init__(self, net: Any) -> None:
        """Takes over a network."""
        super().__init__(net.get_output_dim())
        self.net = net

    def forward(self, obs: Any, *args: Any, **kwargs: Any) -> Any:
        """What the network gives for what is seen."""
        return self.net(obs.obs, *args, **kwargs)
