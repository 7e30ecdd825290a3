// The audit of the page comes to life.
const start = (article, before = null) => {
  const view = JSON.parse(article.querySelector('script[type="application/json"]').textContent);
  if (before) { // the order of looking stays while one works
    view.demonstrations.look = before.look;
    view.n_review = before.n_review;
  }
  const model = makeModel(view), { state } = model, part = (role) => article.querySelector(`[data-role="${role}"]`);
  let chosen = null, axis = null, step = 0;
  article.querySelector(".work").hidden = false;

  const choose = (m, show = true, at = (!model.isOpen(m) && view.segments[m]?.find(([, , , why]) => why)?.[0]) || 0) => {
    [chosen, step] = [m, at];
    table.select(m, show);
    detail.show(m);
    axis?.redraw();
    moved(m, at);
  };
  // The address names what is chosen and the place in it, so that it can be sent and opened again.
  let timer = null;
  const moved = (m, at) => {
    if (m !== chosen) return;
    step = at;
    detail.at(at);
    clearTimeout(timer);
    timer = setTimeout(() => link(m, at), 300);
  };
  const link = (m, at) => {
    if (!article.isConnected) return;
    const place = view.fps ? { t: (at / view.fps).toFixed(1) } : { step: at };
    history.replaceState(null, "", `#${new URLSearchParams({ episode: view.demonstrations.id[m], ...(at ? place : {}) })}`);
  };
  // The demonstration and the step that an address names, or null.
  const find = (address) => {
    const named = new URLSearchParams(address.slice(1)), m = view.demonstrations.id.indexOf(named.get("episode"));
    const at = named.has("t") ? Math.round(Number(named.get("t")) * (view.fps || 1)) : Number(named.get("step"));
    return m < 0 ? null : [m, at > 0 && at < view.demonstrations.n_steps[m] ? at : 0];
  };
  const follow = (address) => {
    const found = find(address);
    if (!found) return false;
    if (found[0] !== chosen) choose(found[0], true, found[1]);
    live?.seek(found[1]);
    moved(...found);
    return true;
  };
  const changed = () => {
    const shown = table.update();
    review.setAttribute("aria-pressed", String(state.review));
    if (search.value !== state.text) search.value = state.text;
    part("shown").textContent = shown.length === model.size ? count(model.size, "demonstration") : `${shown.length.toLocaleString("en")} of ${count(model.size, "demonstration")}`;
    if (!shown.length) detail.empty();
    else if (!shown.includes(chosen)) choose(shown[0], false);
  };
  const tell = () => {
    const sizes = MARKS.map((word) => [[...model.marks.values()].filter((mark) => mark === word).length, word]).filter(([size]) => size);
    part("marked").textContent = sizes.length ? `Your marks: ${sizes.map((one) => one.join(" ")).join(", ")}.` : "No marks yet.";
    part("kept").textContent = model.lasts ? "This browser keeps them." : "This browser does not keep them: download them before you close the page.";
    part("undo").disabled = !model.canUndo();
    detail.marked();
    if (state.mark.size) changed();
    else table.draw(true);
  };
  // Rows that are begun with one key and ended with another are what the next mark is about.
  let begun = null;
  const bound = (more) => {
    begun = more(step);
    detail.bands();
  };
  const ends = (at) => (begun?.m === chosen ? { ...begun, start: Math.min(begun.start, at), end: Math.max(begun.start, at) + 1 } : null);
  const mark = (word) => {
    if (chosen === null) return;
    const rows = begun?.m === chosen && begun.end !== undefined ? [begun.start, begun.end] : [];
    begun = null;
    if (live) {
      if (word || !rows.length) live.mark(word, chosen, rows);
      else detail.bands();
      return;
    }
    model.mark(chosen, word, ...rows);
    if (rows.length) detail.bands();
    tell();
  };
  const undo = live ? live.undo : () => {
    const m = model.undo();
    if (m !== undefined) choose(m);
    tell();
  };
  const turn = (by) => { if (table.shown().length) choose(table.step(by)); };

  const table = makeTable(model, part("box"), choose);
  const detail = makeDetail(model, part("detail"), { mark, turn, moved, step: () => step, seek: (at) => (live ? live.seek(at) : moved(chosen, at)), get begun() { return begun; } });
  const filters = makeFilters(model, part("filters"), changed);
  const review = part("review"), search = part("search");
  review.textContent = view.n_review ? `Show the ${view.n_review.toLocaleString("en")} to look at` : "None to look at";
  review.disabled = !view.n_review;
  review.addEventListener("click", () => {
    const on = !state.review;
    filters.clear();
    state.review = on;
    state.sort = "look";
    state.down = false;
    changed();
    if (on) choose(table.shown()[0]);
    table.focus();
  });
  search.addEventListener("input", () => {
    state.text = search.value;
    changed();
  });
  part("labels").addEventListener("click", () => download("labels.csv", "text/csv", model.labels()));
  part("keep").addEventListener("click", () => download("keep.json", "application/json", model.keep()));
  part("undo").addEventListener("click", undo);
  part("help").addEventListener("click", () => showKeys(keys));
  for (const button of article.querySelectorAll("[data-rule]")) {
    button.disabled = false;
    button.addEventListener("click", () => {
      filters.only("fault", button.dataset.rule);
      article.querySelector(".work").scrollIntoView();
    });
  }

  for (const button of article.querySelectorAll("[data-choose]")) {
    button.disabled = false;
    button.addEventListener("click", () => {
      filters.clear();
      changed();
      choose(Number(button.dataset.choose));
      article.querySelector(".work").scrollIntoView();
    });
  }

  const drawAxis = () => {
    axis?.destroy();
    const by = colouring(model);
    axis = orderChart(model, part("axis"), () => chosen, choose);
    part("hues").replaceChildren(...(by ? [`Colour: ${by.title}.`, ...by.names.map((name, k) => el("span", {}, el("i", { style: `background:${HUES[k]}` }), printable(name) || "not named"))] : []));
  };
  const show = () => {
    table.draw(true);
    detail.redraw();
    if (model.order.length > 1) {
      part("order").hidden = false;
      drawAxis();
    }
  };
  new ResizeObserver(() => axis?.setSize({ width: Math.max(280, part("axis").clientWidth), height: 220 })).observe(part("axis"));
  if (before) {
    for (const [key, value] of Object.entries(before.state)) state[key] = value;
    filters.show();
  }
  const first = before ? [before.chosen ?? live.first(), before.step] : find(location.hash) ?? [live?.first() ?? null, 0];
  chosen = first[0];
  changed();
  tell();
  if (first[0] !== null) choose(first[0], true, first[1]);
  live?.open(model, { step, told: (m, at) => moved(model.isOpen(chosen) ? chosen : m, at) });

  // Each key, what it does in words for the list of keys, and what it runs; a review adds its own.
  const keys = [
    ["j", "next demonstration", () => turn(1)], ["k", "previous demonstration", () => turn(-1)],
    ["g", "good", () => mark("good")], ["b", "bad", () => mark("bad")],
    ["[", "the steps to mark begin here", () => bound((start) => ({ m: chosen, start }))], ["]", "they end here: then g or b", () => bound(ends)],
    ["z", live ? "undo the last answer" : "undo the last mark", undo],
    ["/", "search", () => search.focus()],
    ["Escape", "clear the filters", () => { filters.clear(); changed(); table.focus(); }],
    ...(live ? live.keys(() => chosen) : [["u", "no mark", () => mark("")]]),
    ["?", "these keys", () => showKeys(keys)],
  ];
  const showChanged = () => filters.only("changed", "changed");
  return { show, choose, follow, showChanged, keys, model, shown: () => table.shown(), kept: () => ({ chosen, step, state, look: view.demonstrations.look, n_review: view.n_review }) };
};

