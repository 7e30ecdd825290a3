// The filters above the table: a button for each value, or a list where there are many.
const MAX_CHIPS = 8;

const makeFilters = (model, place, changed) => {
  const { state, dimensions } = model;
  const counts = (one) => {
    const sizes = new Map();
    for (let m = 0; m < model.size; m++) for (const value of one.of(m)) sizes.set(value, (sizes.get(value) ?? 0) + 1);
    return sizes;
  };
  const chips = [];
  const toggle = (key, value) => {
    if (!state[key].delete(value)) state[key].add(value);
    show();
    changed();
  };
  const group = (one) => {
    const sizes = counts(one), few = one.values.length <= MAX_CHIPS;
    if (few) {
      const side = (value) => (one.key === "verdict" ? model.view.sides[value] : "");
      const made = one.values.map((value) => {
        const chip = el("button", { type: "button", class: `chip ${side(value)}`, "data-filter": one.key, "data-value": value, onclick: () => toggle(one.key, value) },
          printable(value), one.key === "mark" ? "" : el("small", {}, ` ${(sizes.get(value) ?? 0).toLocaleString("en")}`));
        chips.push([chip, () => chip.setAttribute("aria-pressed", String(state[one.key].has(value)))]);
        return chip;
      });
      return el("div", { class: "filter", role: "group", "aria-label": one.title }, el("span", { class: "muted" }, one.title), made);
    }
    const options = one.values.map((value) => el("option", { value }, `${printable(value)} (${(sizes.get(value) ?? 0).toLocaleString("en")})`));
    const select = el("select", { "data-filter": one.key, onchange: () => {
      state[one.key].clear();
      if (select.selectedIndex) state[one.key].add(one.values[select.selectedIndex - 1]);
      changed();
    } }, el("option", {}, "all"), options);
    chips.push([select, () => { select.selectedIndex = state[one.key].size ? one.values.indexOf([...state[one.key]][0]) + 1 : 0; }]);
    return el("label", { class: "filter" }, el("span", { class: "muted" }, one.title), select);
  };
  const show = () => { for (const [, refresh] of chips) refresh(); };
  const clear = () => {
    for (const one of dimensions) state[one.key].clear();
    state.text = "";
    state.review = false;
    show();
  };
  place.replaceChildren(...dimensions.map(group));
  show();
  return { show, clear, only: (key, value) => { clear(); state[key].add(value); show(); changed(); } };
};
