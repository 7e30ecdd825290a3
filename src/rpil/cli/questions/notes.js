// Who answers and why: a name, a tag and a note that go with the next answer, and what was said before.
const makeNotes = () => {
  const typed = { tag: "", note: "", by: null };
  let last = null; // whether it is open, as a reader left it
  const field = (role) => document.querySelector(`.why [data-role="${role}"]`);
  const input = (role, label, more) => el("label", {}, el("span", { class: "muted" }, label), el("input", {
    type: "text", "data-role": role, maxlength: 500, autocomplete: "off", ...more, oninput: ({ target }) => { typed[role] = target.value; },
  }));
  const draw = (place, view) => {
    const tags = [...new Set(view.said.map(([, , , tag]) => tag).filter(Boolean))].sort(collator.compare);
    const names = [...new Set(view.said.map(([, , , , by]) => by).filter(Boolean))].sort(collator.compare);
    const list = (id, values) => el("datalist", { id }, values.map((value) => el("option", { value })));
    for (const old of place.querySelectorAll(".why, .agreement")) old.remove();
    const isOpen = last ?? (matchMedia("(min-width: 40rem)").matches || Boolean(typed.tag || typed.note));
    place.append(el("details", { class: "why", open: isOpen },
      el("summary", { class: "muted" }, "Why, and who: written beside the next answer ", el("kbd", {}, "n")),
      el("p", { class: "buttons" }, input("tag", "Why, in a word", { list: "tags-used", class: "short" }), input("note", "Note", { class: "long" }),
        input("by", "Your name", { list: "names-used", class: "short" }),
        tags.slice(0, 8).map((tag) => el("button", { type: "button", class: "chip", title: "Why, of the next answer", onclick: () => put({ tag }) }, printable(tag)))),
      list("tags-used", tags), list("names-used", names)),
    el("div", { class: "agreement" }, view.agreement.map((line) => el("p", {}, printable(line)))));
    put({ ...typed, by: typed.by ?? view.by });
    place.querySelector(".why").addEventListener("toggle", ({ target }) => { last = target.open; });
    place.querySelector(".why").addEventListener("keydown", (event) => {
      if (!event.target.matches("input") || (event.key !== "Enter" && event.key !== "Escape")) return; // back to the keys
      event.preventDefault();
      event.stopPropagation();
      event.target.blur();
    });
  };
  const put = (values) => {
    for (const [role, value] of Object.entries(values)) {
      typed[role] = value;
      if (field(role)) field(role).value = value;
    }
  };
  // What is posted with an answer; the name stays.
  const take = () => {
    const why = { tag: typed.tag, note: typed.note, by: typed.by ?? "" };
    put({ tag: "", note: "" });
    return why;
  };
  const focus = () => {
    document.querySelector(".why").open = true;
    field("tag").focus();
  };
  const said = ({ view }, m) => {
    const own = view.said.filter(([of, , note, tag, by]) => of === m && (note || tag || by));
    return own.length ? el("ul", { class: "said" }, own.map(([, label, note, tag, by]) =>
      el("li", {}, by ? `${printable(by)}: ` : "", printable(label), tag ? [" ", el("span", { class: "tag" }, printable(tag))] : "", note ? ` ${printable(note)}` : ""))) : "";
  };
  return { draw, put, take, said, focus };
};
