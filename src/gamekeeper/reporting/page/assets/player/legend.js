// What the signs of the lanes mean: colours, bars, marks, and of several roles the shapes.

const KEYS = [
  ["key-acted", "acted, in the agent’s colour"],
  ["key-idle", "did “nothing”"],
  ["key-gain", "reward above 0"],
  ["key-loss", "reward below 0"],
  ["key-cumulative", "reward since its last turn"],
  ["key-ended", "terminated (open: truncated)"],
  ["key-cursor", "turn on show"],
];
const MEANINGS = {
  failure: "failed",
  error: "error, or the recorder was killed",
  since: "first difference from the counterfactual",
  divergence: "first difference from another episode",
  pivot: "turn that lost it",
  label: "label of a failure",
  change: "something was changed",
  ending: "agents ended",
  penalty: "a large loss: at least half of the largest",
};
const SHAPES = ["circle", "square", "triangle", "diamond"]; // as the map draws them
const MOST = 8; // roles that are told apart in words

const key = (sign, text) => gk.node("span", { class: "key" }, sign, text);

// The shape of each role; empty where there is one role.
gk.roleWords = (episode) => {
  const roles = [...new Set(episode.agents.map((agent) => agent.role))];
  if (roles.length < 2 || roles.length > MOST) return [];
  return roles.map((role) => `${SHAPES[gk.placeOf("role", role) % SHAPES.length]}: ${gk.visible(role ?? "no role")}`);
};

// `marks`: those on show; a sign that isn't there is not explained.
gk.legendOf = (episode, marks) => {
  const isThere = { "key-cumulative": episode.isTurnwise, "key-idle": episode.idle.some((values) => values.size) };
  const keys = KEYS.filter(([kind]) => isThere[kind] ?? true);
  const items = keys.map(([kind, text]) => key(gk.node("i", { class: kind, "aria-hidden": "true" }), text));
  const kinds = new Set(marks.map((mark) => mark.kind));
  const signs = Object.entries(MEANINGS).filter(([kind]) => kinds.has(kind));
  const isQuiet = gk.quietOf(marks);
  items.push(...signs.map(([kind, text]) => key(gk.node("span", { class: isQuiet({ kind }) ? "sign-quiet" : "sign", "aria-hidden": "true", text: gk.markSign({ kind }) }), text)));
  items.push(...gk.roleWords(episode).map((text) => gk.node("span", { class: "key", text })));
  if (gk.coloursRepeat()) items.push(gk.node("span", { class: "key", text: "more agents than colours: they repeat, names and shapes tell apart" }));
  return items;
};
