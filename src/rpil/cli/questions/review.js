// The questions of a review: each answer is posted, and the page shows what the server then knows.
const live = (() => {
  const POLL = 1500; // milliseconds
  const KEYS = { good: "g", bad: "b" };
  const seen = new Map(); // what the server told of a demonstration, until the next answer
  const recorded = new Map(); // what no answer changes
  let version = null, asked = [], changed = [], last = Promise.resolve();

  const panel = () => document.querySelector('[data-role="ask"]');
  const say = (...lines) => panel().querySelector('[data-role="said"]').replaceChildren(...lines.map((line) => el("span", {}, printable(line))));
  const ask = async (path, given) => {
    let answer = null;
    try {
      answer = await fetch(path, given && { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ version, ...given }) });
    } catch {
      throw new Error("The server has ended. Every answer is written: start rpil review again.");
    }
    const text = await answer.text(), isData = answer.headers.get("content-type").startsWith("application/json");
    if (!answer.ok) throw Object.assign(new Error(isData ? JSON.parse(text).error : text), { isStale: answer.status === 409 });
    return isData ? JSON.parse(text) : text;
  };

  // The article as the server draws it now, in the place of this one; what was chosen stays.
  const refresh = async () => {
    const text = await ask("/"), made = new DOMParser().parseFromString(text, "text/html").querySelector("main > article");
    const kept = report.kept(), focus = document.activeElement?.dataset?.role;
    const wasAsked = asked.includes(kept.chosen), stageOf = (box) => box.querySelector('[data-role="stage"]');
    seen.clear();
    const next = JSON.parse(made.querySelector('[data-role="ask"]').dataset.asked);
    if (String(asked) !== String(next)) release(panel()); // else its films play on
    if (next.length) stageOf(made).style.minHeight = `${stageOf(panel()).offsetHeight}px`; // until it is drawn: no button moves
    leave();
    document.querySelector("main > article").replaceWith(made);
    begin();
    const chosen = wasAsked && asked.length ? asked[0] : kept.chosen;
    report = start(made, { ...kept, chosen, step: chosen === kept.chosen ? kept.step : 0 });
    report.show();
    sweep.refresh();
    if (focus) made.querySelector(`[data-role="${focus}"]`)?.focus({ preventScroll: true });
  };
  // One after the other, so that a quick reader's keys all count; what went wrong, or null.
  const post = (path, given) => {
    last = last.then(async () => {
      try {
        await ask(path, given);
        await refresh();
        return null;
      } catch (error) {
        if (given.key) notes.put(given.note);
        if (error.isStale) await refresh().catch(() => {});
        say(error.message);
        return error.message;
      }
    });
    return last;
  };
  const answer = (demonstrations, key, rows = []) => post("/api/answer", { demonstrations, key, rows, ...notes.take() });
  const press = (key, m) => {
    const isPair = asked.length === 2, ofPair = "12345".includes(key) || ("us".includes(key) && asked.includes(m));
    if (isPair && ofPair) answer(asked, key);
    else if (!"12345".includes(key) && m !== null) answer([m], key);
  };
  const undo = () => post("/api/undo", {});

  const begin = () => {
    const place = panel();
    version = Number(place.dataset.version);
    asked = JSON.parse(place.dataset.asked);
    changed = JSON.parse(place.dataset.changed);
    place.addEventListener("click", ({ target }) => {
      const button = target.closest("button");
      if (button?.dataset.key) press(button.dataset.key, asked[0]);
      if (button?.dataset.role === "changed") report.showChanged();
      if (button?.dataset.role === "keys") showKeys(report.keys);
      if (button?.dataset.role === "take-back") undo();
      if (button?.dataset.role === "finish") finish.open().catch((error) => say(error.message));
      if (button?.dataset.role === "sweep") glance();
    });
  };

  const notes = makeNotes(), part = () => report;
  const sweep = makeSweep({ ask, part, answer, undo, why: notes.put }), finish = makeFinish({ ask, part });
  const glance = () => sweep.open().catch((error) => say(error.message));

  // Drawings of a demonstration come when it is first shown; films and what was recorded once for all.
  const once = (known, path) => {
    if (!known.has(path)) {
      const asked = ask(path).catch((error) => {
        known.delete(path);
        throw error;
      });
      known.set(path, asked);
    }
    return known.get(path);
  };
  const load = async (view, m, then) => {
    try {
      view.drawings[m] = (await once(seen, `/api/demonstration/${m}`)).drawing;
      then();
    } catch (error) {
      say(error.message);
    }
  };

  // What is asked about, side by side; where the same is asked again, it goes on as it was.
  let stage = null, looked = null;
  const options = { load: (path) => once(recorded, path), isAsked: (m) => asked.includes(m) };
  const open = (model, { step, told }) => {
    const place = panel().querySelector('[data-role="stage"]'), now = JSON.stringify(asked);
    if (stage?.asked === now && asked.length) {
      place.replaceWith(stage.place);
      return;
    }
    stage = asked.length ? { asked: now, ...makeStage(model, place, asked, { ...options, begin: step, plays: true, told: (at) => told(asked[0], at) }) } : null;
  };
  // One that is chosen and not asked about.
  const look = (model, m, { step, told }) => {
    if (looked?.m !== m) {
      if (looked) release(looked.place);
      looked = { m, ...makeStage(model, el("div", { class: "stage one" }), [m], { ...options, begin: step, told: (at) => told(m, at) }) };
    }
    return looked.place;
  };
  const front = () => (looked?.place.isConnected ? looked : stage)?.player;
  const leave = () => {
    if (looked) release(looked.place);
    looked = null;
  };

  const passing = (m) => el("button", { type: "button", onclick: () => press("u", m) }, "Cannot tell ", el("kbd", {}, "u"));

  // Another tab may answer. Answers of this one wait for no such question: only one is on its way, beside their queue.
  let isAsking = false;
  setInterval(async () => {
    if (document.hidden || isAsking) return;
    isAsking = true;
    try {
      const known = (await ask("/api/version")).version;
      const follow = async () => { if (known > version) await refresh(); };
      last = last.then(follow).catch((error) => say(error.message));
    } catch (error) {
      say(error.message);
    } finally {
      isAsking = false;
    }
  }, POLL);
  // The marks of the page are the labels that were given.
  const marks = (view) => ({
    lasts: true,
    read: () => Object.fromEntries(view.answers.filter(([, word]) => word in KEYS).map(([m, word]) => [view.demonstrations.id[m], word])),
    write: () => {},
  });
  const store = (view) => {
    notes.draw(panel());
    return marks(view);
  };
  const keys = (chosen) => [
    ["1", "of a pair: the first is better"], ["2", "the second is better"], ["3", "both are good"], ["4", "both are bad"], ["5", "no difference"],
    ["u", "cannot tell"], ["s", "skip"],
  ].map(([key, words]) => [key, words, () => press(key, chosen())]).concat([
    [" ", "play, pause", () => front()?.toggle()], [",", "one step back", () => front()?.frames(-1)], [".", "one step on", () => front()?.frames(1)],
    ["<", "slower", () => front()?.faster(-1)], [">", "faster", () => front()?.faster(1)], ["l", "loop", () => front()?.setLoop()],
    ["n", "a note of the next answer", notes.focus], ["v", "all at a glance: arrows and Shift choose a row, x one", glance],
  ]);
  begin();
  return {
    first: () => asked[0] ?? null, isAsked: (m) => asked.includes(m), changed: () => changed, store, load, open, look, keys, passing, undo,
    said: notes.said, seek: (step) => front()?.seek(step), redraw: () => { for (const one of [stage, looked]) one?.redraw(); }, mark: (word, m, rows) => (rows.length ? answer([m], KEYS[word], rows) : press(KEYS[word], m)),
  };
})();
