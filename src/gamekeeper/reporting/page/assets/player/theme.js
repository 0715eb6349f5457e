// The colours of the style sheet, for canvases; asked anew when the reader's system changes between light and dark, and for paper.

let known = null;
const listeners = [];

// Colours and font by their names in style.css: gk.colours()["--accent"].
gk.colours = () => {
  if (known === null) {
    const style = getComputedStyle(document.documentElement);
    const names = ["ink", "grey", "line", "ground", "raised", "accent", "gain", "loss", "mark", "band", "idle", "cumulative"];
    known = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    known.series = [1, 2, 3, 4, 5, 6, 7, 8].map((n) => style.getPropertyValue(`--series-${n}`).trim());
    known.font = style.getPropertyValue("--font").trim() || "sans-serif";
  }
  return known;
};

// Agents and roles of all runs on the page, in their order: by its place an agent has its colour, and a role its shape, wherever they are drawn.
let places = null;

const placesOf = () => {
  if (places?.runs !== gk.page.runs) {
    const agents = gk.page.runs.flatMap((run) => run.agents ?? []);
    const numbered = (names) => new Map([...new Set(names)].map((name, i) => [name, i]));
    places = { runs: gk.page.runs, agent: numbered(agents.map(([name]) => name)), role: numbered(agents.map(([, role]) => role)), term: new Map() };
  }
  return places;
};

gk.placeOf = (kind, name) => {
  const known = placesOf()[kind];
  if (!known.has(name)) known.set(name, known.size);
  return known.get(name);
};

// Whether two agents of the page have one colour.
gk.coloursRepeat = () => placesOf().agent.size > gk.colours().series.length;

gk.colourAt = (place) => {
  const { series } = gk.colours();
  return series[place % series.length];
};

// A reward term's colour, of other colours than the agents', in the table's head and in charts.
gk.signTerm = (element, name) => element.classList.add(`term-${1 + (gk.placeOf("term", name) % 6)}`);

const CLIPS = ["circle(50%)", "none", "polygon(50% 0, 100% 100%, 0 100%)", "polygon(50% 0, 100% 50%, 50% 100%, 0 50%)"];

// An agent's colour and its role's shape, as on the map, for an element of its own.
gk.signAgent = (element, { name, role }) => {
  element.style.background = `var(--series-${1 + (gk.placeOf("agent", name) % 8)})`;
  element.style.clipPath = CLIPS[gk.placeOf("role", role) % CLIPS.length];
};

// The sign of a lane: of a folded role its shape in grey.
gk.signLane = (element, episode, { agents, fold }) => {
  const member = episode.agents[agents[0]];
  gk.signAgent(element, member);
  if (fold === undefined) return;
  element.style.background = "var(--grey)";
  if (fold !== member.role) element.style.clipPath = "none";
};

// Calls back when colours changed, so that canvases are drawn again.
gk.onColours = (listener) => {
  listeners.push(listener);
};

const forget = () => {
  known = null;
  listeners.forEach((listener) => listener());
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", forget);

// Paper is light, whatever the screen is: canvases are drawn for it before the page is laid out.
const paper = (isPaper) => () => {
  document.documentElement.classList.toggle("paper", isPaper);
  forget();
};
window.addEventListener("beforeprint", paper(true));
window.addEventListener("afterprint", paper(false));
