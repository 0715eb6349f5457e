// Charts of the page's data: lines with bands by uPlot, bars as SVG. Each stands beside a table of the same numbers.

const HEIGHT = 240;
const AT_FIRST = 8; // series shown before the reader asks for more
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3], [12, 5], [4, 4], [1, 4], [9, 2, 2, 2, 2, 2]];

// Lines are agents: each has the colour that it has everywhere.
const placeOf = (line) => gk.placeOf("agent", line.name);
const dashOf = (place) => DASHES[Math.floor(place / 8 + place) % DASHES.length];

// uPlot's columns, series and bands: for each line also its lower and upper bound, where it has them.
const columnsOf = (chart) => {
  const data = [chart.x.values];
  const series = [{ label: chart.x.label }];
  const bands = [];
  const owner = [];
  chart.series.forEach((line, i) => {
    const show = i < AT_FIRST;
    const add = (values, extra) => {
      data.push(values);
      series.push({ show, spanGaps: false, ...extra });
      owner.push(i);
    };
    const few = line.values.filter((value) => value !== null).length < 60;
    const place = placeOf(line);
    const colour = () => gk.colourAt(place);
    add(line.values, { label: line.name, stroke: colour, width: 2, dash: dashOf(place), points: { show: few, size: 5, fill: colour } });
    if (line.low && line.high) {
      add(line.high, { stroke: "transparent", width: 0, points: { show: false } });
      add(line.low, { stroke: "transparent", width: 0, points: { show: false } });
      bands.push({ series: [data.length - 2, data.length - 1], fill: () => `${colour()}33` });
    }
  });
  return { data, series, bands, owner };
};

const WHOLE = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6];

// `whole`: episodes and the like are not numbered by halves.
const axis = (label, whole = false) => ({
  ...(whole ? { incrs: WHOLE } : {}),
  label,
  labelSize: 22,
  stroke: () => gk.colours().ink,
  grid: { stroke: () => gk.colours().line, width: 1 },
  ticks: { stroke: () => gk.colours().line, width: 1 },
  font: "11px sans-serif",
  labelFont: "12px sans-serif",
});

// Vertical lines at marked places, each with its text.
const marksPlugin = (marks) => ({
  hooks: {
    draw: (plot) => {
      const ink = plot.ctx;
      ink.save();
      ink.strokeStyle = ink.fillStyle = gk.colours().mark;
      ink.setLineDash([4, 4]);
      ink.textAlign = "left";
      ink.font = `${12 * (window.devicePixelRatio || 1)}px sans-serif`;
      for (const mark of marks) {
        const x = plot.valToPos(mark.x, "x", true);
        ink.beginPath();
        ink.moveTo(x, plot.bbox.top);
        ink.lineTo(x, plot.bbox.top + plot.bbox.height);
        ink.stroke();
        ink.fillText(gk.visible(mark.text), x + 4, plot.bbox.top + 12);
      }
      ink.restore();
    },
  },
});

// The legend is of check boxes, for the keyboard, and tells the values under the pointer.
const legendOf = (chart, plot, owner) => {
  const values = [];
  const boxes = chart.series.map((line, i) => {
    const box = gk.node("input", { type: "checkbox", checked: i < AT_FIRST });
    const swatch = gk.node("canvas", { class: "swatch", "aria-hidden": "true" });
    const value = gk.node("span", { class: "num" });
    values.push(value);
    box.addEventListener("change", () => owner.forEach((of, at) => of === i && plot.setSeries(at + 1, { show: box.checked })));
    return { swatch, place: placeOf(line), root: gk.node("label", {}, box, swatch, gk.name(line.name), " ", value) };
  });
  const paint = () => boxes.forEach(({ swatch, place }) => paintSwatch(swatch, place));
  paint();
  gk.onColours(paint);
  const tell = (at) => {
    chart.series.forEach((line, i) => gk.say(values[i], at === null || at === undefined ? "" : gk.number(line.values[at])));
  };
  return { root: gk.node("div", { class: "chart-legend" }, ...boxes.map((box) => box.root)), tell };
};

const paintSwatch = (canvas, place) => {
  const ink = gk.sized(canvas, 26, 10);
  ink.clearRect(0, 0, 26, 10);
  ink.strokeStyle = gk.colourAt(place);
  ink.lineWidth = 2.5;
  ink.setLineDash(dashOf(place));
  ink.beginPath();
  ink.moveTo(0, 5);
  ink.lineTo(26, 5);
  ink.stroke();
};

const drawLine = (host, chart) => {
  const { data, series, bands, owner } = columnsOf(chart);
  let legend = null;
  const options = {
    width: Math.max(200, host.clientWidth),
    height: HEIGHT,
    series,
    bands,
    legend: { show: false },
    scales: { x: { time: false } },
    axes: [axis(chart.x.label, chart.x.values.every(Number.isInteger)), { ...axis(chart.y?.label ?? ""), size: 56 }],
    cursor: { drag: { x: true, y: false } },
    plugins: chart.marks?.length ? [marksPlugin(chart.marks)] : [],
    hooks: { setCursor: [(plot) => legend?.tell(plot.cursor.idx)] },
  };
  // The picture is one image to those who don't see it; the legend below it is not part of it.
  const field = gk.node("div", { class: "chart-field", role: "img", "aria-label": host.getAttribute("aria-label") ?? gk.visible(chart.title) });
  host.removeAttribute("role");
  host.removeAttribute("aria-label");
  host.replaceChildren(field);
  const plot = new uPlot(options, data, field);
  legend = legendOf(chart, plot, owner);
  host.append(legend.root);
  let wide = options.width;
  const fit = gk.once(() => {
    if (host.clientWidth === 0 || host.clientWidth === wide) return;
    wide = host.clientWidth;
    plot.setSize({ width: wide, height: HEIGHT });
  });
  new ResizeObserver(fit).observe(host);
  gk.onColours(() => plot.redraw());
};

