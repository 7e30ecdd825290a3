// The panel of one demonstration: why it has its verdict, where to look, its facts, and its steps drawn.
const RANK_WORDS = { length: "length", smoothness: "smoothness", path: "length of its path" };

const makeDetail = (model, place, act) => {
  const { d, view, names, found } = model;
  let charts = [], shown = null;

  // A step, as a button that copies where it is.
  const where = (m, step) => {
    const time = view.fps ? (step / view.fps).toFixed(1) : null, label = `${step}${time === null ? "" : ` (${time} s)`}`;
    const text = `${view.lerobot ? "episode" : "demonstration"}=${names[m]}, ${time === null ? `step=${step}` : `t=${time} s`}`;
    const button = el("button", { type: "button", class: "step", title: `Copy “${text}”`, onclick: () => copyText(text, button) }, label);
    return button;
  };
  const list = (items) => items.flatMap((item, k) => (k ? [", ", item] : [item]));
  const facts = (m) => Object.entries(d.facts).flatMap(([name, values]) => {
    if (!(name in RANK_WORDS)) return [el("tr", {}, el("th", { scope: "row" }, name), el("td", { colspan: 2 }, String(values[m])))];
    const rank = el("span", { class: "rank", "aria-hidden": "true" }, el("b", { style: `left:${(100 * values[m]).toFixed(1)}%` }));
    return [el("tr", {}, el("th", { scope: "row" }, RANK_WORDS[name]), el("td", {}, rank), el("td", {}, `more than in ${percent(values[m])} of all`))];
  });
  const named = (m) => [["Task", d.task[m]], ["Operator", d.demonstrator[m]], ["Session", d.session[m]], ["Group", model.isOpen(m) ? "" : d.group[m]],
    ["Explained steps", model.isOpen(m) ? "" : percent(d.reliability[m])], ["Steps", `${d.n_steps[m].toLocaleString("en")}${view.fps ? `, ${model.seconds(d.n_steps[m])}` : ""}`],
    ["Order", d.order.length ? `${d.order[m].toLocaleString("en")} of ${model.size.toLocaleString("en")}` : ""]].filter(([, text]) => text);

  const clear = () => {
    for (const chart of charts) chart.destroy();
    charts = [];
  };
  const drawCharts = (m, box, readout) => {
    const drawing = view.drawings[m];
    if (model.isOpen(m)) return;
    if (!drawing && live) {
      live.load(view, m, () => { if (shown === m) show(m); });
      return;
    }
    if (!drawing) {
      box.append(el("p", { class: "muted" }, `No drawing: only the ${Object.keys(view.drawings).length} that most need a look have one.`));
      return;
    }
    const said = (step) => {
      readout.textContent = step === null ? `${view.fps ? "seconds" : "steps"} from its start` : `step ${step}${view.fps ? `, ${model.seconds(step)}` : ""}`;
    };
    said(null);
    charts = stepCharts(model, m, drawing, box, said, act.seek);
    requestAnimationFrame(() => at(act.step())); // once they are laid out
  };

  const show = (m) => {
    clear();
    shown = m;
    const button = (word, key, label) => el("button", { type: "button", "data-mark": word || "none", "aria-pressed": String((model.marks.get(m) ?? "") === word), onclick: () => act.mark(word) }, label, " ", el("kbd", {}, key));
    const parts = Object.entries(d.evidence).map(([name, values]) => `from ${name} ${number(values[m])}`).join(", ");
    const drawn = el("div", { class: "charts" }), readout = el("p", { class: "readout muted" });
    const said = model.isOpen(m) ? [] : [
      el("p", {}, d.reason[m] && printable(d.reason[m])),
      view.pair.includes(m) ? el("p", {}, el("strong", {}, printable(view.question))) : "",
      view.contradicting.includes(m) ? el("p", {}, el("strong", {}, "Its label contradicts the other answers; look again.")) : "",
      d.worst[m].length ? el("p", {}, "Steps that differ most: ", list(d.worst[m].map((step) => where(m, step))), ".") : "",
    ];
    const verdict = () => [el("span", { class: `verdict ${model.side(m)}` }, d.verdict[m]),
      el("span", { class: "muted" }, `${d.p[m] === null ? `place ${d.rank[m].toLocaleString("en")} of ${model.size.toLocaleString("en")}` : `${view.probability} ${percent(d.p[m])}`}, score ${number(d.log_odds[m])}`, parts ? ` (${parts})` : "")];
    place.replaceChildren(
      el("header", {}, el("h3", {}, names[m]), model.isOpen(m) ? [] : verdict()),
      el("p", { class: "buttons" }, button("good", "g", "Good"), button("bad", "b", "Bad"), live ? live.passing(m) : button("", "u", "No mark"),
        el("span", { class: "turn" }, el("button", { type: "button", "aria-label": "Previous", onclick: () => act.turn(-1) }, "‹"), el("button", { type: "button", "aria-label": "Next", onclick: () => act.turn(1) }, "›"))),
      model.isOpen(m) ? el("p", { class: "muted" }, "It is shown above. The audit's opinion appears after your answer.") : "",
      live && !model.isOpen(m) ? live.look(model, m, { step: act.step(), told: act.moved }) : "",
      makeBands(model, m, act),
      live ? live.said(model, m) : "",
      ...said,
      model.faults[m].length ? el("ul", { class: "own-faults" }, model.faults[m].map((k) => el("li", {}, el("strong", {}, found.rule[k]), `: ${printable(found.sentence[k])}`))) : "",
      ...(model.isOpen(m) ? [] : [drawn, view.drawings[m] ? readout : ""]),
      el("table", { class: "own-facts" }, el("tbody", {}, named(m).map(([name, text]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", { colspan: 2 }, printable(text)))), facts(m))));
    drawCharts(m, drawn, readout);
  };
  // Put the cursor of the charts at a step.
  const at = (step) => {
    for (const chart of charts) chart.setCursor({ left: chart.valToPos((step + 0.5) / (view.fps || 1), "x"), top: 10 });
  };
  const marked = () => {
    for (const one of place.querySelectorAll("[data-mark]")) one.setAttribute("aria-pressed", String((model.marks.get(shown) ?? "none") === one.dataset.mark));
  };
  const resize = () => {
    for (const chart of charts) chart.setSize({ width: Math.max(200, chart.root.parentElement.clientWidth), height: chart.height });
  };
  new ResizeObserver(resize).observe(place);
  return { show, at, marked, bands: () => place.querySelector(".bands").replaceWith(makeBands(model, shown, act)), redraw: () => { if (shown !== null) show(shown); }, empty: () => { clear(); shown = null; place.replaceChildren(el("p", { class: "muted" }, "No demonstration matches.")); } };
};
