/** The parts of a campaign's page that are folded at first: scatter, parallel coordinates, and the program. */
import { parallelChart, scatterChart, verdictKey, widthIn } from "./chart.js";
import { address, element } from "./dom.js";
import { fetchPacked } from "./packed.js";
import { saveButtons } from "./save.js";
import { changed, count, VERDICTS } from "./selection.js";

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

/**
 * @param {HTMLElement} place
 * @param {Page} page
 */
export async function showScatter(place, { c, name, state, told, signal, select, again }) {
  const numbers = told.columns.map((each) => each.name);
  state.x = numbers.includes(state.x)
    ? state.x
    : (told.columns.find(({ group }) => group === "factor")?.name ?? numbers[0]);
  state.y = numbers.includes(state.y)
    ? state.y
    : (told.columns.find(({ group }) => group === "metric")?.name ?? numbers[0]);
  if (!state.x || !state.y) return place.replaceChildren(element("p", { class: "muted" }, "No column varies."));
  const pick = (axis) => {
    const change = (event) => {
      state[axis] = event.target.value;
      again();
    };
    const options = numbers.map((each) => element("option", { selected: each === state[axis] }, each));
    return element("label", {}, `${axis} `, element("select", { change }, ...options));
  };
  const names = new URLSearchParams([
    ["c", c],
    ["f", state.f],
    ["column", state.x],
    ["column", state.y],
  ]);
  const { header, arrays } = await fetchPacked(`/api/points?${names}`, { signal });
  const [first, second] = header.columns.map((each, k) => ({ ...each, values: arrays[`column${k}`] }));
  const { configuration: names1, run: runs, verdict: verdicts } = arrays;
  const line = element("p", { class: "muted" }, "A point tells its run; a dragged rectangle selects.");
  const tell = (k) => {
    const configuration = header.configurations[names1[k]];
    const link = element(
      "a",
      { href: address("/run", { c, configuration, run: runs[k] }) },
      `${configuration}, run ${runs[k]}`,
    );
    line.replaceChildren(link, `: ${VERDICTS[verdicts[k]].word}`);
  };
  const chart = scatterChart(widthIn(place), first, second, verdicts, tell, (x, y) => {
    const ends = [x, y].map((range, k) => rangeOf(header.columns[k], range)).filter(Boolean);
    select(ends.reduce((conditions, each) => changed(conditions, each.column, each), told.conditions));
  });
  const saved = saveButtons(`${name}-scatter`, () => chart);
  place.replaceChildren(
    element("div", { class: "tools" }, pick("x"), pick("y"), ...saved),
    chart,
    verdictKey(),
    sampled(header),
    line,
  );
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
  element(
    "p",
    { class: "muted" },
    n < total ? `${count(n)} of ${count(total)} runs, evenly chosen.` : `All ${count(n)} selected runs.`,
  );

/**
 * @param {HTMLElement} place
 * @param {Page} page
 */
export async function showParallel(place, { c, name, state, told, signal, select }) {
  const { header, arrays } = await fetchPacked(address("/api/points", { c, f: state.f || null }), { signal });
  if (!header.columns.length)
    return place.replaceChildren(element("p", { class: "muted" }, "No column varies in the selection."));
  const columns = header.columns.map((each, k) => ({ ...each, values: arrays[`column${k}`] }));
  const chart = parallelChart(widthIn(place, columns.length), columns, arrays.verdict, (k, ends) => {
    const condition = rangeOf(columns[k], ends);
    if (condition) select(changed(told.conditions, columns[k].name, condition));
  });
  const hidden = [
    ...(header.constant.length ? [`The same in the selection: ${header.constant.join(", ")}.`] : []),
    ...(header.left_out.length ? [`Not drawn for want of room: ${header.left_out.join(", ")}.`] : []),
    "Values below an axis were not measured. Drag along an axis to select a range.",
  ].map((text) => element("p", { class: "muted" }, text));
  place.replaceChildren(
    element("div", { class: "tools" }, ...saveButtons(`${name}-parallel`, () => chart)),
    scrolled(chart),
    verdictKey(),
    sampled(header),
    ...hidden,
  );
}

/**
 * @param {HTMLElement} place
 * @param {Page} page
 */
export async function showPython(place, { told }) {
  const copied = element("span", { class: "muted", "aria-live": "polite" });
  const click = async () => {
    const done = await navigator.clipboard.writeText(told.python).then(
      () => true,
      () => false,
    );
    copied.textContent = done ? " copied" : " The browser does not let this page copy; select the text.";
  };
  place.replaceChildren(element("pre", {}, told.python), element("button", { click }, "Copy"), copied);
}
