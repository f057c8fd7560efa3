"use strict";
// tables sort by a click on a head, and long ones are narrowed down by words
(() => {
  const number = (text) => {
    const plain = text.trim().replaceAll(",", "").replaceAll("−", "-");
    return plain !== "" && !Number.isNaN(Number(plain)) ? Number(plain) : null;
  };
  function sort(table, column, way) {
    const rows = [...table.tBodies[0].rows];
    const keys = new Map(rows.map((row) => [row, row.cells[column].textContent]));
    rows.sort((a, b) => {
      const [x, y] = [keys.get(a), keys.get(b)];
      const missing = Number(x === "–") - Number(y === "–"); // last, whichever way
      if (missing) return missing;
      const [u, v] = [number(x), number(y)];
      return way * (u !== null && v !== null ? u - v : x.localeCompare(y, undefined, { numeric: true }));
    });
    table.tBodies[0].append(...rows);
    [...table.tHead.rows[0].cells].forEach((head, i) => (i === column ? head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending") : head.removeAttribute("aria-sort")));
  }
  function narrow(table, words, told) {
    const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = [...table.tBodies[0].rows];
    rows.forEach((row) => { row.hidden = !wanted.every((word) => row.textContent.toLowerCase().includes(word)); });
    told.textContent = wanted.length ? `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows` : "";
  }
  for (const table of document.querySelectorAll(".wide table")) {
    if (!table.tHead || table.tBodies[0].rows.length < 2) continue;
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.title = head.title;
      button.append(...head.childNodes);
      button.addEventListener("click", () => sort(table, column, head.getAttribute("aria-sort") === "ascending" ? -1 : 1));
      head.append(button);
    });
    if (table.tBodies[0].rows.length <= 12) continue;
    const [label, input, told] = ["label", "input", "output"].map((tag) => document.createElement(tag));
    input.type = "search";
    input.addEventListener("input", () => narrow(table, input.value, told));
    label.className = "filter";
    label.append("Filter rows: ", input, " ", told);
    table.parentElement.before(label);
  }
})();
