"""`TurnEnv`: an AEC environment of which the author writes the rules alone."""

from collections.abc import Iterable, Mapping
from typing import Any

from gamekeeper.interface.authoring import Authored
from gamekeeper.interface.bookkeeping import Books


class TurnEnv(Authored, Books):
    """One agent acts, then the next: PettingZoo's AEC interface over rules that the author writes.

    A subclass calls `super().__init__()`, sets `possible_agents`, `observation_spaces` and
    `action_spaces`, and writes

    - `start(rng, options)`: makes the first state;
    - `act(agent, action)`: plays one turn, with the verbs `self.add_reward(agent, amount, term)`,
      `self.terminate(agent, reason)`, `self.truncate(agent, reason)` and `self.join(agent)`;
    - `observe(agent)`: what an agent sees;

    and, where the task has it, `mask(agent)` (goes into infos["action_mask"], and into observations
    of a Dict space with that key), `info(agent)`, `state()`, `render()`, `starting_agents()` (the
    others join later), `first_agent()`, `next_agent(agent)` (else the roster goes round; one who
    has ended is passed over), `first_to_leave()` (of several that end together; else the first of
    the roster), and `illegal(agent, action)` (a penalty in place of the error).

    The base keeps what PettingZoo promises: rewards, and their sum since an agent's last turn,
    which is 0 again once it has acted; an ended agent's last reward, and its one turn in which it
    can only do None, before anybody else's, in roster order; a roster and dictionaries with nobody
    in them but those who haven't left; the order of calls; actions checked before anything changes;
    observations, infos and the state as copies, observations and state of their space (the class's
    `copy = False` hands out what the author returned).
    A turn costs the same however many agents there are. An agent's info and mask are asked anew as
    its own turn begins; until then `infos` shows what it was given last.

    Seeds: `reset(seed=s)` begins episode 0 of seed s, and each `reset()` after it the next episode
    of the same seed, whose random numbers don't depend on how long the one before was. Without any
    seed the first one is drawn from the operating system; `self.rng.seed` tells it.

    `horizon` ticks, or those of the contract that the class names (`contract = "relay.toml"` beside
    its file), end the episode; a tick is over once all who were live as it began had a
    turn or ended, or the turn comes to one who had one in it; who joins begins with the next.
    `snapshot()` puts the running environment aside and `restore()` takes it up again; deepcopy and
    pickle work too.

    To read: `rng`; `turns`, how many were played in this episode (None turns don't count); `terms`,
    by agent and term what the last step paid; `endings`, by agent the reason of each ending of
    the episode; `touched`, whom the last step paid, ended, brought in and let go.

    ```python
    class Relay(TurnEnv):
        metadata = {"name": "relay_v0", "render_modes": []}

        def __init__(self, n=2, render_mode=None):
            super().__init__(render_mode=render_mode, horizon=20)
            self.possible_agents = [f"runner_{i}" for i in range(n)]
            self.observation_spaces = {a: Discrete(11) for a in self.possible_agents}
            self.action_spaces = {a: Discrete(2) for a in self.possible_agents}

        def start(self, rng, options):
            self.left = rng.integers(3, 11)

        def act(self, agent, action):
            self.left -= action
            if self.left == 0:
                self.add_reward(agent, 1.0, term="delivery")
                for each in self.agents:
                    self.terminate(each, "delivered")

        def observe(self, agent):
            return self.left
    ```
    """

    def first_agent(self) -> Any:
        """Agent of the first turn, asked after `start`: by default the first of the roster."""
        return self.agents[0]

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begins an episode: of a new seed, or the next one of the last seed.

        Raises:
            DrawError: the seed is no whole number in [0, 2**64).
            ContractError: the rules break a promise of the books.
        """
        rng = self._take_seed(seed)
        shows = self._masks or self._informs or self.render_mode == "human"
        self._open(self.starting_agents(), horizon=self._limit(), shows=shows)
        self.start(rng, dict(options or {}))
        self._check_names(is_begun=True)
        self._begin(self.first_agent())

    def _play(self, agent: Any, action: Any) -> None:
        """The author's rule for an action that isn't legal."""
        instead = self.illegal(agent, action)
        if instead is not None:
            self.act(agent, instead)

    def _show(self, agents: Iterable[Any]) -> None:
        """New infos for those whose turn begins and those who came; a picture for who watches."""
        self._forget_masks()
        for agent in (*agents, *self.touched.joined):
            self.infos[agent] = self._info_of(agent)
        if self.render_mode == "human":
            self.render()
