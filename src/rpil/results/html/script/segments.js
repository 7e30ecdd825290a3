// Where in a demonstration: a band of its segments, coloured by kind, and below it the rows that a reader marked.
const makeBands = (model, m, { begun, seek }) => {
  const { view } = model, n = model.d.n_steps[m], place = (step) => `${(100 * step) / n}%`;
  const span = (start, end) => (view.fps ? `${model.seconds(start)} to ${model.seconds(end)}` : `steps ${start} to ${end - 1}`);
  const piece = ([start, end, kind, why]) => el("button", { type: "button", class: why ? `${kind} told` : kind, style: `left:${place(start)};width:${place(end - start)}`, onclick: () => seek(start),
    title: `${kind}, ${span(start, end)}${why ? `: ${printable(why)}` : ""}`, "aria-label": `${kind}, ${span(start, end)}` });
  const found = (!model.isOpen(m) && view.segments[m]) || [], rows = model.spans().filter(([of]) => of === m).map(([, ...row]) => row), kinds = new Set(found.map(([, , kind]) => kind));
  const chosen = begun && begun.m === m ? [[begun.start, begun.end ?? begun.start + 1, "chosen"]] : [];
  const hint = !chosen.length ? "" : begun.end === undefined ? `From step ${begun.start} on; ] ends it.` : `Steps ${begun.start} to ${begun.end - 1}: g good, b bad; [ begins anew.`;
  return el("div", { class: "bands" }, found.length ? el("div", { class: "band" }, found.map(piece)) : "",
    rows.length + chosen.length ? el("div", { class: "band own" }, [...rows, ...chosen].map(piece)) : "",
    el("p", { class: "readout muted", role: "status" }, hint || [...[...kinds].map((kind) => el("span", { class: `kind ${kind}` }, kind)), " ", el("kbd", {}, "["), " ", el("kbd", {}, "]"), " mark steps"]),
    el("ul", { class: "own-faults" }, found.filter(([, , , why]) => why).map(([start, end, , why]) => el("li", {}, el("button", { type: "button", class: "step", onclick: () => seek(start) }, span(start, end)), `: ${printable(why)}`))));
};
