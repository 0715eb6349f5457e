// Where two episodes part: the first turn at which an agent was given, did or was paid something else.
// Infos stand apart: some hold times and the like, which differ without meaning anything.

const FIELDS = ["order", "action", "paid", "received", "terminated", "truncated", "mask", "odd"];

const same = (a, b) => a === b || (Number.isNaN(a) && Number.isNaN(b));

// What stands in a row under one of the field's names, for showing and comparing.
gk.field = (episode, row, field) => {
  if (row < 0) return null;
  if (field === "paid") return episode.reward[row];
  if (field === "action" || field === "mask" || field === "info" || field === "odd") return episode.textOf(episode[field][row]);
  if (field in episode.terms) return episode.terms[field][row];
  return episode[field][row];
};

// {turn, agent, field} of the first difference, or null where there is none.
gk.firstDifference = (a, b) => {
  const seats = a.agents.map((agent) => b.seat.get(agent.name) ?? -1);
  const fields = [...FIELDS, ...Object.keys(a.terms).filter((term) => term in b.terms)];
  const shorter = Math.min(a.last, b.last);
  for (let turn = 0; turn <= shorter; turn++) {
    const [from, past] = a.rowsAt(turn);
    const [fromB, pastB] = b.rowsAt(turn);
    for (let row = from; row < past; row++) {
      const agent = a.agent[row];
      const rowB = seats[agent] < 0 ? -1 : rowIn(b, fromB, pastB, seats[agent], row - from);
      if (rowB < 0) return { turn, agent: a.agents[agent].name, field: "row" };
      const field = fields.find((name) => !same(gk.field(a, row, name), gk.field(b, rowB, name)));
      if (field !== undefined) return { turn, agent: a.agents[agent].name, field };
    }
    if (pastB - fromB !== past - from) return { turn, agent: extraAgent(a, b, turn), field: "row" };
  }
  return a.last === b.last ? null : { turn: shorter + 1, agent: null, field: "length" };
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
    if (!a.seat.has(name) || a.rowOf(a.seat.get(name), turn) < 0) return name;
  }
  return null;
};
