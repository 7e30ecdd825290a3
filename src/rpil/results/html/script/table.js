// The table: only the rows that can be seen are in the page, all of one height, so that thousands are as fast as ten.
const ROW = 34, SPARE = 12, MAX_PRINTED = 500;

const columnsOf = (model) => {
  const { d, names, view } = model, has = (key) => model.dimensions.some((one) => one.key === key);
  const bar = (m) => {
    const left = (share) => `left:${(100 * share).toFixed(1)}%`;
    return [
      el("span", { class: `bar ${model.side(m)}`, "aria-hidden": "true" },
        el("i", { style: `${left(d.low[m])};width:${(100 * (d.high[m] - d.low[m])).toFixed(1)}%` }),
        el("b", { style: left(d.reliability[m]) })),
      percent(d.reliability[m]),
    ];
  };
  const text = (key, title, width) => ({ key, title, width, cell: (m) => printable(d[key][m]) });
  const all = [
    { key: "look", title: "Order", width: 70, right: true, cell: (m) => d.look[m] + 1, faint: true },
    { key: "id", title: "Demonstration", width: 126, head: true, cell: (m) => names[m] },
    { key: "mark", title: "Mark", width: 66, cell: (m) => (model.marks.has(m)
      ? el("span", { class: `mark ${model.marks.get(m)}` }, model.marks.get(m)) : "") },
    { key: "verdict", title: "Verdict", width: 100, cell: (m) => el("span", { class: `verdict ${model.side(m)}` }, d.verdict[m]) },
    { key: "rank", title: "Place", width: 66, right: true, cell: (m) => d.rank[m].toLocaleString("en") },
    d.p.some((p) => p !== null) && { key: "p", title: view.vocabulary.probability, width: 92, right: true, cell: (m) => (d.p[m] === null ? "" : percent(d.p[m])) },
    { key: "log_odds", title: "Score", width: 88, right: true, cell: (m) => number(d.log_odds[m]) },
    new Set(d.reliability.map(percent)).size > 1 && { key: "reliability", title: "Like the rest", width: 130, cell: bar },
    { key: "n_steps", title: "Steps", width: 70, right: true, cell: (m) => d.n_steps[m].toLocaleString("en") },
    has("group") && text("group", "Group", 74),
    has("demonstrator") && text("demonstrator", "Operator", 110),
    has("session") && text("session", "Session", 110),
    has("task") && text("task", "Task", 150),
    has("fault") && { key: "faults", title: "Faults", width: 130, cell: (m) => model.rules[m].join(", ") },
    { key: "worst", title: "Worst steps", width: 150, fixed: true, cell: (m) => d.worst[m].slice(0, 3).join(", ") },
  ];
  return all.filter(Boolean);
};

const makeTable = (model, box, prefix, choose) => {
  const columns = columnsOf(model), { state } = model;
  let shown = [], chosen = null, drawn = "", printing = false;
  const rowId = (m) => `${prefix}row-${m}`;
  const heads = columns.map((column) => el("th", { scope: "col", class: column.right ? "right" : null },
    column.fixed ? el("div", { class: "plain" }, column.title)
      : el("button", { type: "button", onclick: () => sort(column.key) }, column.title)));
  const body = el("tbody"), above = el("tbody", { "aria-hidden": "true" }), below = el("tbody", { "aria-hidden": "true" });
  const table = el("table", { class: "demonstrations", role: "grid", tabindex: 0, "aria-label": "Demonstrations",
    style: `width:max(100%, ${columns.reduce((sum, column) => sum + column.width, 0)}px)` },
  el("colgroup", {}, columns.map((column) => el("col", { style: `width:${column.width}px` }))),
  el("thead", {}, el("tr", { "aria-rowindex": 1 }, heads)), above, body, below);
  box.replaceChildren(table);

  const row = (m, place) => el("tr", { id: rowId(m), "aria-rowindex": place + 2, "aria-selected": m === chosen ? "true" : "false",
    class: m === chosen ? "chosen" : null, "data-row": m },
  columns.map((column) => el(column.head ? "th" : "td", { scope: column.head ? "row" : null,
    class: [column.right && "right", column.faint && "muted"].filter(Boolean).join(" ") || null,
    title: column.head || column.key === "task" ? model.names[m] && String(column.cell(m)) : null }, column.cell(m))));
  const spacer = (rows) => (rows ? [el("tr", { style: `height:${rows * ROW}px` }, el("td", { colspan: columns.length }))] : []);
  const draw = (force = false) => {
    const seen = printing ? MAX_PRINTED : Math.ceil((box.clientHeight || 600) / ROW);
    const first = printing ? 0 : Math.max(0, Math.floor(box.scrollTop / ROW) - SPARE);
    const end = Math.min(shown.length, first + seen + 2 * SPARE), now = `${first} ${end}`;
    if (now === drawn && !force) return;
    drawn = now;
    above.replaceChildren(...spacer(first));
    body.replaceChildren(...shown.slice(first, end).map((m, k) => row(m, first + k)));
    below.replaceChildren(...spacer(printing ? 0 : shown.length - end));
  };
  const update = () => {
    shown = model.rows();
    table.setAttribute("aria-rowcount", shown.length + 1);
    columns.forEach((column, k) => {
      if (column.key === state.sort) heads[k].setAttribute("aria-sort", state.down ? "descending" : "ascending");
      else heads[k].removeAttribute("aria-sort");
    });
    box.scrollTop = Math.min(box.scrollTop, Math.max(0, shown.length * ROW - box.clientHeight + ROW));
    draw(true);
    return shown;
  };
  const sort = (key) => {
    state.down = state.sort === key && !state.down;
    state.sort = key;
    update();
  };
  const select = (m, show = true) => {
    chosen = m;
    const place = shown.indexOf(m), top = place * ROW, height = box.clientHeight - table.tHead.offsetHeight - ROW - 1;
    if (show && place >= 0 && (top < box.scrollTop || top > box.scrollTop + height)) {
      box.scrollTop = Math.max(0, top - (top < box.scrollTop ? 0 : height));
    }
    draw(true);
    table.setAttribute("aria-activedescendant", rowId(m));
  };
  // The demonstration that is so many rows further down, among those that are shown.
  const step = (by) => {
    const place = shown.indexOf(chosen);
    return shown[place < 0 ? 0 : Math.max(0, Math.min(shown.length - 1, place + by))];
  };
  box.addEventListener("scroll", () => draw(), { passive: true });
  new ResizeObserver(() => draw()).observe(box);
  body.addEventListener("click", (event) => {
    const clicked = event.target.closest("tr")?.dataset.row;
    if (clicked !== undefined) choose(Number(clicked));
  });
  table.addEventListener("keydown", (event) => {
    const page = Math.floor(box.clientHeight / ROW) - 2;
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -Infinity, End: Infinity }[event.key];
    if (by === undefined || !shown.length) return;
    event.preventDefault();
    choose(step(by));
  });
  const print = (on) => {
    printing = on;
    draw(true);
  };
  return { update, draw, select, step, print, sort, shown: () => shown, focus: () => table.focus({ preventScroll: true }) };
};
