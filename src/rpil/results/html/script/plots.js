// Drawings: curves of steps, and the order of recording.
const MAX_NAMED = 12;
const POWERS = [-1e5, -1e4, -1e3, -100, -10, -3, 0, 3, 10, 100, 1e3, 1e4, 1e5];
const palette = () => {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(["ink", "muted", "line", "page", "upper", "open", "lower"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
};
const axisOf = (colours, more) => ({
  stroke: colours.muted, font: "11px system-ui, sans-serif", grid: { stroke: colours.line, width: 1 }, ticks: { show: false }, gap: 3, ...more,
});
const plainNumbers = (_, ticks) => ticks.map((tick) => (tick === null ? null : short(tick)));
const curve = (stroke, width = 1.5) => ({ stroke, width, points: { show: false }, spanGaps: false });
const shade = (colour, alpha) => {
  const code = parseInt(colour.slice(1), 16);
  return `rgba(${code >> 16}, ${(code >> 8) & 255}, ${code & 255}, ${alpha})`;
};

// Curves over the steps of demonstration m; each chart has a title, curves, and a band between its last two.
const stepCharts = (model, m, drawing, place, readout, seek) => {
  const { d, view } = model, colours = palette(), n = d.n_steps[m], bins = atob(drawing.trust.mean).length;
  const first = Array.from({ length: bins }, (_, k) => Math.floor((k * n) / bins));
  const unit = view.fps || 1, x = first.map((start) => start / unit);
  const say = (k) => readout(k === null ? null : first[k]);
  const stretch = d.stretch[m], worst = d.worst[m].map((step) => step / unit);
  // Where to look: the worst steps in a row as a stripe, each of the worst as a mark at the foot.
  const marks = (u) => {
    const { ctx, bbox } = u, at = (step) => u.valToPos(step, "x", true);
    ctx.save();
    ctx.fillStyle = shade(colours.lower, 0.1);
    if (stretch) ctx.fillRect(at(stretch[0] / unit), bbox.top, Math.max(2, at((stretch[1] + 1) / unit) - at(stretch[0] / unit)), bbox.height);
    ctx.fillStyle = colours.lower;
    for (const step of worst) ctx.fillRect(at(step) - 1, bbox.top + bbox.height - 7, 2.5, 7);
    ctx.restore();
  };
  const one = (title, curves, band, range, height) => {
    const box = el("div", { class: "chart" });
    place.append(el("figure", {}, el("figcaption", {}, title), box));
    const data = [x, ...curves.map((own) => own.values)];
    const options = {
      width: Math.max(200, box.clientWidth), height, legend: { show: false }, scales: { x: { time: false }, y: { range } },
      series: [{}, ...curves.map((own) => own.style)], padding: [6, 8, 0, 0],
      bands: band ? [{ series: [curves.length, curves.length - 1], fill: band, dir: -1 }] : [],
      axes: [axisOf(colours, { size: 22, grid: { show: false }, values: plainNumbers }), axisOf(colours, { size: 44, values: plainNumbers, space: 24 })],
      cursor: { y: false, drag: { x: false, y: false }, points: { size: 6 }, sync: { key: "steps" } },
      hooks: { drawClear: [marks], setCursor: [(u) => say(u.cursor.idx ?? null)] },
    };
    const made = new uPlot(options, data, box);
    made.over.addEventListener("click", () => { if (made.cursor.idx !== null) seek(first[made.cursor.idx]); });
    return made;
  };
  const ratio = drawing.ratio;
  const evidence = one("Evidence of the steps; below 0 they differ from most others",
    [{ values: first.map(() => 0), style: curve(colours.muted, 1) }, { values: unpack(ratio, "mean"), style: curve(colours.ink, 1.7) },
      { values: unpack(ratio, "min"), style: curve(shade(colours.open, 0.4), 0.5) }, { values: unpack(ratio, "max"), style: curve(shade(colours.open, 0.4), 0.5) }],
    shade(colours.open, 0.25), undefined, 130);
  const likeness = one("How far the rest explain the steps",
    [{ values: unpack(drawing.trust, "mean"), style: { ...curve(colours.upper), fill: shade(colours.upper, 0.15) } }], null, [0, 1], 84);
  return [evidence, likeness];
};

const shapes = {
  upper: (ctx, x, y, r) => { ctx.arc(x, y, r, 0, 7); ctx.fill(); },
  open: (ctx, x, y, r) => { ctx.arc(x, y, r, 0, 7); ctx.stroke(); },
  lower: (ctx, x, y, r) => { ctx.moveTo(x, y - r * 1.3); ctx.lineTo(x + r * 1.3, y); ctx.lineTo(x, y + r * 1.3); ctx.lineTo(x - r * 1.3, y); ctx.fill(); },
};

// Who or what may colour the scores: the operators, or else the sessions, where there are several and not too many.
const HUES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a6d00", "#7a5195"];
const colouring = ({ d }) => {
  for (const [title, column] of [["operator", d.demonstrator], ["session", d.session]]) {
    const names = [...new Set(column)].sort(collator.compare);
    if (names.length > 1 && names.length <= HUES.length) return { title, names, hue: (m) => HUES[names.indexOf(column[m])] };
  }
  return null;
};

// Scores in the order of recording; shapes as in the table, so that verdicts do not depend on colour alone.
const orderChart = (model, box, chosen, choose) => {
  const { d } = model, colours = palette();
  const row = d.id.map((_, m) => m).sort((a, b) => model.order[a] - model.order[b]), coloured = colouring(model);
  const starts = row.flatMap((m, k) => (k && d.session[m] !== d.session[row[k - 1]] ? [k] : []));
  const draw = (u) => {
    const { ctx, bbox } = u, r = (row.length > 1000 ? 2 : 3.5) * devicePixelRatio;
    ctx.save();
    ctx.lineWidth = 1.3 * devicePixelRatio;
    row.forEach((m, k) => {
      if (model.isOpen(m)) return;
      const x = u.valToPos(k + 1, "x", true), y = u.valToPos(d.log_odds[m], "y", true), side = model.side(m);
      ctx.fillStyle = ctx.strokeStyle = coloured ? coloured.hue(m) : colours[side];
      ctx.beginPath();
      shapes[side](ctx, x, y, r);
      if (m === chosen()) {
        ctx.strokeStyle = colours.ink;
        ctx.beginPath();
        ctx.arc(x, y, 2.4 * r, 0, 7);
        ctx.stroke();
      }
    });
    ctx.setLineDash([3, 4]);
    ctx.lineWidth = devicePixelRatio;
    ctx.strokeStyle = ctx.fillStyle = colours.muted;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    if (starts.length && starts.length < MAX_NAMED) [0, ...starts].forEach((k) => {
      ctx.fillText(printable(d.session[row[k]]), u.valToPos(k + 0.5, "x", true) + 4, bbox.top + 11 * devicePixelRatio);
    });
    for (const k of starts) {
      const x = u.valToPos(k + 0.5, "x", true);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  };
  const made = new uPlot({
    width: Math.max(280, box.clientWidth), height: 220, legend: { show: false }, padding: [10, 10, 0, 0],
    scales: { x: { time: false, range: [0.5, row.length + 0.5] }, y: { distr: 4, asinh: 3, range: (_, low, high) => [1.5 * Math.min(low, -2), 1.5 * Math.max(high, 2)] } },
    series: [{}, { paths: () => null, points: { show: false } }],
    axes: [axisOf(colours, { size: 26, grid: { show: false }, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000] }), axisOf(colours, { size: 52, values: plainNumbers, splits: (_, axis, low, high) => POWERS.filter((value) => value >= low && value <= high) })],
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    hooks: { draw: [draw] },
  }, [row.map((_, k) => k + 1), row.map((m) => d.log_odds[m])], box);
  made.over.addEventListener("click", () => { if (made.cursor.idx !== null) choose(row[made.cursor.idx]); });
  return made;
};
