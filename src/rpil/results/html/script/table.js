// The table: only the rows that can be seen are in the page, all of one height, so that thousands are as fast as ten.
const ROW = 34, SPARE = 12;

const columnsOf = (model) => {
  const { d, names, view } = model;
  const bar = (m) => {
    const left = (share) => `left:${(100 * share).toFixed(1)}%`;
    return [
      el("span", { class: `bar ${model.side(m)}`, "aria-hidden": "true" },
        el("b", { style: left(d.reliability[m]) })),
      percent(d.reliability[m]),
    ];
  };
  const text = (key, title, width) => ({ key, title, width, varies: new Set(d[key]).size > 1, cell: (m) => printable(d[key][m]) });
  // What the audit thinks of a demonstration: empty where the question about it is open.
  const opinion = (key, title, width, cell, more) => ({ key, title, width, varies: new Set(d[key]).size > 1, cell: (m) => (model.isOpen(m) ? "" : cell(m)), ...more });
  const right = { right: true }, odd = (m) => d.worst[m].slice(0, 3).map((step) => (view.fps ? (step / view.fps).toFixed(1) : step));
  const all = [
    { key: "look", title: "Order", width: 78, right: true, cell: (m) => d.look[m] + 1, faint: true },
    { key: "id", title: "Demonstration", width: 150, head: true, cell: (m) => names[m] },
    { key: "mark", title: live ? "Your answer" : "Your mark", width: 126, varies: !live || model.marks.size > 0, cell: (m) => (model.marks.has(m)
      ? el("span", { class: `mark ${model.marks.get(m)}` }, model.marks.get(m)) : "") },
    opinion("verdict", "Verdict", 100, (m) => el("span", { class: `verdict ${model.side(m)}` }, d.verdict[m])),
    opinion("rank", "Place", 76, (m) => d.rank[m].toLocaleString("en"), right),
    opinion("p", view.probability, 100, (m) => (d.p[m] === null ? "" : percent(d.p[m])), right),
    opinion("log_odds", "Score", 78, (m) => number(d.log_odds[m]), right),
    opinion("reliability", "Explained steps", 178, bar, { varies: new Set(d.reliability.map(percent)).size > 1 }),
    { key: "n_steps", title: "Steps", width: 76, right: true, varies: new Set(d.n_steps).size > 1, cell: (m) => d.n_steps[m].toLocaleString("en") },
    opinion("group", "Group", 74, (m) => d.group[m]), text("demonstrator", "Operator", 110), text("session", "Session", 110), text("task", "Task", 150),
    { key: "faults", title: "Odd in the recording", width: 198, varies: model.rules.some((own) => own.length), cell: (m) => model.rules[m].join(", ") },
    opinion("worst", view.fps ? "Differs most at (s)" : "Differs most at step", 178, (m) => odd(m).join(", "), { fixed: true, varies: d.worst.some((own) => own.length) }),
  ];
  return all.filter(({ varies = true }) => varies);
};

const makeTable = (model, box, choose) => {
  const columns = columnsOf(model), { state } = model;
  let shown = [], chosen = null, drawn = "";
  const rowId = (m) => `row-${m}`;
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
    const seen = Math.ceil((box.clientHeight || 600) / ROW);
    const first = Math.max(0, Math.floor(box.scrollTop / ROW) - SPARE);
    const end = Math.min(shown.length, first + seen + 2 * SPARE), now = `${first} ${end}`;
    if (now === drawn && !force) return;
    drawn = now;
    above.replaceChildren(...spacer(first));
    body.replaceChildren(...shown.slice(first, end).map((m, k) => row(m, first + k)));
    below.replaceChildren(...spacer(shown.length - end));
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
  return { update, draw, select, step, shown: () => shown, focus: () => table.focus({ preventScroll: true }) };
};
