// A click on a heading sorts the table by that column.
const value = (row, j) => {
  const text = row.cells[j].textContent.trim(), number = parseFloat(text);
  return Number.isNaN(number) ? text : number;
};
const rank = (x) => typeof x === "number" ? 0 : x === "no result" ? 1 : x === "–" ? 3 : 2;
const compare = (a, b) => rank(a) - rank(b) || (typeof a === "number" ? a - b : a.localeCompare(b));
document.querySelectorAll("table.sortable th").forEach((th) => th.addEventListener("click", () => {
  const up = th.getAttribute("aria-sort") !== "ascending", body = th.closest("table").tBodies[0];
  th.parentNode.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
  th.setAttribute("aria-sort", up ? "ascending" : "descending");
  const rows = [...body.rows].map((row) => [value(row, th.cellIndex), row]);
  rows.sort((a, b) => (up ? 1 : -1) * compare(a[0], b[0])).forEach(([, row]) => body.append(row));
}));
