// Sorting the ranking and choosing a demonstration; without it the page is complete, merely not sortable.
(() => {
  "use strict";
  const value = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
  const compare = (a, b) => {
    const [x, y] = [Number(a), Number(b)];
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, undefined, { numeric: true }) : x === y ? 0 : x - y;
  };
  for (const { tHead: head, tBodies: [body] } of document.querySelectorAll("table.ranking")) {
    head.addEventListener("click", (event) => {
      const cell = event.target.closest("button")?.parentElement;
      if (!cell) return;
      const up = cell.getAttribute("aria-sort") !== "ascending";
      for (const other of head.rows[0].cells) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", up ? "ascending" : "descending");
      const rows = [...body.rows].sort((a, b) => compare(value(a, cell.cellIndex), value(b, cell.cellIndex)));
      body.append(...(up ? rows : rows.reverse()));
    });
  }

  const show = (target) => {
    if (!(target instanceof HTMLDetailsElement)) return;
    target.open = true;
    target.scrollIntoView({ block: "start" });
  };
  const follow = () => show(document.getElementById(location.hash.slice(1)));
  window.addEventListener("hashchange", follow);
  // A second click on the same link changes no hash.
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.('a[href*="demonstration-"]');
    if (link) show(document.getElementById(link.hash.slice(1)));
  });
  for (const tools of document.querySelectorAll(".tools")) {
    const details = [...tools.closest("section").querySelectorAll("details.demonstration")];
    tools.classList.remove("no-script");
    tools.querySelector("select").addEventListener("change", (event) => show(document.getElementById(event.target.value)));
    tools.querySelector("button").addEventListener("click", (event) => {
      const open = details.some((one) => !one.open);
      for (const one of details) one.open = open;
      event.target.textContent = open ? "Close all" : "Open all";
    });
  }
  follow();
})();
