"use strict";
/* Tables: a heading sorts the rows, a text and the kinds of rows filter them. Without scripts they stand as they are. */

/* What a cell is sorted by: its first number; for columns of words the words; null for an empty cell, which goes last. */
function sortKey(cell) {
  const text = cell.textContent.trim();
  if (text === "" || text === "-") return null;
  if (cell.classList.contains("left")) return text.toLowerCase();
  const number = parseFloat(text.replaceAll(",", "").replace("−", "-").replace(/^[^\d.-]+/, ""));
  return Number.isNaN(number) ? null : number;
}

function compareKeys(one, other, sign) {
  if (one === null || other === null) return (one === null) - (other === null);
  if (typeof one === "string") return sign * one.localeCompare(other, undefined, { numeric: true });
  return sign * (one - other);
}

const NEXT_ORDER = { none: "ascending", ascending: "descending", descending: "none" };

function makeSortable(table, announce) {
  const headings = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const original = [...body.rows];

  function sort(column, order) {
    headings.forEach((heading, place) => heading.setAttribute("aria-sort", place === column ? order : "none"));
    const sign = order === "ascending" ? 1 : -1;
    const rows = [...original];
    if (order !== "none") {
      rows.sort((a, b) => compareKeys(sortKey(a.cells[column]), sortKey(b.cells[column]), sign));
    }
    body.append(...rows);
    const name = headings[column].textContent.trim();
    announce(order === "none" ? "Rows in their first order." : `Rows by ${name}, ${order}.`);
  }

  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    heading.append(button);
    heading.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => sort(column, NEXT_ORDER[heading.getAttribute("aria-sort")]));
  });
}

function makeFilterable(table, form, announce) {
  const words = form.querySelector("input[type=search]");
  const kinds = [...form.querySelectorAll("input[type=checkbox]")];
  const rows = [...table.tBodies[0].rows];

  function filter() {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    const left = new Set(kinds.filter((box) => !box.checked).map((box) => box.value));
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = left.has(row.className) || !wanted.every((word) => text.includes(word));
    }
    announce(`${rows.filter((row) => !row.hidden).length} of ${rows.length} rows.`);
  }

  form.hidden = false;
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
}

for (const board of document.querySelectorAll(".board")) {
  const table = board.querySelector("table");
  const status = board.querySelector(".status");
  const announce = (text) => { status.textContent = text; };
  makeSortable(table, announce);
  makeFilterable(table, board.querySelector("form"), announce);
}
