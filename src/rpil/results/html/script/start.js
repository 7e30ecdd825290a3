// Each audit of the page comes to life; where there are several, one is shown at a time.
const start = (article, prefix, before = null) => {
  const view = JSON.parse(article.querySelector('script[type="application/json"]').textContent);
  if (before) { // the order of looking stays while one works
    view.demonstrations.look = before.look;
    view.n_review = before.n_review;
  }
  const model = makeModel(view), { state } = model, part = (role) => article.querySelector(`[data-role="${role}"]`);
  let chosen = null, axis = null;
  article.querySelector(".work").hidden = false;

  const choose = (m, show = true) => {
    chosen = m;
    table.select(m, show);
    detail.show(m);
    axis?.redraw();
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
    const sizes = MARKS.map((word) => [...model.marks.values()].filter((mark) => mark === word).length);
    part("marked").textContent = model.marks.size ? `Your marks: ${sizes[0]} good, ${sizes[1]} bad.` : "No marks yet.";
    part("kept").textContent = model.lasts ? "This browser keeps them." : "This browser does not keep them: download them before you close the page.";
    part("undo").disabled = !model.canUndo();
    detail.marked();
    if (state.mark.size) changed();
    else table.draw(true);
  };
  const mark = (word) => {
    if (chosen === null) return;
    if (live) {
      live.mark(word, chosen);
      return;
    }
    model.mark(chosen, word);
    tell();
  };
  const undo = live ? live.undo : () => {
    const m = model.undo();
    if (m !== undefined) choose(m);
    tell();
  };
  const step = (by) => { if (table.shown().length) choose(table.step(by)); };

  const table = makeTable(model, part("box"), prefix, choose);
  const detail = makeDetail(model, part("detail"), { mark, step });
  const filters = makeFilters(model, part("filters"), changed);
  const review = part("review"), search = part("search");
  review.textContent = view.n_review ? `Review ${view.n_review.toLocaleString("en")}` : "Nothing to review";
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
  part("copy")?.addEventListener("click", (event) => copyText(`${view.command} --labels labels.csv`, event.target));
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

  const groups = part("groups");
  if (groups && view.demonstrations.group.some(Boolean)) {
    const d = view.demonstrations, inside = d.id.map((_, m) => m).filter((m) => d.group[m]), isFirst = inside.map((m) => d.group[m] === "A");
    const apart = ([, values]) => {
      const mean = (first) => inside.reduce((sum, m, k) => sum + (isFirst[k] === first ? values[m] : 0), 0) / (isFirst.filter((one) => one === first).length || 1);
      return Math.abs(mean(true) - mean(false));
    };
    const fact = Object.entries(d.facts).filter(([name]) => name !== "length" && name in RANK_WORDS).sort((a, b) => apart(b) - apart(a))[0];
    groups.append(groupChart("Steps", inside.map((m) => d.n_steps[m]), isFirst));
    if (fact) groups.append(groupChart(`Rank by ${RANK_WORDS[fact[0]]}`, inside.map((m) => fact[1][m]), isFirst));
  }
  const drawAxis = () => {
    axis?.destroy();
    axis = orderChart(model, part("axis"), () => chosen, choose);
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
  changed();
  tell();
  if (live && (before?.chosen ?? live.first()) !== null) choose(before?.chosen ?? live.first());

  const keys = {
    j: () => step(1), k: () => step(-1), g: () => mark("good"), b: () => mark("bad"), u: () => mark(""), z: undo,
    "/": () => search.focus(),
    Escape: () => { filters.clear(); changed(); table.focus(); },
  };
  if (live) Object.assign(keys, { n: live.note, v: live.sweep });
  if (live) for (const key of "us12345") keys[key] = () => live.press(key, chosen);
  return { show, choose, model, shown: () => table.shown(), kept: () => ({ chosen, state, look: view.demonstrations.look, n_review: view.n_review }), press: (key) => keys[key]?.(), knows: (key) => key in keys, print: table.print };
};

const articles = [...document.querySelectorAll("main > article")];
const parts = articles.map((article, k) => start(article, articles.length > 1 ? `part-${k + 1}-` : ""));
const links = [...document.querySelectorAll(".articles a")];
let current = 0;
const turnTo = (k) => {
  current = k;
  articles.forEach((article, other) => article.classList.toggle("away", other !== k));
  links.forEach((link, other) => (other === k ? link.setAttribute("aria-current", "true") : link.removeAttribute("aria-current")));
  parts[k].show();
};
const turnToHash = () => turnTo(Math.max(0, articles.findIndex((article) => `#${article.id}` === location.hash)));
addEventListener("hashchange", turnToHash);
addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]")) return; // it has keys of its own
  const typing = event.target.matches?.("input, select, textarea");
  if (event.ctrlKey || event.metaKey || event.altKey || (typing && event.key !== "Escape") || !parts[current].knows(event.key)) return;
  event.preventDefault();
  parts[current].press(event.key);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => parts[current].show());
const print = (on) => {
  document.documentElement.classList.toggle("printing", on);
  for (const one of parts) one.print(on);
  parts[current].show();
};
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
turnToHash();
