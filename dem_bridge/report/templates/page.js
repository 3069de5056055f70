"use strict";
(() => {
  // A click on a heading sorts a table: by its bodies of rows if it has several, else by its rows.
  const words = new Intl.Collator("en", { numeric: true });

  function cellAt(row, column) {
    let at = 0;
    for (const cell of row.cells) {
      if (column < at + cell.colSpan) return cell.colSpan === 1 ? cell : null;
      at += cell.colSpan;
    }
    return null;
  }

  function keyOf(item, column) {
    const cell = cellAt(item.rows ? item.rows[0] : item, column);
    if (!cell) return null;
    const text = cell.dataset.value ?? cell.textContent.trim();
    return text === "" ? null : Number.isNaN(Number(text)) ? text : Number(text);
  }

  // numbers by value, then words; empty cells are last in both directions
  function compared(a, b, sign) {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return sign * (typeof a === "number" ? (a > b) - (a < b) : words.compare(a, b));
  }

  function sort(table, heading, column) {
    const down = heading.getAttribute("aria-sort") === "ascending";
    const parent = table.tBodies.length > 1 ? table : table.tBodies[0];
    const items = [...(table.tBodies.length > 1 ? table.tBodies : table.tBodies[0].rows)];
    const keys = new Map(items.map((item) => [item, keyOf(item, column)]));
    items.sort((a, b) => compared(keys.get(a), keys.get(b), down ? -1 : 1));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    parent.append(...items);
  }

  for (const table of document.querySelectorAll("table.sorts")) {
    [...table.tHead.rows[0].cells].forEach((heading, column) => {
      // no <button>: Chromium does not paint buttons in a heading that is repeated on the next printed page
      const button = document.createElement("span");
      button.setAttribute("role", "button");
      button.tabIndex = 0;
      button.title = "sort by this column";
      button.append(...heading.childNodes);
      heading.append(button);
      button.addEventListener("click", () => sort(table, heading, column));
      button.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        sort(table, heading, column);
      });
    });
  }

  // A link to an element in a folded section unfolds it.
  function unfold() {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let at = target; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
    target.scrollIntoView();
  }
  addEventListener("hashchange", unfold);
  unfold();

  // What is wider than its window says that it scrolls.
  const wider = new ResizeObserver((entries) => {
    for (const { target } of entries) target.classList.toggle("cut", target.scrollWidth > target.clientWidth + 1);
  });
  for (const one of document.querySelectorAll(".scroll")) wider.observe(one);
})();
