// What was recorded of a few demonstrations, drawn over one another; a choice of columns.
const N_CURVES = 2; // columns that are drawn at first
const N_PHASES = 64; // points at which two demonstrations of different lengths are compared
const MAX_CLASSES = 12; // that are named beside an axis

// The columns of the view in the order in which two demonstrations differ: by the mean distance of their curves, each
// from its start to its end, in spreads of the column in all demonstrations.
const byDifference = (columns, a, b) => {
  const at = (values, share) => values[Math.min(values.length - 1, Math.floor(share * values.length))];
  const distance = columns.map((column, c) => {
    const first = unpack(a[c], "value"), second = unpack(b[c], "value");
    let sum = 0;
    for (let k = 0; k < N_PHASES; k++) sum += Math.abs(at(first, k / N_PHASES) - at(second, k / N_PHASES));
    return column.spread ? sum / N_PHASES / column.spread : 0;
  });
  return columns.map((_, c) => c).sort((one, other) => distance[other] - distance[one]);
};

// `members` have a number m, steps n, and a colour: those that are compared first. `curves` are of each of them.
const makeCurves = (columns, members, curves, fps, hasSeconds, seek) => {
  const order = byDifference(columns, curves[0], curves[1] ?? curves[0]);
  const longest = Math.max(...members.map((one) => one.n)), unit = hasSeconds ? fps : 1;
  const box = el("div", { class: "overlays" }), charts = [];

  const draw = (place, c) => {
    const colours = palette(), style = getComputedStyle(document.documentElement); // of now: light or dark
    const column = columns[c], size = 400, x = Array.from({ length: Math.min(size, longest) }, (_, k) => (k * longest) / Math.min(size, longest));
    const values = members.map((one, k) => {
      const own = unpack(curves[k][c], "value");
      return x.map((step) => (step < one.n ? own[Math.min(own.length - 1, Math.floor((step * own.length) / one.n))] : null));
    });
    const named = column.classes.length && column.classes.length <= MAX_CLASSES;
    const lines = members.map((one) => ({
      stroke: style.getPropertyValue(`--${one.colour}`).trim(), width: one.colour === "muted" ? 1 : 1.8, dash: one.colour === "second" ? [6, 3] : [],
      points: { show: false }, spanGaps: false, ...(column.classes.length ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
    }));
    const chart = new uPlot({
      width: Math.max(200, place.clientWidth), height: 150, legend: { show: false }, padding: [6, 8, 0, 0],
      scales: { x: { time: false, range: [0, longest / unit] }, y: named ? { range: [-0.5, column.classes.length - 0.5] } : {} },
      series: [{}, ...lines],
      axes: [axisOf(colours, { size: 22, grid: { show: false }, values: plainNumbers }),
        axisOf(colours, named ? { size: 80, splits: column.classes.map((_, k) => k), values: () => column.classes } : { size: 50, values: plainNumbers, space: 24 })],
      cursor: { y: false, drag: { x: false, y: false }, points: { size: 6 } },
    }, [x.map((step) => step / unit), ...values], place);
    chart.over.addEventListener("click", () => { if (chart.cursor.left >= 0) seek(Math.floor(chart.posToVal(chart.cursor.left, "x") * unit)); });
    return chart;
  };
  const makeOne = (k) => {
    const place = el("div", { class: "chart" }), select = el("select", { "aria-label": `Column ${k + 1}`, onchange: () => change(Number(select.value)) },
      order.map((c) => el("option", { value: c }, `${columns[c].name}${columns[c].is_action ? " (action)" : ""}`)));
    let chart = null;
    const change = (c) => {
      chart?.destroy();
      chart = charts[k] = draw(place, c);
      charts[k].column = c;
    };
    box.append(el("figure", {}, el("figcaption", {}, select), place));
    select.value = order[k];
    return () => change(Number(select.value));
  };
  const made = order.slice(0, N_CURVES).map((_, k) => makeOne(k));
  // Drawn once they are on the page, when their width is known.
  const show = () => { for (const one of made) one(); };
  const at = (step) => {
    for (const chart of charts) chart?.setCursor({ left: chart.valToPos((step + 0.5) / unit, "x"), top: 10 });
  };
  const resize = () => {
    for (const chart of charts) chart?.setSize({ width: Math.max(200, chart.root.parentElement.clientWidth), height: chart.height });
  };
  new ResizeObserver(resize).observe(box);
  return { box, show, at, order };
};
