// The demonstrations of a view: their filters, their order, and the marks of the reader.
const MARKS = ["good", "bad"];
const collator = new Intl.Collator("en", { numeric: true });

// What outlives a reload where the browser lets a page keep something; else it stays in memory.
const makeStore = (key, place = "localStorage") => {
  const attempt = (act) => {
    try {
      return act();
    } catch {
      return null;
    }
  };
  return {
    lasts: attempt(() => window[place].length) !== null,
    read: () => attempt(() => JSON.parse(window[place].getItem(key))) ?? {},
    write: (kept) => attempt(() => window[place].setItem(key, JSON.stringify(kept))),
  };
};

const makeModel = (view) => {
  const d = view.demonstrations, size = d.id.length, names = d.id.map(printable);
  const all = new Array(size);
  d.look.forEach((place, m) => { all[place] = m; });
  const found = view.faults.found, faults = Array.from({ length: size }, () => []);
  found.demonstration.forEach((m, k) => { if (m !== null) faults[m].push(k); });
  const rules = faults.map((own) => [...new Set(own.map((k) => found.rule[k]))]);
  const order = d.order.length ? d.order : d.session.some(Boolean) || d.demonstrator.some(Boolean) ? d.id.map((_, m) => m + 1) : [];

  // Marks, by number, and what each replaced.
  const store = live ? live.store(view) : makeStore(`rpil-marks-${view.run}`), marks = new Map(), past = [];
  const kept = store.read();
  d.id.forEach((id, m) => { if (Object.hasOwn(kept, id) && MARKS.includes(kept[id])) marks.set(m, kept[id]); });
  const put = (m, word) => {
    if (word) marks.set(m, word);
    else marks.delete(m);
    store.write(Object.fromEntries([...marks].map(([k, mark]) => [d.id[k], mark])));
  };
  // Rows that are good or bad: [demonstration, first, the one after the last, word].
  const own = makeStore(`rpil-rows-${view.run}-${JSON.stringify(view.rows)}`), stored = live ? null : own.read().rows;
  let spans = Array.isArray(stored) ? stored : view.rows;
  const putRows = (given) => {
    spans = given;
    own.write({ rows: spans });
  };
  const mark = (m, word, start, end) => {
    past.push([m, marks.get(m), spans]);
    if (start === undefined) put(m, word);
    else putRows([...spans.filter((row) => row[0] !== m || row[2] <= start || row[1] >= end), ...(word ? [[m, start, end, word]] : [])]);
  };
  const undo = () => {
    const [m, word, before] = past.pop() ?? [];
    if (m === undefined) return m;
    put(m, word);
    putRows(before);
    return m;
  };

  // What the table can be filtered by: each has values, and those of a demonstration.
  const values = (column) => [...new Set(column)].filter(Boolean).sort(collator.compare);
  const dimensions = [
    { key: "verdict", title: "Verdict", values: Object.keys(view.counts).filter((word) => view.counts[word]).reverse(), of: (m) => [d.verdict[m]] },
    { key: "group", title: "Group", values: values(d.group), of: (m) => [d.group[m]] },
    { key: "demonstrator", title: "Operator", values: values(d.demonstrator), of: (m) => [d.demonstrator[m]] },
    { key: "session", title: "Session", values: values(d.session), of: (m) => [d.session[m]] },
    { key: "task", title: "Task", values: values(d.task), of: (m) => [d.task[m]] },
    { key: "fault", title: "Fault", values: view.faults.kinds.map((kind) => kind.rule).filter((rule) => rules.flat().includes(rule)), of: (m) => rules[m], few: 1 },
    { key: "changed", title: "Last answer", values: live?.changed().length ? ["changed"] : [], of: (m) => (live?.changed().includes(m) ? ["changed"] : []), few: 1 },
    { key: "mark", title: live ? "Your answer" : "Your mark", values: ["good", "bad", "none"], of: (m) => [marks.get(m) ?? "none"] },
  ].filter((one) => one.values.length >= (one.few ?? 2));

  const state = { text: "", review: false, sort: "look", down: false };
  for (const one of dimensions) state[one.key] = new Set();
  let texts = null;
  const matches = (m, text) => {
    texts ??= names.map((name, k) => [name, d.reason[k], d.task[k], d.demonstrator[k], d.session[k]].join("\n").toLowerCase());
    return texts[m].includes(text);
  };

  const keys = {
    id: (m) => names[m], verdict: (m) => ["lower", "open", "upper"].indexOf(view.sides[d.verdict[m]]),
    mark: (m) => MARKS.indexOf(marks.get(m)) * -1, faults: (m) => -faults[m].length, order: (m) => order[m],
  };
  const rows = () => {
    const text = state.text.trim().toLowerCase(), used = dimensions.filter((one) => state[one.key].size);
    const chosen = all.filter((m) =>
      (!state.review || d.look[m] < view.n_review) && (!text || matches(m, text)) &&
      used.every((one) => one.of(m).some((value) => state[one.key].has(value))));
    if (state.sort !== "look") {
      const key = keys[state.sort] ?? ((m) => d[state.sort][m]), sign = state.down ? -1 : 1;
      const by = chosen.map((m) => [key(m), m]);
      const compare = typeof by[0]?.[0] === "string" ? ([a], [b]) => sign * collator.compare(a, b) : ([a], [b]) => sign * (a - b);
      return by.sort(compare).map(([, m]) => m);
    }
    return state.down ? chosen.reverse() : chosen;
  };

  // Text that a spreadsheet would take for a formula gets an apostrophe, which rpil removes.
  const FORMULA = /^'*(?![+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$)[=+\-@\t\r\n＝＋－＠]/;
  const cell = (text) => {
    const safe = FORMULA.test(text) ? `'${text}` : text;
    return /[",\r\n]|^\s|\s$/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
  };
  const labels = () => {
    const given = view.answers.filter(([m, word]) => !(marks.has(m) && MARKS.includes(word)));
    const own = [...marks].sort(([a], [b]) => a - b);
    const more = spans.length ? "," : "", lines = spans.map(([m, start, end, word]) => `${cell(d.id[m])},${word},${start},${end}`);
    return [`id,label${more && ",start,end"}`, ...[...given, ...own].map(([m, word]) => `${cell(d.id[m])},${cell(word)}${more && ",,"}`), ...lines, ""].join("\n");
  };
  const keep = () => {
    const isKept = (m) => (marks.has(m) ? marks.get(m) === "good" : d.kept[m]);
    // Whole numbers as they are written: a number of JavaScript does not hold all of them.
    const ids = d.id.flatMap((id, m) => (isKept(m) ? [view.whole_ids ? id : JSON.stringify(id)] : []));
    const made = Object.keys(view.provenance).length ? `,\n "provenance": ${JSON.stringify(view.provenance)}` : "";
    return `{\n "episodes": [${ids.join(", ")}],\n "run": ${JSON.stringify(view.run)}${made}\n}\n`;
  };

  const seconds = (step) => (view.fps ? `${(step / view.fps).toFixed(1)} s` : "");
  return {
    view, d, size, names, faults, rules, found, order, marks, spans: () => spans, mark, undo, dimensions, state, rows, labels, keep, seconds,
    // What the audit thinks of a demonstration is withheld while the question about it is open.
    isOpen: (m) => Boolean(live?.isAsked(m)),
    lasts: store.lasts, side: (m) => view.sides[d.verdict[m]], canUndo: () => past.length > 0,
  };
};
