// Icons of buttons.

// Signs on buttons as paths in 16 x 16, for fonts don't have them everywhere.
const SIGNS = {
  first: "M2 2h2v12H2z M14 2v12L5 8z",
  markBefore: "M5 4l4 4-4 4-4-4z M15 3v10L9 8z",
  back: "M12 2v12L4 8z",
  play: "M3 1l11 7-11 7z",
  pause: "M3 2h4v12H3z M9 2h4v12H9z",
  next: "M4 2v12l8-6z",
  markAfter: "M11 4l4 4-4 4-4-4z M1 3v10l6-5z",
  last: "M12 2h2v12h-2z M2 2v12l9-6z",
  slower: "M2 7h12v2H2z",
  faster: "M2 7h5V2h2v5h5v2H9v5H7V9H2z",
};

gk.icon = (name) => {
  const path = gk.svg("path", { d: SIGNS[name] });
  const made = gk.svg("svg", { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true", focusable: "false" });
  made.append(path);
  return made;
};
