// Text: numbers as the rest of the page writes them, names without characters that cannot be seen, and elements.
const number = (value) => {
  if (Math.abs(value) >= 1e9) return value > 0 ? "∞" : "−∞";
  const rounded = Math.abs(value) >= 1000 ? Math.round(value).toLocaleString("en") : (Math.round(value * 10) / 10 + 0).toFixed(1);
  return rounded.replace("-0.0", "0.0").replace("-", "−");
};
const percent = (share) =>
  share > 0 && share < 0.005 ? "<1 %" : share > 0.995 && share < 1 ? ">99 %" : `${Math.round(100 * share)} %`;
const count = (size, noun) => `${size.toLocaleString("en")} ${noun}${size === 1 ? "" : "s"}`;
const short = (value) => String(Number(value.toPrecision(3))).replace("-", "−");

// The same escapes as in the text that Python writes; lines and tabs stay.
const hex = (code, size) => code.toString(16).padStart(size, "0");
const escaped = (one) => {
  const code = one.codePointAt(0);
  if (one === "\n" || one === "\t") return one;
  if (one === "\r") return "\\r";
  return code < 256 ? `\\x${hex(code, 2)}` : code < 65536 ? `\\u${hex(code, 4)}` : `\\U${hex(code, 8)}`;
};
const printable = (text) => text.replace(/\p{C}/gu, escaped);

// An element with attributes and children; whatever is text becomes a text node, never HTML.
const el = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== ""));
  return made;
};

// Curves that drawings.py packed: a byte for each value, 255 for none.
const unpack = (curves, name) => {
  const step = (curves.to - curves.from) / 254;
  return Array.from(atob(curves[name]), (one) => {
    const code = one.charCodeAt(0);
    return code === 255 ? null : curves.from + step * code;
  });
};

const copyText = async (text, button) => {
  const said = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const field = el("textarea", {}, text);
    document.body.append(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
  button.textContent = "Copied";
  setTimeout(() => { button.textContent = said; }, 1200);
};

const download = (name, type, text) => {
  const address = URL.createObjectURL(new Blob([text], { type }));
  el("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
};
