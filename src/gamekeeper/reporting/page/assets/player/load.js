// The page's data, and episodes: inflated from the page itself, or asked from the server that shows the page.

const KEPT = 6; // episodes held decoded

const held = document.getElementById("gk-data");
gk.page = held ? JSON.parse(held.textContent) : { title: "", runs: [], episodes: [], charts: {} };
gk.served = document.documentElement.dataset.view === "1";

// What may go wrong without anybody's fault here, in words for the reader.
gk.Trouble = class extends Error {};

const decoded = new Map();

const inflated = async (text) => {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return JSON.parse(await new Response(stream).text());
};

// The server's words about what went wrong, or ours where it has none.
const complaint = async (response) => {
  try {
    const { error } = await response.json();
    return [error.what, error.where, error.expected && `expected ${error.expected}`, error.actual && `got ${error.actual}`, error.fix].filter(Boolean).join("; ");
  } catch {
    return `the server answered ${response.status}`;
  }
};

gk.fetched = async (address, more = {}) => {
  let response;
  try {
    response = await fetch(address, { cache: "no-store", credentials: "same-origin", ...more });
  } catch {
    throw new gk.Trouble("the server does not answer; is `gamekeeper view` still running?");
  }
  if (!response.ok) throw new gk.Trouble(await complaint(response));
  return response.json();
};

// An order to the server, where it takes orders (`gamekeeper view --interactive`).
gk.order = (what, order) =>
  gk.fetched(`play-on/${what}`, { method: "POST", body: JSON.stringify(order), headers: { "Content-Type": "application/json", "X-Gamekeeper-Key": gk.page.play_on.key } });

const packed = (run, episode) => {
  const element = document.getElementById(`gk-episode-${run}-${episode}`);
  if (element) {
    if (typeof DecompressionStream === "undefined") throw new gk.Trouble("this browser is too old to inflate episodes (no DecompressionStream)");
    return inflated(element.textContent);
  }
  if (gk.served) return gk.fetched(`episode/${encodeURIComponent(run)}/${encodeURIComponent(episode)}`);
  throw new gk.Trouble("this episode is not in the page");
};

// An episode, decoded; the last few are kept. `again`: it grew, so it is read anew.
gk.load = async (run, episode, { again = false } = {}) => {
  const key = `${run}/${episode}`;
  const found = again ? undefined : decoded.get(key);
  decoded.delete(key);
  const made = found ?? new gk.Episode(await packed(run, episode));
  decoded.set(key, made);
  if (decoded.size > KEPT) decoded.delete(decoded.keys().next().value);
  return made;
};
