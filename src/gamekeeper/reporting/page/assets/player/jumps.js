// Buttons for an episode's marks, in one line: what went wrong first, then the endings.

const NAMED = 24; // marks with a button each; the brackets reach all

const FEW = 3; // turns with endings that have a button each

const names = (agents) => (agents.length > 2 ? `${agents.length} agents` : agents.map(gk.visible).join(" and "));

const WORDS = { failure: "failed", since: "likely cause", divergence: "first difference", pivot: "lost here" };

// A mark in words; several agents may have one ending.
gk.markText = (mark) => {
  const who = mark.agents ? names(mark.agents) : mark.agent === null || mark.agent === undefined ? "" : gk.visible(mark.agent);
  const text = gk.visible(mark.text ?? "");
  return mark.kind === "ending" ? [who, text].filter(Boolean).join(" ") : [gk.own(WORDS, mark.kind) ?? mark.kind, who, text].filter(Boolean).join(", ");
};

// Endings of one turn with one reason as one mark; those of many turns, too: they would be a wall of buttons.
const together = (marks) => {
  const turns = (wanted) => new Set(marks.filter(({ kind, text }) => kind === "ending" && text === wanted).map(({ turn }) => turn)).size;
  const key = ({ kind, turn, text, side }, i) => (kind !== "ending" ? i : turns(text) > FEW ? `${side} ${text}` : `${turn} ${side} ${text}`);
  const groups = Map.groupBy(marks.map((mark, i) => ({ mark, key: key(mark, i) })), (each) => each.key);
  return [...groups.values()].map(([first, ...more]) => (more.length ? { ...first.mark, until: more.at(-1).mark.turn, agents: [first, ...more].map(({ mark }) => mark.agent) } : first.mark));
};

const turnText = ({ turn, until = turn }) => (until > turn ? `turns ${turn} to ${until}` : `turn ${turn}`);

// `go(mark)`: the reader chose it.
gk.jumpsOf = (every, { several, go }) => {
  const isQuiet = gk.quietOf(every);
  const marks = together(every).sort((a, b) => isQuiet(a) - isQuiet(b) || a.turn - b.turn);
  const made = marks.slice(0, NAMED).map((mark) => {
    const side = several && !mark.both ? `${mark.side}: ` : "";
    const sign = gk.node("span", { "aria-hidden": "true", class: isQuiet(mark) ? "sign sign-quiet" : "sign", text: gk.markSign(mark) });
    const kind = gk.own(gk.MARKS, mark.kind) ? mark.kind : "other";
    return gk.button(() => go(mark), { class: `jump jump-${kind}`, title: gk.markText(mark) }, sign, ` ${turnText(mark)}: `, gk.name(`${side}${gk.markText(mark)}`));
  });
  const more = marks.length - made.length;
  return more > 0 ? [...made, gk.node("span", { class: "note", text: `and ${more} more: [ and ] reach them` })] : made;
};
