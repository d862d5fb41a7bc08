/** A table of configurations whose pages the server sorts; arrow keys move in it. */
import { address, drawn, element } from "./dom.js";
import { breakable, count, interval, number, percent } from "./selection.js";

const FIXED = [
  ["configuration", "Configuration"],
  ["rate", "Success rate"],
  ["runs", "Runs"],
  ["failed", "Failed"],
  ["not_judged", "Not judged"],
];

/**
 * Show a page of rows.
 * @param {HTMLElement} place
 * @param {any} found Reply of /api/rows.
 * @param {{c: string, sort: string, descending: boolean, size: number}} state
 * @param {(change: {sort?: string, descending?: boolean, start?: number}) => void} turn
 */
export function showTable(place, found, { c, sort, descending, size }, turn) {
  const columns = [...FIXED, ...found.columns.map(({ name }) => [name, name])];
  const had = place.contains(document.activeElement);
  const at = had ? cellOf(place, document.activeElement) : [0, 0];
  const heads = columns.map(([name, title], k) => {
    const sorted = name === sort ? (descending ? "descending" : "ascending") : "none";
    const text = k >= FIXED.length && found.columns[k - FIXED.length].text;
    const click = () => turn({ sort: name, descending: name === sort ? !descending : false, start: 0 });
    const button = element("button", { click, tabindex: -1 }, ...breakable(title));
    return element("th", { scope: "col", "aria-sort": sorted, class: k === 0 || text ? "" : "n" }, button);
  });
  const rows = found.rows.map((row) => {
    const runs = row.passed + row.failed + row.not_judged;
    const link = element(
      "a",
      { href: address("/configuration", { c, name: row.configuration }), tabindex: -1 },
      row.configuration,
    );
    const values = row.values.map((value, k) => {
      if (value === null) return cell("n muted", "–", "not measured");
      return cell(found.columns[k].text ? "" : "n", typeof value === "number" ? number(value) : value);
    });
    const rate = element(
      "td",
      { class: "n rate", tabindex: -1, title: interval(row.interval) },
      rateBar(row),
      percent(row.rate),
    );
    const name = element("td", { class: "name", tabindex: -1 }, link);
    return element(
      "tr",
      {},
      name,
      rate,
      cell("n", count(runs)),
      cell("n", count(row.failed)),
      cell("n", count(row.not_judged)),
      ...values,
    );
  });
  const body = element("tbody", {}, ...rows);
  const table = element(
    "table",
    { "aria-label": "Configurations", keydown: move },
    element("thead", {}, element("tr", {}, ...heads)),
    body,
  );
  const last = Math.min(found.start + size, found.total);
  const range = found.total
    ? `${count(found.start + 1)}–${count(last)} of ${count(found.total)} configurations`
    : "No configuration is selected.";
  const page = (title, start, disabled) => element("button", { disabled, click: () => turn({ start }) }, title);
  const pages = element(
    "div",
    { class: "tools" },
    page("Previous", Math.max(found.start - size, 0), found.start === 0),
    page("Next", found.start + size, last >= found.total),
    element("span", { class: "muted" }, range),
  );
  place.replaceChildren(element("h2", {}, "Configurations"), element("div", { class: "scroll" }, table), pages);
  const first = cellsOf(table)[Math.min(at[0], rows.length)]?.[Math.min(at[1], columns.length - 1)];
  if (first) reach(table, first, had);
}

function cell(kind, text, title = "") {
  return element("td", { class: kind, tabindex: -1, ...(title ? { title } : {}) }, text);
}

/** The rate as a bar with its interval. */
function rateBar({ rate, interval: ends }) {
  if (rate === null) return "";
  const band = drawn("rect", { x: 60 * ends[0], y: 2, width: 60 * (ends[1] - ends[0]), height: 6, class: "interval" });
  const mark = drawn("rect", { x: 60 * rate - 1, y: 0, width: 2, height: 10, class: "mark" });
  const ground = drawn("rect", { x: 0, y: 2, width: 60, height: 6, class: "well" });
  return drawn(
    "svg",
    { class: "small-bar", viewBox: "-1 0 62 10", width: 62, height: 10, "aria-hidden": "true" },
    ground,
    band,
    mark,
  );
}

/** What in a cell has the focus: its button or link, else itself. */
const target = (cell) => cell.querySelector("a, button") ?? cell;

const cellsOf = (table) => [...table.rows].map((row) => [...row.cells]);

function cellOf(place, focused) {
  const cell = focused.closest("td, th");
  return cell && place.contains(cell) ? [cell.parentElement.rowIndex, cell.cellIndex] : [0, 0];
}

function reach(table, cell, focus) {
  for (const each of table.querySelectorAll('[tabindex="0"]')) each.setAttribute("tabindex", "-1");
  const chosen = target(cell);
  chosen.setAttribute("tabindex", "0");
  if (focus) chosen.focus();
}

function move(event) {
  const table = event.currentTarget;
  const [row, column] = cellOf(table, event.target);
  const cells = cellsOf(table);
  const ends = {
    Home: [row, 0],
    End: [row, cells[row].length - 1],
    PageUp: [1, column],
    PageDown: [cells.length - 1, column],
  };
  const steps = {
    ArrowUp: [row - 1, column],
    ArrowDown: [row + 1, column],
    ArrowLeft: [row, column - 1],
    ArrowRight: [row, column + 1],
  };
  const to = { ...ends, ...steps }[event.key];
  if (!to || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  const cell = cells[to[0]]?.[to[1]];
  if (cell) reach(table, cell, true);
}
