// Tables that sort by a click on a heading, and commands with a button that copies them.
const Tables = (() => {
  "use strict";
  const NUMBER = /[-\u2212]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?/i;

  // Number of a cell: the first one after names of percentiles such as "p99"; null without one.
  function numberOf(text) {
    const found = NUMBER.exec(text.replace(/\bp\d+(\.\d+)?\b/g, "").replace(/\u2020/g, ""));
    return found ? Number(found[0].replace(/,/g, "").replace("\u2212", "-")) : null;
  }

  function textOf(row, column) {
    const cell = row.cells[column];
    return cell ? cell.textContent.trim() : "";
  }

  function sort(table, rows, column, direction) {
    const body = table.tBodies[0];
    if (!direction) { body.append(...rows); return; }
    const numbers = rows.map((row) => numberOf(textOf(row, column)));
    const numeric = numbers.filter((value) => value !== null).length * 2 >= rows.length;
    const keys = new Map(rows.map((row, index) => [row, numeric ? numbers[index] : textOf(row, column).toLowerCase()]));
    body.append(...[...rows].sort((a, b) => {
      const [left, right] = [keys.get(a), keys.get(b)];
      if (left === null || right === null) return (left === null) - (right === null);
      return direction * (numeric ? left - right : left.localeCompare(right));
    }));
  }

  function makeSortable(table) {
    if (!table.tHead || table.tHead.rows.length !== 1 || !table.tBodies[0] || table.tBodies[0].rows.length < 3) return;
    const rows = [...table.tBodies[0].rows];
    const headings = [...table.tHead.rows[0].cells];
    headings.forEach((heading, column) => {
      if (!heading.textContent.trim()) return;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.title = "sort by this column";
      button.append(...heading.childNodes);
      heading.append(button);
      button.addEventListener("click", () => {
        const order = ["none", "descending", "ascending"];
        const next = order[(order.indexOf(heading.getAttribute("aria-sort") || "none") + 1) % order.length];
        for (const other of headings) other.removeAttribute("aria-sort");
        if (next !== "none") heading.setAttribute("aria-sort", next);
        sort(table, rows, column, { none: 0, descending: -1, ascending: 1 }[next]);
      });
    });
  }

  async function copy(text) {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const field = document.body.appendChild(document.createElement("textarea"));
      field.value = text;
      field.select();
      document.execCommand("copy");
      field.remove();
    }
  }

  // A button behind a command; `code` is the element that holds it.
  function addCopy(code) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "copy";
    button.textContent = "copy";
    button.title = "copy the command";
    button.addEventListener("click", async (event) => {
      event.stopPropagation();
      await copy(code.textContent.trim());
      button.textContent = "copied";
      setTimeout(() => { button.textContent = "copy"; }, 1500);
    });
    code.after(button);
  }

  function start() {
    if (document.body.classList.contains("brief")) return;
    document.querySelectorAll("main table:not(.steps)").forEach(makeSortable);
    for (const code of document.querySelectorAll("main code")) {
      if (/^rpojax[ .]\S/.test(code.textContent.trim()) && !code.closest("summary")) addCopy(code);
    }
  }

  return { start, addCopy, numberOf };
})();
