// The questions of a review: each answer is posted, and the page shows what the server then knows.
const live = (() => {
  const POLL = 1500; // milliseconds
  const KEYS = { good: "g", bad: "b" };
  const seen = new Map(); // what the server told of a demonstration, until the next answer
  let version = null, asked = [], last = Promise.resolve();

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
    const kept = parts[0].kept(), focus = document.activeElement?.dataset?.role;
    const wasAsked = asked.includes(kept.chosen);
    seen.clear();
    release();
    articles[0].replaceWith(made);
    articles[0] = made;
    begin();
    parts[0] = start(made, "", { ...kept, chosen: wasAsked && asked.length ? asked[0] : kept.chosen });
    parts[0].show();
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
        if (given.key) notes.put({ tag: given.tag, note: given.note });
        if (error.isStale) await refresh().catch(() => {});
        say(error.message);
        return error.message;
      }
    });
    return last;
  };
  const answer = (demonstrations, key) => post("/api/answer", { demonstrations, key, ...notes.take() });
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
    place.addEventListener("click", ({ target }) => {
      const button = target.closest("button");
      if (button?.dataset.key) press(button.dataset.key, asked[0]);
      if (button?.dataset.show) parts[0].choose(Number(button.dataset.show));
      if (button?.dataset.role === "take-back") undo();
      if (button?.dataset.role === "finish") finish.open().catch((error) => say(error.message));
      if (button?.dataset.role === "sweep") look();
    });
  };

  const notes = makeNotes(), part = () => parts[0];
  const sweep = makeSweep({ ask, part, answer, undo, why: notes.put }), finish = makeFinish({ ask, part });
  const look = () => sweep.open().catch((error) => say(error.message));

  // Drawings and videos of a demonstration come when it is first shown.
  const load = async (view, m, then) => {
    try {
      if (!seen.has(m)) seen.set(m, ask(`/api/demonstration/${m}`));
      const found = await seen.get(m);
      view.drawings[m] = found.drawing;
      seen.set(m, found);
      then();
    } catch (error) {
      seen.delete(m);
      say(error.message);
    }
  };
  // What is shown no more must not keep the few connections of a browser from the next answer.
  const release = () => {
    for (const one of articles[0].querySelectorAll(".media img, .media video")) {
      one.removeAttribute("src");
      one.load?.();
    }
  };
  const media = ({ view, d }, m) => {
    release();
    const found = seen.get(m), fps = view.fps;
    if (!found?.videos) return "";
    const n = d.n_steps[m], [first, end] = d.stretch[m] ? [d.stretch[m][0], d.stretch[m][1] + 1] : [0, n];
    const steps = [...new Set([first, d.worst[m][0] ?? (first + end) >> 1, end - 1])].sort((a, b) => a - b);
    const films = found.videos.map(({ camera, start }, k) => {
      const film = el("video", { controls: true, muted: true, preload: "metadata", src: `/video/${m}/${k}#t=${start + first / fps},${start + end / fps}` });
      const frames = found.frames ? steps.map((step) => el("button", { type: "button", title: `Step ${step}`, onclick: () => {
        film.currentTime = start + step / fps;
        film.play();
      } }, el("img", { src: `/frame/${m}/${k}/${step}`, alt: `${camera} at step ${step}`, loading: "lazy" }), `${(step / fps).toFixed(1)} s`)) : [];
      return el("figure", {}, el("figcaption", {}, printable(camera)), film, el("div", { class: "frames" }, frames));
    });
    return el("div", { class: "media" }, films, found.note ? el("p", { class: "muted" }, printable(found.note)) : "");
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
    notes.draw(panel(), view);
    return marks(view);
  };
  begin();
  return { note: notes.focus, said: notes.said, sweep: look, first: () => asked[0] ?? null, store, load, media, passing, undo, press, mark: (word, m) => press(KEYS[word], m) };
})();
