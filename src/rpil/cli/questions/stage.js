// What one looks at to answer: one or two demonstrations side by side, a typical one small beside them, and their facts.
const DIFFERS = 0.15; // ranks that differ by less say nothing
const isStill = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

// The most similar demonstration of the same task, which is none of those that are looked at.
const typicalOf = ({ d }, members, isAsked) => {
  const others = d.id.map((_, m) => m).filter((m) => !members.includes(m) && !isAsked(m) && d.task[m] === d.task[members[0]]);
  return others.length ? others.reduce((best, m) => (d.rank[m] < d.rank[best] ? m : best)) : null;
};

// The facts in which two demonstrations differ, or in which one is far from the middle, as a slider for each.
const sliders = ({ d, view, seconds }, members) => {
  const row = (name, cells) => el("tr", {}, el("th", { scope: "row" }, name), cells.map((cell) => el("td", {}, cell)));
  const slider = (value, k) => el("span", { class: `rank ${MEMBERS[k]}`, role: "img", "aria-label": `more than in ${percent(value)} of all`, title: `more than in ${percent(value)} of all` },
    el("b", { style: `left:${(100 * value).toFixed(1)}%` }));
  const differ = (values) => (members.length > 1 ? Math.abs(values[members[0]] - values[members[1]]) > DIFFERS : Math.abs(values[members[0]] - 0.5) > 0.5 - DIFFERS);
  const rows = Object.entries(d.facts).flatMap(([name, values]) => {
    if (!(name in RANK_WORDS)) return [];
    return differ(values) ? [row(RANK_WORDS[name], members.map((m, k) => slider(values[m], k)))] : [];
  });
  const texts = [["Length", (m) => (view.fps ? seconds(d.n_steps[m]) : count(d.n_steps[m], "step"))], ["Task", (m) => d.task[m]],
    ["Operator", (m) => d.demonstrator[m]], ["Session", (m) => d.session[m]], ["Recorded", (m) => (d.order.length ? `${d.order[m].toLocaleString("en")} of ${d.id.length.toLocaleString("en")}` : "")]];
  const more = texts.filter(([name, of]) => members.some(of) && (members.length === 1 || of(members[0]) !== of(members[1])));
  return el("table", { class: "sliders" }, el("tbody", {}, more.map(([name, of]) => row(name, members.map((m) => printable(of(m))))), rows));
};
const MEMBERS = ["first", "second"];

// `load` gets what was recorded from the server; `begin` is the step at which it starts.
const makeStage = (model, place, numbers, { load, isAsked, begin = 0, plays = false, told = () => {} }) => {
  const { d, view, names } = model, fps = view.fps || 10, hasSeconds = Boolean(view.fps);
  const typical = typicalOf(model, numbers, isAsked), shown = [...numbers, ...(typical === null ? [] : [typical])];
  const members = shown.map((m, k) => ({ m, n: d.n_steps[m], colour: k < numbers.length ? MEMBERS[k] : "muted" }));
  const lanes = members.slice(0, numbers.length).map((one) => ({ ...one, odd: d.stretch[one.m] ? [d.stretch[one.m]] : [],
    title: d.stretch[one.m] ? `Look here in ${names[one.m]}` : names[one.m] }));
  let curves = null, camera = 0;
  const player = makePlayer(lanes, fps, hasSeconds, (step) => {
    curves?.at(step);
    told(step);
  });
  const caption = ({ m, colour }, k) => el("figcaption", {}, el("span", { class: `swatch ${colour}` }), k < numbers.length && numbers.length > 1 ? el("kbd", {}, String(k + 1)) : "",
    k < numbers.length ? " " : " typical: ", el("strong", {}, names[m]));
  const screens = members.map(() => el("div", { class: "screen" }));
  const films = el("div", { class: `films of${numbers.length}`, hidden: true }, members.map((one, k) => el("figure", { class: one.colour }, caption(one, k), screens[k])));
  const legend = el("p", { class: "legend" }, members.map(caption));
  const note = el("p", { class: "muted" }), choice = el("p", { class: "buttons cameras" });
  const plots = el("details", { class: "plots" }, el("summary", {}, "What was recorded"), legend);
  place.replaceChildren(films, choice, player.box, plots, note, sliders(model, numbers));
  player.seek(begin);

  const showFilms = (shots, hasFrames) => {
    player.clearFilms();
    release(films);
    members.forEach((one, k) => {
      const shot = shots[k][camera];
      if (shot) player.addFilm(screens[k], one.m, camera, shot, one.n, hasFrames);
      else screens[k].replaceChildren(el("p", { class: "muted" }, "No video."));
    });
    choice.replaceChildren(...(shots[0].length > 1 ? shots[0].map((shot, k) => el("button", { type: "button", "aria-pressed": String(k === camera),
      onclick: () => { camera = k; showFilms(shots, hasFrames); } }, printable(shot.camera))) : []));
  };
  const showCurves = async () => {
    if (curves) return;
    const found = await Promise.all(shown.map((m) => load(`/api/curves/${m}`)));
    if (curves || !plots.isConnected) return;
    curves = makeCurves(view.columns, members, found, fps, hasSeconds, player.seek);
    plots.append(curves.box);
    curves.show();
    requestAnimationFrame(() => curves.at(player.step())); // once they are laid out
  };
  plots.addEventListener("toggle", () => { if (plots.open) showCurves(); });
  const open = async () => {
    const found = await Promise.all(shown.map((m) => load(`/api/films/${m}`)));
    const hasFilms = found.slice(0, numbers.length).some((one) => one.videos.length);
    films.hidden = !hasFilms;
    place.classList.toggle("blind", !hasFilms);
    if (hasFilms) {
      note.textContent = printable(found[0].note);
      showFilms(found.map((one) => one.videos), found[0].frames);
    } else {
      plots.open = true;
      await showCurves();
    }
    if (plays && hasFilms && !isStill() && !player.isPlaying()) player.toggle();
  };
  place.setAttribute("aria-busy", "true");
  open().catch((error) => { note.textContent = error.message; }).finally(() => {
    place.removeAttribute("aria-busy");
    place.style.minHeight = "";
  });
  const redraw = () => {
    curves?.show();
    requestAnimationFrame(() => curves?.at(player.step()));
  };
  return { player, place, redraw };
};

// What is shown no more must not keep the few connections of a browser from the next answer.
const release = (box) => {
  for (const one of box.querySelectorAll("img, video")) {
    one.removeAttribute("src");
    one.load?.();
  }
};
