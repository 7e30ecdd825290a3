// Films of demonstrations that play in step, each from its own start, and one bar with the seconds of the episode.
const SPEEDS = [0.25, 0.5, 1, 2, 4];
const LATE = 0.12; // seconds that a film may be behind the others

// A film of a video: `shot` is its file, and where the demonstration begins in it; `n` are its steps.
const videoFilm = (place, m, k, shot, n, fps) => {
  const film = el("video", { muted: true, playsinline: true, preload: "auto", src: `/video/${m}/${k}#t=${shot.start}` });
  // A film whose file ends too soon rests at its last frame: told to play on, a browser begins the file again, with another episode.
  const end = () => Math.min(shot.start + (n - 0.5) / fps, (film.duration || Infinity) - 0.01);
  const at = (time) => Math.min(shot.start + time + 0.01 / fps, end()); // a little into the frame
  // A browser that is told to seek or to play while it seeks may seek for ever: the last time wanted follows when it is done.
  let wanted = null;
  const isBusy = () => film.readyState < 1 || film.seeking;
  const move = () => {
    if (wanted === null || isBusy()) return;
    film.currentTime = at(wanted);
    wanted = null;
  };
  for (const event of ["loadedmetadata", "seeked"]) film.addEventListener(event, move);
  film.muted = true;
  place.replaceChildren(film);
  return {
    isReady: () => film.readyState >= 2 && !film.seeking && wanted === null,
    show: (time) => {
      film.pause();
      wanted = time;
      move();
    },
    follow: (time, speed) => {
      if (isBusy() || wanted !== null) return;
      const to = at(time), isOver = to === end();
      film.playbackRate = speed;
      if (isOver) film.pause();
      else if (film.paused && !film.ended) film.play().catch(() => {});
      if (Math.abs(film.currentTime - to) > (isOver ? 0.5 / fps : LATE * Math.max(1, speed))) film.currentTime = to;
    },
    failed: (then) => film.addEventListener("error", then, { once: true }),
    pause: () => film.pause(),
  };
};

// The same as single pictures, where the browser cannot play the video.
const pictureFilm = (place, m, k, n, fps) => {
  const film = el("img", { alt: "" });
  let shown = null;
  const show = (time) => {
    const step = Math.max(0, Math.min(n - 1, Math.floor(time * fps + 0.01)));
    if (step === shown) return;
    shown = step;
    film.src = `/frame/${m}/${k}/${step}`;
  };
  place.replaceChildren(film);
  return { isReady: () => film.complete, show, follow: show, failed: () => {}, pause: () => {} };
};

// `members` have a number of steps, odd stretches and a colour; `told` hears of every step.
const makePlayer = (members, fps, hasSeconds, told) => {
  const longest = Math.max(...members.map((one) => one.n)), films = new Set();
  let step = 0, time = 0, speed = 1, loops = true, playing = false, before = 0, drawn = null;

  const unit = (value) => (hasSeconds ? (value / fps).toFixed(1) : String(Math.round(value)));
  const clock = el("output", { class: "clock" });
  const bar = el("input", { type: "range", min: 0, max: longest - 1, step: 1, value: 0, "aria-label": "Place in the episode", oninput: () => seek(Number(bar.value)) });
  const button = (label, title, onclick) => el("button", { type: "button", title, "aria-label": title, onclick }, label);
  const play = button("▶", "Play (space)", () => toggle());
  const rate = el("select", { "aria-label": "Speed", title: "Speed (< and >)", onchange: () => { speed = Number(rate.value); } },
    SPEEDS.map((one) => el("option", { value: one, selected: one === 1 }, `${one}×`.replace("0.5", "½").replace("0.25", "¼"))));
  const loop = el("button", { type: "button", title: "Loop (l)", "aria-pressed": "true", onclick: () => setLoop() }, "Loop");
  const lanes = el("div", { class: "lanes", "aria-hidden": "true" }, members.map((one) => el("div", { class: `lane ${one.colour}`, title: one.title },
    el("i", { class: "whole", style: `width:${(100 * one.n) / longest}%` }),
    one.odd.map(([first, last]) => el("i", { style: `left:${(100 * first) / longest}%;width:${(100 * (last + 1 - first)) / longest}%` })))));
  lanes.addEventListener("click", (event) => {
    const box = lanes.getBoundingClientRect();
    seek(Math.floor(((event.clientX - box.left) / box.width) * longest));
  });

  const draw = () => {
    if (step === drawn) return;
    drawn = step;
    bar.value = step;
    clock.value = `${unit(step)} / ${unit(longest)} ${hasSeconds ? "s" : "steps"}`;
    bar.setAttribute("aria-valuetext", clock.value);
    told(step);
  };
  const seek = (to) => {
    step = Math.max(0, Math.min(longest - 1, to));
    time = step / fps;
    for (const film of films) film.show(time);
    draw();
  };
  const pause = () => {
    playing = false;
    play.textContent = "▶";
    for (const film of films) film.pause();
  };
  const next = (now) => {
    if (!playing || !bar.isConnected) return;
    if ([...films].every((film) => film.isReady())) time += (speed * Math.min(now - before, 250)) / 1000; // one waits for the others
    before = now;
    if (time * fps >= longest) {
      if (!loops) pause();
      seek(loops ? 0 : longest - 1);
    }
    if (playing) {
      step = Math.floor(time * fps);
      for (const film of films) film.follow(time, speed);
      draw();
      requestAnimationFrame(next);
    }
  };
  const toggle = () => {
    if (playing) {
      pause();
      seek(step);
      return;
    }
    if (step >= longest - 1) seek(0);
    playing = true;
    play.textContent = "❚❚";
    before = performance.now();
    requestAnimationFrame(next);
  };
  const frames = (by) => {
    if (playing) pause();
    seek(step + by);
  };
  const faster = (by) => {
    speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(speed) + by))];
    rate.value = speed;
  };
  const setLoop = () => {
    loops = !loops;
    loop.setAttribute("aria-pressed", String(loops));
  };
  // Put the film of camera k of demonstration m into a place; pictures where it cannot be played.
  const addFilm = (place, m, k, shot, n, hasFrames) => {
    const made = videoFilm(place, m, k, shot, n, fps);
    films.add(made);
    made.show(time);
    made.failed(() => {
      films.delete(made);
      if (!hasFrames) {
        place.replaceChildren(el("p", { class: "muted" }, "This browser cannot play this video."));
        return;
      }
      const pictures = pictureFilm(place, m, k, n, fps);
      films.add(pictures);
      pictures.show(time);
    });
  };
  const box = el("div", { class: "player" },
    el("div", { class: "track" }, bar, lanes),
    el("div", { class: "controls" }, play, button("‹", "One step back (,)", () => frames(-1)), button("›", "One step on (.)", () => frames(1)), clock, rate, loop));
  draw();
  return { box, seek, toggle, frames, faster, setLoop, addFilm, clearFilms: () => films.clear(), step: () => step, isPlaying: () => playing };
};
