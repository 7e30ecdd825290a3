const SVG = "http://www.w3.org/2000/svg";
// All demonstrations at a glance: last frames, or one column as a small curve; some are chosen and answered at once.
const makeSweep = ({ ask, part, answer, undo, why }) => {
  const PER_PAGE = 60, WHEN = { last: (n) => n - 1, middle: (n) => n >> 1, first: () => 0 };
  const chosen = new Set(), curves = new Map(); // curves of a column, once it was shown
  let dialog = null, grid = null, source = null, row = [], page = 0, anchor = null;

  const told = (text) => { dialog.querySelector('[data-role="told"]').textContent = text; };
  const tiles = () => [...grid.children];
  const number = (tile) => Number(tile.dataset.m);
  const tell = () => {
    for (const tile of tiles()) {
      const m = number(tile), mark = part().model.marks.get(m);
      tile.setAttribute("aria-pressed", String(chosen.has(m)));
      tile.querySelector(".mark").className = `mark ${mark ?? ""}`;
      tile.querySelector(".mark").textContent = mark ?? "";
    }
    const n = chosen.size;
    dialog.querySelector('[data-role="chosen"]').textContent = n ? `${n.toLocaleString("en")} chosen` : "Click those that look wrong.";
    for (const button of dialog.querySelectorAll("[data-all]")) button.disabled = !n;
  };
  const pick = (m, on = !chosen.has(m)) => { if (on) chosen.add(m); else chosen.delete(m); };
  const reach = (m) => { // all between the one chosen last and this one
    const [a, b] = [row.indexOf(anchor ?? m), row.indexOf(m)].sort((x, y) => x - y);
    for (const one of row.slice(Math.max(a, 0), b + 1)) pick(one, true);
  };

  const curve = (m) => {
    const values = unpack(curves.get(source), String(m)), low = curves.get(source).from, wide = curves.get(source).to - low || 1;
    const { d } = part().model, longest = d.n_steps.reduce((most, n) => Math.max(most, n), 1);
    const width = Math.max(20, (156 * d.n_steps[m]) / longest);
    const line = values.map((value, k) => (value === null ? "" : `${(2 + (width * k) / (values.length - 1)).toFixed(1)},${(84 - (78 * (value - low)) / wide).toFixed(1)}`)).filter(Boolean).join(" ");
    const svg = document.createElementNS(SVG, "svg"), drawn = document.createElementNS(SVG, "polyline");
    svg.setAttribute("viewBox", "0 0 160 90");
    drawn.setAttribute("points", line);
    svg.append(drawn);
    return svg;
  };
  const picture = (m) => {
    const [camera, when] = source.split(" ");
    if (!when) return curve(m);
    const { d, names } = part().model, step = WHEN[when](d.n_steps[m]);
    return el("img", { src: `/frame/${m}/${camera}/${step}`, loading: "lazy", decoding: "async", alt: `${names[m]}, ${when} frame`, width: 160, height: 120 });
  };
  const draw = async () => {
    const column = source.includes(" ") ? null : source;
    try {
      if (column !== null && !curves.has(column)) curves.set(column, await ask(`/api/column/${column}`));
    } catch (error) {
      told(error.message);
      return;
    }
    const { names, view, seconds, d } = part().model, first = page * PER_PAGE, shown = row.slice(first, first + PER_PAGE);
    grid.replaceChildren(...shown.map((m) => el("button", { type: "button", class: "tile", "data-m": m, "aria-pressed": "false" }, picture(m),
      el("span", { class: "name" }, names[m], " ", el("small", { class: "muted" }, view.fps ? seconds(d.n_steps[m]) : d.n_steps[m].toLocaleString("en")), el("span", { class: "mark" })))));
    dialog.querySelector('[data-role="place"]').textContent = row.length ? `${(first + 1).toLocaleString("en")} to ${(first + shown.length).toLocaleString("en")} of ${row.length.toLocaleString("en")}` : "None";
    dialog.querySelector('[data-turn="-1"]').disabled = !page;
    dialog.querySelector('[data-turn="1"]').disabled = first + PER_PAGE >= row.length;
    tell();
  };
  const turn = async (by) => {
    if (page + by < 0 || (page + by) * PER_PAGE >= row.length) return;
    page += by;
    await draw();
    grid.scrollTop = 0;
    tiles()[0]?.focus();
  };
  const mark = async (key) => {
    const all = [...chosen].sort((a, b) => row.indexOf(a) - row.indexOf(b)), word = key === "b" ? "bad" : "good";
    if (!all.length) return;
    told("…");
    const error = await answer(all, key);
    if (error) {
      told(error);
      return;
    }
    chosen.clear();
    anchor = null;
    tell();
    told(`${all.length.toLocaleString("en")} marked ${word}; z takes ${all.length === 1 ? "it" : "them all"} back.`);
  };
  const back = async () => {
    const error = await undo();
    tell();
    told(error ?? "Taken back.");
  };
  // Rows of the grid have as many tiles as fit.
  const move = (key, isLonger) => {
    const all = tiles(), at = all.indexOf(document.activeElement), across = all.filter((one) => one.offsetTop === all[0].offsetTop).length;
    const to = at < 0 ? 0 : at + { ArrowRight: 1, ArrowLeft: -1, ArrowDown: across, ArrowUp: -across }[key];
    if (!all[to]) return;
    if (isLonger && at >= 0) {
      anchor ??= number(all[at]);
      reach(number(all[to]));
      tell();
    } else anchor = null;
    all[to].focus();
  };
  const press = (event) => {
    if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
    const { key } = event;
    const own = {
      b: () => mark("b"), g: () => mark("g"), z: back, x: () => document.activeElement.closest(".tile")?.click(),
      Escape: () => { if (chosen.size) { chosen.clear(); tell(); } else dialog.close(); }, PageDown: () => turn(1), PageUp: () => turn(-1),
    };
    const act = key.startsWith("Arrow") ? () => move(key, event.shiftKey) : Object.hasOwn(own, key) ? own[key] : null;
    if (!act) return;
    event.preventDefault();
    act();
  };
  const build = async () => {
    const { videos, frames } = await ask("/api/films/0"), columns = part().model.view.columns.map(({ name }) => name);
    const films = (frames ? videos : []).flatMap(({ camera }, k) => Object.keys(WHEN).map((when) => [`${k} ${when}`, `${when} frame, ${printable(camera.replace(/^observation\.images?\./, ""))}`]));
    const sources = [...films, ...columns.map((name, k) => [String(k), printable(name)])];
    source = sources[0][0];
    const button = (label, key, more, act) => el("button", { type: "button", ...more, onclick: act }, label, " ", el("kbd", {}, key));
    grid = el("div", { class: "grid" });
    grid.addEventListener("click", ({ target, shiftKey }) => {
      const tile = target.closest(".tile");
      if (!tile) return;
      if (shiftKey) reach(number(tile));
      else pick(number(tile));
      anchor = number(tile);
      tell();
    });
    dialog = el("dialog", { class: "sweep", "aria-label": "All demonstrations at a glance" },
      el("div", { class: "buttons" },
        el("label", {}, el("span", { class: "muted" }, "Shown: "), el("select", { "data-role": "source", onchange: ({ target }) => { source = target.value; draw(); } }, sources.map(([value, text]) => el("option", { value }, text)))),
        el("strong", { "data-role": "chosen" }), button("Bad", "b", { "data-all": "b" }, () => mark("b")), button("Good", "g", { "data-all": "g" }, () => mark("g")), button("Undo", "z", {}, back),
        el("label", {}, el("span", { class: "muted" }, "Note "), el("input", { type: "text", class: "short", maxlength: 500, oninput: ({ target }) => why(target.value) })),
        button("Close", "Esc", { class: "close" }, () => dialog.close())),
      grid,
      el("div", { class: "buttons" }, el("button", { type: "button", "data-turn": "-1", onclick: () => turn(-1) }, "‹ Back"), el("span", { "data-role": "place" }), el("button", { type: "button", "data-turn": "1", onclick: () => turn(1) }, "More ›"),
        el("span", { "data-role": "told", role: "status" }), el("span", { class: "keys muted" }, "Shift and a click, or an arrow, choose several; ", el("kbd", {}, "x"), " this one.")));
    // Of the whole page: a button that was pressed and is off now has lost the focus.
    addEventListener("keydown", (event) => { if (dialog.open) press(event); });
    dialog.addEventListener("cancel", (event) => event.preventDefault()); // Escape first lets go what is chosen
    dialog.addEventListener("close", () => { for (const image of grid.querySelectorAll("img")) image.removeAttribute("src"); });
    document.body.append(dialog);
  };
  const open = async () => {
    if (!dialog) await build();
    const shown = part().shown();
    if (shown.length !== row.length || shown.some((m, k) => m !== row[k])) page = 0;
    row = shown;
    chosen.clear();
    dialog.showModal();
    told("");
    dialog.querySelector("input").value = "";
    await draw();
    tiles()[0]?.focus();
  };
  return { open, refresh: () => { if (dialog?.open) tell(); } };
};
