/** The parts of a campaign's page that are folded at first: scatter, parallel coordinates, and the program. */
import { parallelChart, scatterChart, widthIn } from "./chart.js";
import { VERDICTS, verdictKey } from "./colors.js";
import { address, element, fetchPacked, link, note } from "./dom.js";
import { saveButtons } from "./save.js";
import { changed, count } from "./selection.js";

/**
 * What charts need of the page.
 * @typedef {object} Page
 * @property {string} c
 * @property {string} name Of files that are saved.
 * @property {any} state
 * @property {any} told Reply of /api/summary.
 * @property {AbortSignal} signal Of requests, which end when the selection changes.
 * @property {(conditions: import("./selection.js").Condition[]) => void} select
 * @property {() => void} again Shows the chart anew after a change of the state.
 */

/** @param {HTMLElement} place @param {Page} page */
export async function showScatter(place, { c, name, state, told, signal, select, again }) {
  const names = told.columns.map((each) => each.name);
  const first = (group) => told.columns.find((each) => each.group === group)?.name ?? names[0];
  if (!names.includes(state.x)) state.x = first("factor");
  if (!names.includes(state.y)) state.y = first("metric");
  if (!names.length) return place.replaceChildren(note("No column varies."));
  const pick = (axis) => {
    const change = (event) => {
      state[axis] = event.target.value;
      again();
    };
    const options = names.map((each) => element("option", { selected: each === state[axis] }, each));
    return element("label", {}, `${axis} `, element("select", { change }, ...options));
  };
  const query = new URLSearchParams({ c, f: state.f });
  for (const axis of [state.x, state.y]) query.append("column", axis);
  const { header, arrays } = await fetchPacked(`/api/points?${query}`, { signal });
  const [column, other] = header.columns.map((each, k) => ({ ...each, values: arrays[`column${k}`] }));
  const line = note("A point tells its run; a dragged rectangle selects.");
  const tell = (k) => {
    const [configuration, run] = [header.configurations[arrays.configuration[k]], arrays.run[k]];
    const opened = link(address("/run", { c, configuration, run }), `${configuration}, run ${run}`);
    line.replaceChildren(opened, `: ${VERDICTS[arrays.verdict[k]].word}`);
  };
  const chart = scatterChart(widthIn(place), column, other, arrays.verdict, tell, (x, y) => {
    const ends = [x, y].map((range, k) => rangeOf(header.columns[k], range)).filter(Boolean);
    select(ends.reduce((conditions, each) => changed(conditions, each.column, each), told.conditions));
  });
  const tools = element(
    "div",
    { class: "tools" },
    pick("x"),
    pick("y"),
    ...saveButtons(`${name}-scatter`, () => chart),
  );
  place.replaceChildren(tools, chart, verdictKey(), sampled(header), line);
}

/** The condition of a range on an axis, texts by their places. */
function rangeOf({ name: column, levels }, [low, high]) {
  if (!levels) return { column, low: Number(low.toPrecision(4)), high: Number(high.toPrecision(4)) };
  const values = levels.filter((_, k) => k >= low - 0.3 && k <= high + 0.3);
  return values.length ? { column, values } : null;
}

/** A chart in its own width, which scrolls where the page is narrower. */
function scrolled(chart) {
  chart.setAttribute("width", String(chart.viewBox.baseVal.width));
  return element("div", { class: "scroll" }, chart);
}

const sampled = ({ shown: n, total }) =>
  note(n < total ? `${count(n)} of ${count(total)} runs, evenly chosen.` : `All ${count(n)} selected runs.`);

/** @param {HTMLElement} place @param {Page} page */
export async function showParallel(place, { c, name, state, told, signal, select }) {
  const { header, arrays } = await fetchPacked(address("/api/points", { c, f: state.f || null }), { signal });
  if (!header.columns.length) return place.replaceChildren(note("No column varies in the selection."));
  const columns = header.columns.map((each, k) => ({ ...each, values: arrays[`column${k}`] }));
  const chart = parallelChart(widthIn(place, columns.length), columns, arrays.verdict, (k, ends) => {
    const condition = rangeOf(columns[k], ends);
    if (condition) select(changed(told.conditions, columns[k].name, condition));
  });
  const notes = [note("Values below an axis were not measured. Drag along an axis to select a range.")];
  if (header.left_out.length) notes.unshift(note(`Not drawn for want of room: ${header.left_out.join(", ")}.`));
  if (header.constant.length) notes.unshift(note(`The same in the selection: ${header.constant.join(", ")}.`));
  const tools = element("div", { class: "tools" }, ...saveButtons(`${name}-parallel`, () => chart));
  place.replaceChildren(tools, scrolled(chart), verdictKey(), sampled(header), ...notes);
}

/** @param {HTMLElement} place @param {Page} page */
export async function showPython(place, { told }) {
  const copied = element("span", { class: "muted", "aria-live": "polite" });
  const click = () =>
    navigator.clipboard.writeText(told.python).then(
      () => (copied.textContent = " copied"),
      () => (copied.textContent = " The browser does not let this page copy; select the text."),
    );
  place.replaceChildren(element("pre", {}, told.python), element("button", { click }, "Copy"), copied);
}
