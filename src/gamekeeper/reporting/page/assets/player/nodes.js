// Making elements. Text from data stands in text nodes and in attributes of the names given here, never in markup.

const LONG = 300; // characters of a value that a cell shows; its title has more
const LONGEST = 4000;

// What an object out of data has under a name out of data; never what every object has, such as "constructor".
gk.own = (object, name) => (object && Object.hasOwn(object, name) ? object[name] : null);

// An element with attributes (a fixed name each; `text`: what stands in it) and children.
gk.node = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") made.textContent = value;
    else if (value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
};

// A button with its attributes (`text`, or children) that does `work` when it is pressed.
gk.button = (work, attributes = {}, ...children) => {
  const made = gk.node("button", { type: "button", ...attributes }, ...children);
  made.addEventListener("click", work);
  return made;
};

// An element of a drawing; its attributes are numbers and names of ours.
gk.svg = (tag, attributes = {}, text = null) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== null) made.textContent = text;
  return made;
};

// A name out of data: set apart, so that its direction of writing turns nothing around it.
gk.name = (text) => gk.node("bdi", { text: gk.visible(text) });

// Signs that change the direction of writing, or that are invisible, as their code points.
gk.visible = (text) =>
  String(text).replace(
    /[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff]/g,
    (sign) => `\\u${sign.charCodeAt(0).toString(16).padStart(4, "0")}`,
  );

// Text into a node, only where it is another one: layout is not asked for nothing.
gk.say = (node, text, title = "") => {
  if (node.textContent !== text) node.textContent = text;
  if (node.title !== title) node.title = title;
};

// Any JSON value as one line.
gk.plain = (value) => {
  if (value === undefined || value === null) return "";
  if (typeof value === "number") return gk.number(value);
  return gk.visible(typeof value === "string" ? value : JSON.stringify(value));
};

// The same, short enough for a cell, with the long form as its title.
gk.sayValue = (node, value) => {
  const text = gk.plain(value);
  if (text.length <= LONG) gk.say(node, text);
  else gk.say(node, `${text.slice(0, LONG)}…`, text.slice(0, LONGEST));
};

// A number in at most six significant digits.
gk.number = (value) => {
  if (value === null || value === undefined || Number.isNaN(value)) return "";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (Number.isInteger(value) && Math.abs(value) < 1e15) return String(value).replace("-", "−");
  return String(Number(value.toPrecision(6))).replace("-", "−");
};

// The same with three digits, where there is little room.
gk.short = (value) => gk.number(Math.abs(value) < 100 ? Number(value.toPrecision(3)) : Math.round(value));

// A canvas of a size in CSS pixels, sharp on dense screens, with its drawing context.
gk.sized = (canvas, width, height) => {
  const dense = Math.min(window.devicePixelRatio || 1, 3);
  const [w, h] = [Math.max(1, Math.round(width * dense)), Math.max(1, Math.round(height * dense))];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
  }
  const ink = canvas.getContext("2d");
  ink.setTransform(dense, 0, 0, dense, 0, 0);
  return ink;
};

// Runs a function once before the next frame, however often it was asked for.
gk.once = (work) => {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      work();
    });
  };
};