// The list of keys, over the page.
const showKeys = (keys) => {
  const rows = keys.map(([key, words]) => el("tr", {}, el("th", { scope: "row" }, el("kbd", {}, key === " " ? "space" : key)), el("td", {}, words)));
  const box = el("dialog", { class: "keys", "aria-label": "Keys", onclick: () => box.close(), onclose: () => box.remove() },
    el("h2", {}, "Keys"), el("table", {}, el("tbody", {}, rows)), el("button", { type: "button" }, "Close"));
  document.body.append(box);
  box.showModal();
};

let report = start(document.querySelector("main > article"));
// The address of the event: that of the page may have been replaced by what is shown since.
addEventListener("hashchange", ({ newURL }) => report.follow(newURL.match(/#.*/)?.[0] ?? ""));
addEventListener("keydown", (event) => {
  const { target } = event, typing = target.matches?.("input:not([type=range]), select, textarea");
  const own = event.key === " " && target.matches?.("button:focus-visible, summary:focus-visible, a:focus-visible"); // pressed by the keyboard
  const found = report.keys.find(([key]) => key === event.key);
  if (event.ctrlKey || event.metaKey || event.altKey || (typing && event.key !== "Escape") || own || !found || document.querySelector("dialog[open]")) return;
  event.preventDefault();
  if (event.key === " ") target.blur?.();
  found[2]();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  report.show();
  live?.redraw();
});
report.show();
