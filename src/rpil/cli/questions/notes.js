// A note that goes with the next answer, and what was said before.
const makeNotes = () => {
  let typed = "", last = null; // whether it is open, as a reader left it
  const field = () => document.querySelector('.why [data-role="note"]');
  const draw = (place) => {
    place.querySelector(".why")?.remove();
    place.append(el("details", { class: "why", open: last ?? (matchMedia("(min-width: 40rem)").matches || Boolean(typed)) },
      el("summary", { class: "muted" }, "A note, written beside the next answer ", el("kbd", {}, "n")),
      el("p", { class: "buttons" }, el("label", {}, el("span", { class: "muted" }, "Note"), el("input", {
        type: "text", "data-role": "note", class: "long", maxlength: 500, autocomplete: "off", oninput: ({ target }) => { typed = target.value; },
      })))));
    put(typed);
    place.querySelector(".why").addEventListener("toggle", ({ target }) => { last = target.open; });
    place.querySelector(".why").addEventListener("keydown", (event) => {
      if (!event.target.matches("input") || (event.key !== "Enter" && event.key !== "Escape")) return; // back to the keys
      event.preventDefault();
      event.stopPropagation();
      event.target.blur();
    });
  };
  const put = (note) => {
    typed = note;
    if (field()) field().value = note;
  };
  const take = () => {
    const note = typed;
    put("");
    return { note };
  };
  const focus = () => {
    document.querySelector(".why").open = true;
    field().focus();
  };
  const said = ({ view }, m) => {
    const own = view.said.filter(([of, , note]) => of === m && note);
    return own.length ? el("ul", { class: "said" }, own.map(([, label, note]) => el("li", {}, printable(label), ` ${printable(note)}`))) : "";
  };
  return { draw, put, take, said, focus };
};