const THICK = 14; // pixels of a bar
const WIDEST = 720;

// Lying bars, a group a name. Drawn anew where the page gets wider or narrower.
const drawBars = (host, chart) => {
  const field = gk.node("div", { role: "img", "aria-label": host.getAttribute("aria-label") ?? gk.visible(chart.title) });
  host.removeAttribute("role");
  host.removeAttribute("aria-label");
  host.replaceChildren(field, barLegend(chart));
  let wide = 0;
  const fit = gk.once(() => {
    const now = Math.min(WIDEST, host.clientWidth);
    if (now === 0 || now === wide) return;
    wide = now;
    field.replaceChildren(barPicture(chart, wide));
  });
  new ResizeObserver(fit).observe(host);
};

const groupHeight = (chart) => chart.series.length * THICK + 10;
const barsHeight = (chart) => chart.x.names.length * groupHeight(chart) + (chart.series.length > 1 ? 42 : 8);

const barPicture = (chart, wide) => {
  const left = Math.min(150, wide * 0.32);
  const { names } = chart.x;
  const all = chart.series.flatMap((line) => line.values).filter((value) => value !== null);
  const low = Math.min(0, ...all);
  const high = Math.max(0, ...all);
  const x = (value) => left + ((value - low) / (high - low || 1)) * (wide - left - 56);
  const group = groupHeight(chart);
  const picture = gk.svg("svg", { viewBox: `0 0 ${wide} ${names.length * group + 8}`, width: wide, class: "bars", focusable: "false", "aria-hidden": "true" });
  names.forEach((name, i) => {
    const top = i * group + 6;
    const text = gk.visible(name);
    picture.append(gk.svg("text", { x: left - 8, y: top + (chart.series.length * THICK) / 2 + 4, "text-anchor": "end" }, text.length > left / 7 ? `${text.slice(0, Math.floor(left / 7) - 1)}…` : text));
    chart.series.forEach((line, at) => line.values[i] !== null && drawBar(picture, line, line.values[i], x, top + at * THICK));
  });
  picture.append(gk.svg("line", { x1: x(0), x2: x(0), y1: 0, y2: names.length * group + 6, class: "zero" }));
  return picture;
};

// A rectangle in the colour of a series: a reward term.
const barOf = (series, shape) => {
  const made = gk.svg("rect", shape);
  gk.signTerm(made, gk.visible(series.name));
  return made;
};

const drawBar = (picture, series, value, x, y) => {
  const [left, end] = [x(Math.min(0, value)), x(Math.max(0, value))];
  picture.append(barOf(series, { x: left, y, width: Math.max(1, end - left), height: THICK - 3 }));
  picture.append(gk.svg("text", { x: end + 4, y: y + THICK - 4 }, gk.number(Number(value.toPrecision(3)))));
};

const barLegend = (chart) => {
  const items = chart.series.map((line) => {
    const sign = gk.svg("svg", { width: 14, height: 10, "aria-hidden": "true" });
    sign.append(barOf(line, { width: 14, height: 10 }));
    return gk.node("span", { class: "key" }, sign, gk.name(line.name));
  });
  return gk.node("div", { class: "chart-legend" }, ...(chart.series.length > 1 ? items : []));
};

const KINDS = { line: drawLine, bars: drawBars };

// Those in sight are drawn at once, the others when there is time: a page of many charts opens at once. On paper all are.
gk.drawCharts = () => {
  const charts = new Map(Object.values(gk.page.charts ?? {}).map((chart) => [chart.id, chart]));
  const waiting = [];
  for (const host of document.querySelectorAll("[data-chart]")) {
    const chart = charts.get(host.dataset.chart);
    if (!chart || !gk.own(KINDS, chart.kind)) continue;
    // Its height is kept free from the beginning: what a reader looks at further down must not jump.
    host.style.minHeight = `${chart.kind === "bars" ? barsHeight(chart) : HEIGHT + 34}px`;
    waiting.push(drawWhenSeen(host, chart));
  }
  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 50));
  const next = () => {
    waiting.shift()?.();
    if (waiting.length) idle(next);
  };
  idle(next);
};

// Draws it once, at the first of: it comes near, it is printed, the returned function is called.
const drawWhenSeen = (host, chart) => {
  let drawn = false;
  const draw = () => {
    if (drawn) return;
    drawn = true;
    watch.disconnect();
    KINDS[chart.kind](host, chart);
  };
  const watch = new IntersectionObserver((seen) => seen.some((entry) => entry.isIntersecting) && draw(), { rootMargin: "400px" });
  watch.observe(host);
  window.addEventListener("beforeprint", draw);
  return draw;
};
