// What is kept, and why the others are not, before any file is written; then the files, and one command.
const makeFinish = ({ ask, part }) => {
  const WORDS = { labels: "by you", faults: "with odd recordings" }, BY_MODEL = "by inference";
  const store = makeStore("rpil-finish", "sessionStorage");
  const kept = store.read(), spared = new Set(kept.spared), rules = new Set(kept.rules);
  let dialog = null, body = null, isWriting = false, isLess = false;
  const asked = () => ({ spared: [...spared], rules: [...rules] });
  const change = (set, value) => {
    if (!set.delete(value)) set.add(value);
    store.write(asked());
    return show();
  };
  const why = (m, word) => {
    const { view, d, faults, found } = part().model;
    if (word === WORDS.faults) return faults[m].slice(0, 2).map((k) => found.sentence[k]).join("; ");
    const said = view.said.filter(([of, label, note]) => of === m && (label === "bad" || note));
    return word === WORDS.labels ? said.map(([, label, note]) => [label, note].filter(Boolean).join(": ")).join("; ") : d.reason[m];
  };
  const list = (title, members, label, act, reason = () => "") => {
    const box = el("details", {}, el("summary", {}, title));
    // Its entries are made when it is opened: there may be thousands.
    box.addEventListener("toggle", () => {
      if (!box.open || box.querySelector("ul")) return;
      const { names } = part().model;
      box.append(el("ul", { class: "entries" }, members.map((m) => el("li", {},
        el("button", { type: "button", "data-spare": m, onclick: () => act(m) }, label),
        el("button", { type: "button", class: "step", title: "Show it", onclick: () => { dialog.close(); part().choose(m); } }, names[m]), el("span", { class: "muted" }, printable(reason(m)))))));
    });
    return box;
  };
  const write = async () => {
    if (isWriting) return;
    isWriting = true;
    try {
      const done = await ask("/api/finish", { ...asked(), write: true });
      const place = body.querySelector('[data-role="written"]');
      const files = Object.entries(done.files).map(([title, path]) => el("div", {}, el("dt", {}, title), el("dd", {}, printable(path))));
      const copy = el("button", { type: "button", onclick: () => copyText(done.command, copy) }, "Copy");
      const command = done.command && isLess ? [el("p", {}, "This command writes the data without the rejected demonstrations:"), el("p", { class: "command" }, el("code", { "data-role": "keep-command" }, printable(done.command)), copy)] : [];
      const notes = done.lost.map((line) => el("p", {}, printable(line)));
      place.replaceChildren(el("p", {}, el("strong", {}, "Written.")), el("dl", { class: "files" }, files), ...command, ...notes);
      place.scrollIntoView({ block: "nearest" });
    } catch (error) {
      body.querySelector('[data-role="written"]').replaceChildren(el("p", {}, printable(error.message)));
    } finally {
      isWriting = false;
    }
  };
  const show = async () => {
    const found = await ask("/api/finish", asked()), { view, d, size } = part().model, groups = new Map();
    isLess = found.kept < size;
    const open = new Set([...body.querySelectorAll("details[open]")].map((one) => one.dataset.word));
    for (const [rule, members] of Object.entries(found.rejected)) {
      const word = rule === "outcome" ? found.outcome : WORDS[rule] ?? BY_MODEL;
      groups.set(word, [...(groups.get(word) ?? []), ...members]);
    }
    const counts = [...groups].map(([word, members]) => `${members.length.toLocaleString("en")} ${word}`);
    const lists = [...groups].map(([word, members]) => [word, list(`${members.length.toLocaleString("en")} rejected ${word}`, members, "Keep it", (m) => change(spared, d.id[m]), (m) => why(m, word))]);
    const number = new Map(d.id.map((id, m) => [id, m])), again = [...spared].filter((id) => number.has(id)).map((id) => number.get(id));
    if (again.length) lists.push(["spared", list(`${again.length.toLocaleString("en")} kept all the same`, again, "Not any more", (m) => change(spared, d.id[m]))]);
    for (const [word, box] of lists) {
      box.dataset.word = word;
      box.open = open.has(word);
    }
    const kinds = view.faults.kinds.map(({ rule, n, words }) => el("label", { title: words }, el("input", { type: "checkbox", "data-rule-off": rule, checked: rules.has(rule), onchange: () => change(rules, rule) }), ` ${printable(rule)} ${n.toLocaleString("en")}`));
    body.replaceChildren(
      el("h2", {}, `${found.kept.toLocaleString("en")} of ${size.toLocaleString("en")} kept.`),
      el("p", { "data-role": "counts" }, counts.length ? `Rejected: ${counts.join(", ")}.` : "None is rejected."),
      ...found.notes.map((note) => el("p", {}, printable(note))), ...lists.map(([, box]) => box),
      kinds.length ? el("fieldset", {}, el("legend", {}, "Also reject demonstrations with these faults"), kinds) : "",
      el("p", { class: "buttons" }, el("button", { type: "button", class: "first", "data-role": "write", onclick: write }, "Write files"), el("button", { type: "button", class: "close", onclick: () => dialog.close() }, "Close ", el("kbd", {}, "Esc"))),
      el("div", { "data-role": "written", role: "status" }));
  };
  const open = async () => {
    if (!dialog) {
      body = el("div", {});
      dialog = el("dialog", { class: "finish", "aria-label": "Finish" }, body);
      document.body.append(dialog);
    }
    await show();
    if (!dialog.open) dialog.showModal();
  };
  return { open };
};
