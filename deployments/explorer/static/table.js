/** A table of configurations whose pages the server sorts; arrow keys move in it. */
import { rateBar } from "./colors.js";
import { address, element, link, tableOf } from "./dom.js";
import { breakable, count, interval, number, percent } from "./selection.js";

const FIXED = {
  configuration: "Configuration",
  rate: "Success rate",
  runs: "Runs",
  failed: "Failed",
  not_judged: "Not judged",
};

/**
 * Show a page of rows.
 * @param {HTMLElement} place
 * @param {any} found Reply of /api/rows.
 * @param {{c: string, sort: string, descending: boolean, size: number}} state
 * @param {(change: {sort?: string, descending?: boolean, start?: number}) => void} turn
 */
export function showTable(place, found, { c, sort, descending, size }, turn) {
  const columns = [...Object.entries(FIXED), ...found.columns.map(({ name }) => [name, name])];
  const classes = ["name", "n", "n", "n", "n", ...found.columns.map(({ text }) => (text ? "" : "n"))];
  const focused = place.contains(document.activeElement) && document.activeElement.closest("td, th");
  const at = focused ? [focused.parentElement.rowIndex, focused.cellIndex] : [0, 0];
  const heads = columns.map(([name, title]) => {
    const click = () => turn({ sort: name, descending: name === sort && !descending, start: 0 });
    return element("button", { click }, ...breakable(title));
  });
  const rows = found.rows.map((each) => {
    const { configuration: name, rate, passed, failed, not_judged: others } = each;
    const bar = rate === null ? [] : [rateBar(rate, each.interval, 60)];
    const values = each.values.map((value) => (typeof value === "number" ? number(value) : (value ?? "–")));
    const opened = link(address("/configuration", { c, name }), name);
    return [opened, [...bar, percent(rate)], ...[passed + failed + others, failed, others].map(count), ...values];
  });
  const box = tableOf(heads, rows, classes);
  const table = /** @type {HTMLTableElement} */ (box.firstChild);
  table.setAttribute("aria-label", "Configurations");
  table.addEventListener("keydown", move);
  columns.forEach(([name], k) => {
    const order = descending ? "descending" : "ascending";
    table.rows[0].cells[k].setAttribute("aria-sort", name === sort ? order : "none");
  });
  found.rows.forEach((each, k) => (table.rows[k + 1].cells[1].title = interval(each.interval)));
  for (const cell of table.querySelectorAll("td, th")) target(cell).tabIndex = -1;
  const last = Math.min(found.start + size, found.total);
  const range = `${count(found.start + 1)}–${count(last)} of ${count(found.total)} configurations`;
  const page = (title, start, disabled) => element("button", { disabled, click: () => turn({ start }) }, title);
  const pages = element(
    "div",
    { class: "tools" },
    page("Previous", Math.max(found.start - size, 0), found.start === 0),
    page("Next", found.start + size, last >= found.total),
    element("span", { class: "muted" }, found.total ? range : "No configuration is selected."),
  );
  place.replaceChildren(element("h2", {}, "Configurations"), box, pages);
  const cells = table.rows[Math.min(at[0], rows.length)].cells;
  reach(table, cells[Math.min(at[1], columns.length - 1)], Boolean(focused));
}

/** What in a cell has the focus: its button or link, else itself. */
const target = (cell) => cell.querySelector("a, button") ?? cell;

function reach(table, cell, focus) {
  for (const each of table.querySelectorAll('[tabindex="0"]')) each.tabIndex = -1;
  target(cell).tabIndex = 0;
  if (focus) target(cell).focus();
}

function move(event) {
  const table = event.currentTarget;
  const cell = event.target.closest("td, th");
  const [line, column, last] = [cell.parentElement.rowIndex, cell.cellIndex, table.rows.length - 1];
  const to = {
    Home: [line, 0],
    End: [line, table.rows[0].cells.length - 1],
    PageUp: [1, column],
    PageDown: [last, column],
    ArrowUp: [line - 1, column],
    ArrowDown: [line + 1, column],
    ArrowLeft: [line, column - 1],
    ArrowRight: [line, column + 1],
  }[event.key];
  if (!to || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  const next = table.rows[to[0]]?.cells[to[1]];
  if (next) reach(table, next, true);
}
