/** The page of a configuration: its runs over each other, their signals and events, and its nearest neighbor. */
import { VERDICTS, verdictKey, verdictMark } from "./colors.js";
import { lineChart, rangeOf, widthIn } from "./chart.js";
import { address, element, fetchJson, fetchPacked, link, note, showError, shown, tableOf } from "./dom.js";
import { MapView } from "./map.js";
import { saveButtons } from "./save.js";
import { count, filterText, number, percent } from "./selection.js";

const query = new URLSearchParams(location.search);
const [c, name] = [query.get("c"), query.get("name")];
const state = { signal: query.get("signal"), over: query.get("over") ?? "t_s" };
const OVER = { t_s: "time (s)", distance_m: "distance driven (m)" };
const ROOM_M = 1;
const $ = (id) => document.getElementById(id);
const runAddress = (configuration, run, t = null) => address("/run", { c, configuration, run, t });

/** A value as a text; places and lists are folded. */
function text(value) {
  if (value === null || typeof value === "number") return number(value);
  if (!/^[[{]./.test(value) || value.length < 30) return value;
  return element("details", {}, element("summary", {}, value[0] === "[" ? "list" : "place"), value);
}

/** Show a part of the page below its title. */
const fill = (id, title, ...children) => $(id).replaceChildren(element("h2", {}, title), ...children);

function showRuns(found) {
  const rows = found.runs.map((run) => {
    const opened = run.recorded ? link(runAddress(name, run.run), `Run ${run.run}`) : `Run ${run.run}`;
    const words = [run.outcome, run.cause ?? "", run.reason ?? "", run.simulated_s, run.distance_m];
    return [opened, verdictMark(run.verdict), ...words.map(text)];
  });
  const heads = ["Run", "Verdict", "Outcome", "Cause", "Reason", "Time (s)", "Distance (m)"];
  fill("runs", "Runs", tableOf(heads, rows));
}

function showEvents({ events }) {
  const rows = events.map(({ run, t_s: t, kind, what }) => {
    return [link(runAddress(name, run, t), `Run ${run}, ${number(t)} s`), kind.replaceAll("_", " "), text(what)];
  });
  const list = rows.length ? tableOf(["When", "Event", "What"], rows) : note("No event was recorded.");
  const title = element("summary", {}, `Events (${count(rows.length)})`);
  $("events").replaceChildren(element("details", { open: rows.length <= 30 }, title, list));
}

function showNeighbor({ neighbor, rate }) {
  const passes = (neighbor ? neighbor.passes : rate !== 1) ? "passes" : "fails";
  const title = `Nearest configuration that ${passes}`;
  if (!neighbor) return fill("neighbor", title, note(`No other configuration ${passes} more often.`));
  const { name: other, passed, failed, differences, equal } = neighbor;
  const judged = `: ${count(passed)} of ${count(passed + failed)} judged runs passed. `;
  const differ = `${differences.length} values differ, ${equal} are equal.`;
  const line = element("p", {}, link(address("/configuration", { c, name: other }), other), judged, differ);
  const rows = differences.map((each) => [each.name, text(each.own), text(each.other)]);
  fill("neighbor", title, line, tableOf(["Value", "Here", "There"], rows));
}

/** The part of a map with some points (x, y), and some room round it. */
function extentOf(points, whole) {
  const ends = [0, 1].flatMap((axis) => {
    const [low, high] = rangeOf(points.filter((_, k) => k % 2 === axis));
    return [low - ROOM_M, high + ROOM_M];
  });
  return ends.map((end, k) => (k % 2 ? Math.min(end, whole[k]) : Math.max(end, whole[k])));
}

async function showMap(found) {
  const content = await fetchPacked(address("/api/configuration/paths", { c, name }));
  const { header } = content;
  if (!header.floor || header.form === "nothing") return fill("map", "Map", note(header.problem));
  fill("map", "Map");
  const map = new MapView($("map"), `${name}-map`, runAddress);
  const contacts = found.events.filter(({ kind }) => kind === "contact").map(({ x_m, y_m }) => [x_m, y_m]);
  const { start, goals, obstacles } = found.around;
  const marks = (shape, places) => places.map(([x, y]) => ({ shape, x, y }));
  map.marks = [...marks("ring", start ? [start] : []), ...marks("diamond", goals), ...marks("cross", contacts)];
  map.outlines = obstacles;
  const runs = `${count(header.runs)} recorded runs from start (○) to goal (◇)`;
  const met = `${count(contacts.length)} contacts (✕); ${count(obstacles.length)} obstacles.`;
  $("map").append(verdictKey(), note(`${runs}; ${met}`));
  map.extent = extentOf([...content.arrays.xy, ...(start ?? []), ...goals.flat()], header.floor.extent);
  await map.show(content, address("/api/map.png", { c, environment: header.environment }));
}

async function showSignals({ signals }) {
  if (!signals.length) return fill("signals", "Signals", note("No run of it was recorded."));
  if (!signals.includes(state.signal)) state.signal = signals[0];
  const { arrays } = await fetchPacked(address("/api/configuration/signals", { c, name, ...state }));
  const line = note("A line tells its run.");
  const width = widthIn($("signals")) - 24;
  const chart = lineChart(width, OVER[state.over], state.signal, arrays, (k, at, value) => {
    const run = arrays.run[k];
    const opened = link(runAddress(name, run, state.over === "t_s" ? number(at) : null), `Run ${run}`);
    line.replaceChildren(opened, `: ${VERDICTS[arrays.verdict[k]].word}, ${number(value)} at ${number(at)}`);
  });
  const pick = (key, options) => {
    const change = (event) => {
      state[key] = event.target.value;
      history.replaceState(null, "", address("/configuration", { c, name, ...state }));
      shown($("signals"), () => showSignals({ signals }));
    };
    const made = options.map(([value, words]) => element("option", { value, selected: value === state[key] }, words));
    return element("select", { change, "aria-label": key }, ...made);
  };
  const picks = [
    pick(
      "signal",
      signals.map((each) => [each, each]),
    ),
    " over ",
    pick("over", Object.entries(OVER)),
  ];
  const tools = element("div", { class: "tools" }, ...picks, ...saveButtons(`${name}-${state.signal}`, () => chart));
  const focus = document.activeElement.getAttribute("aria-label");
  fill("signals", "Signals", tools, chart, verdictKey(), line);
  [...tools.querySelectorAll("select")].find((each) => each.ariaLabel === focus)?.focus();
}

function showSummary({ passed, failed, rate, not_judged: others, family }) {
  const judged = passed + failed;
  const share = `${percent(rate)} passed (${count(passed)} of ${count(judged)} judged runs)`;
  const words = `${judged ? share : "Nothing was judged"}${others ? `, ${count(others)} not judged` : ""}`;
  const all = address("/campaign", { c, f: filterText([{ column: "configuration", values: [name] }]) });
  const parts = [element("b", {}, words), element("span", { class: "muted" }, `family ${family}`)];
  $("summary").replaceChildren(element("p", { class: "headline" }, ...parts, link(all, "select it in the campaign")));
}

try {
  const found = await fetchJson(address("/api/configuration", { c, name }));
  showSummary(found);
  showRuns(found);
  showEvents(found);
  showNeighbor(found);
  const values = found.values.filter(({ value }) => value !== null).map((each) => [each.name, text(each.value)]);
  fill("values", "Values", tableOf(["Name", "Value"], values));
  await Promise.all([shown($("map"), () => showMap(found)), shown($("signals"), () => showSignals(found))]);
} catch (error) {
  showError($("error"), error);
}
document.documentElement.dataset.shown = "1";
