// The first difference of two episodes: the turn by their checksums, which are of all that was recorded, the field by what the page holds of it.

const FIELDS = ["action", "paid", "cumulative_reward", "terminated", "truncated", "mask", "nonconforming"];

const same = (a, b) => a === b || (Number.isNaN(a) && Number.isNaN(b));

// What stands in a row under one of the field's names, for showing and comparing.
gk.field = (episode, row, field) => {
  if (row < 0) return null;
  if (field === "paid") return episode.reward[row];
  if (field === "action" || field === "mask" || field === "info" || field === "nonconforming") return episode.textOf(episode[field][row]);
  if (field in episode.terms) return episode.terms[field][row];
  return episode[field][row];
};

// {turn, agent, field} of the first difference, or null where there is none; `field`: `length`, `row`, a field, or `hidden` where the page doesn't hold it.
gk.firstDifference = (a, b) => {
  const [one, two] = [a.checksums, b.checksums];
  const shorter = Math.min(one.length, two.length);
  let turn = 0;
  while (turn < shorter && one[turn] === two[turn]) turn++;
  if (turn < shorter) return { turn, ...fieldAt(a, b, turn) };
  return one.length === two.length ? null : { turn, agent: null, field: "length" };
};

// The first agent and field of a turn that are seen to differ.
const fieldAt = (a, b, turn) => {
  const fields = [...FIELDS, ...Object.keys(a.terms).filter((term) => term in b.terms)];
  const [from, past] = a.rowsAt(turn);
  const [fromB, pastB] = b.rowsAt(turn);
  for (let row = from; row < past; row++) {
    const { name } = a.agents[a.agent[row]];
    const rowB = b.slot.has(name) ? rowIn(b, fromB, pastB, b.slot.get(name), row - from) : -1;
    const field = rowB < 0 ? "row" : fields.find((each) => !same(gk.field(a, row, each), gk.field(b, rowB, each)));
    if (field !== undefined) return { agent: name, field };
  }
  return pastB - fromB === past - from ? { agent: null, field: "hidden" } : { agent: extraAgent(a, b, turn), field: "row" };
};

// The row of an agent among those of a turn; `guess`: most often they stand in the same place.
const rowIn = (episode, from, past, agent, guess) => {
  if (from + guess < past && episode.agent[from + guess] === agent) return from + guess;
  for (let row = from; row < past; row++) if (episode.agent[row] === agent) return row;
  return -1;
};

const extraAgent = (a, b, turn) => {
  const [from, past] = b.rowsAt(turn);
  for (let row = from; row < past; row++) {
    const { name } = b.agents[b.agent[row]];
    if (!a.slot.has(name) || a.rowOf(a.slot.get(name), turn) < 0) return name;
  }
  return null;
};

gk.FIELD_WORDS = { row: "the set of rows", hidden: "a value that is not shown here" };
const LONGEST = 80; // characters of a value that is shown

const valueAt = (episode, { turn, agent, field }) => {
  const slot = episode.slot.get(agent);
  const row = slot === undefined ? -1 : episode.rowOf(slot, turn);
  const value = gk.field(episode, row, field);
  return typeof value === "number" ? gk.number(value) || "nothing" : value || "nothing";
};

// The first difference in a sentence; null: there is none.
gk.differenceText = (part, episodes) => {
  if (!part) return "No difference: every turn is the same in both.";
  const { turn, agent, field, values } = part;
  const against = (both) => both.map((value) => gk.visible(value).slice(0, LONGEST)).join(" against ");
  if (turn === null) return `No turn differs; the ${gk.visible(field)} do: ${against(values)}.`;
  if (field === "length") return `The same until turn ${turn - 1}, where one of them ends.`;
  const who = agent === null ? "" : `${gk.visible(agent)}, `;
  if (field === "row") return `First difference: turn ${turn}, ${who}which has a row in one of them only.`;
  if (field === "hidden") return `First difference: turn ${turn}, in an observation, an info or the state, which this page does not compare one by one.`;
  return `First difference: turn ${turn}, ${who}${gk.visible(field)} ${against(values ?? episodes.map((episode) => valueAt(episode, part)))}.`;
};
