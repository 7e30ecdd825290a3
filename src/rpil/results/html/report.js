// Sorts the ranking by a column, and opens the picture of a demonstration. The page is complete without this script.
(() => {
  "use strict";
  const cellValue = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
  const compare = (a, b) => {
    const [x, y] = [Number(a), Number(b)];
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, undefined, { numeric: true }) : x === y ? 0 : x - y;
  };
  for (const { tHead: head, tBodies: [body] } of document.querySelectorAll("table.ranking")) {
    head.addEventListener("click", (event) => {
      const cell = event.target.closest("button")?.parentElement;
      if (!cell) return;
      const ascending = cell.getAttribute("aria-sort") !== "ascending";
      for (const other of head.rows[0].cells) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", ascending ? "ascending" : "descending");
      const rows = [...body.rows].sort((a, b) => compare(cellValue(a, cell.cellIndex), cellValue(b, cell.cellIndex)));
      body.append(...(ascending ? rows : rows.reverse()));
    });
  }

  const openPicture = (id) => {
    const details = document.getElementById(id);
    if (!(details instanceof HTMLDetailsElement)) return;
    details.open = true;
    details.scrollIntoView({ block: "start" });
  };
  const openLinked = () => openPicture(location.hash.slice(1));
  window.addEventListener("hashchange", openLinked);
  // A second click on the same link does not change the hash.
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.('a[href*="demonstration-"]');
    if (link) openPicture(link.hash.slice(1));
  });
  for (const tools of document.querySelectorAll(".tools")) {
    const pictures = [...tools.closest("section").querySelectorAll("details.demonstration")];
    tools.classList.remove("no-script");
    tools.querySelector("select").addEventListener("change", (event) => openPicture(event.target.value));
    tools.querySelector("button").addEventListener("click", (event) => {
      const open = pictures.some((picture) => !picture.open);
      for (const picture of pictures) picture.open = open;
      event.target.textContent = open ? "Close all" : "Open all";
    });
  }
  openLinked();
})();
