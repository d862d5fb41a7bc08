/** The page of a configuration: its runs over each other, their signals and events, and its nearest neighbor. */
import { lineChart, rangeOf, verdictKey, widthIn } from "./chart.js";
import { address, element, fetchJson, showError } from "./dom.js";
import { MapView } from "./map.js";
import { fetchPacked } from "./packed.js";
import { saveButtons } from "./save.js";
import { count, number, percent, VERDICTS } from "./selection.js";

const query = new URLSearchParams(location.search);
const [c, name] = [query.get("c"), query.get("name")];
const state = { signal: query.get("signal"), over: query.get("over") ?? "t_s" };
const OVER = { t_s: "time (s)", distance_m: "distance driven (m)" };
const ROOM_M = 1;
const $ = (id) => document.getElementById(id);
const runAddress = (configuration, run, t = null) => address("/run", { c, configuration, run, t });
const words = { pass: "passed", fail: "failed", "not judged": "not judged" };

const remember = () =>
  history.replaceState(
    null,
    "",
    address("/configuration", { c, name, signal: state.signal, over: state.over === "t_s" ? null : state.over }),
  );

function shown(place, view) {
  return view().catch((error) => showError(place, error));
}

/** A value as a text; places and lists are folded. */
function text(value) {
  if (value === null) return "–";
  if (typeof value === "number") return number(value);
  if (!/^[[{]./.test(value) || value.length < 30) return value;
  return element("details", {}, element("summary", {}, value[0] === "[" ? "list" : "place"), value);
}

/** @returns {HTMLElement} A table in a box that scrolls by itself. */
function tableOf(heads, rows) {
  const head = element("thead", {}, element("tr", {}, ...heads.map((each) => element("th", { scope: "col" }, each))));
  const body = rows.map((row) =>
    element("tr", {}, ...row.map((each) => element("td", {}, each instanceof Node ? each : text(each)))),
  );
  return element("div", { class: "scroll" }, element("table", {}, head, element("tbody", {}, ...body)));
}

function showRuns(found) {
  const rows = found.runs.map((run) => {
    const link = run.recorded ? element("a", { href: runAddress(name, run.run) }, `Run ${run.run}`) : `Run ${run.run}`;
    const verdict = element("span", { class: run.verdict.replace(" ", "-") }, words[run.verdict]);
    return [link, verdict, run.outcome, run.cause ?? "", run.reason ?? "", run.simulated_s, run.distance_m];
  });
  const heads = ["Run", "Verdict", "Outcome", "Cause", "Reason", "Time (s)", "Distance (m)"];
  $("runs").replaceChildren(element("h2", {}, "Runs"), tableOf(heads, rows));
}

function showEvents(found) {
  const rows = found.events.map((event) => {
    const link = element(
      "a",
      { href: runAddress(name, event.run, event.t_s) },
      `Run ${event.run}, ${number(event.t_s)} s`,
    );
    return [link, event.kind.replaceAll("_", " "), event.what];
  });
  const none = element("p", { class: "muted" }, "No event was recorded.");
  const list = rows.length ? tableOf(["When", "Event", "What"], rows) : none;
  const title = element("summary", {}, `Events (${count(rows.length)})`);
  $("events").replaceChildren(element("details", { open: rows.length <= 30 }, title, list));
}

function showNeighbor({ neighbor, rate }) {
  const passes = neighbor ? neighbor.passes : rate !== 1;
  const title = element("h2", {}, `Nearest configuration that ${passes ? "passes" : "fails"}`);
  if (!neighbor) {
    $("neighbor").replaceChildren(
      title,
      element("p", { class: "muted" }, `No other configuration ${passes ? "passes" : "fails"} more often.`),
    );
    return;
  }
  const link = element("a", { href: address("/configuration", { c, name: neighbor.name }) }, neighbor.name);
  const judged = neighbor.passed + neighbor.failed;
  const line = element(
    "p",
    {},
    link,
    `: ${count(neighbor.passed)} of ${count(judged)} judged runs passed. ${neighbor.differences.length} values differ, ${neighbor.equal} are equal.`,
  );
  const rows = neighbor.differences.map((each) => [each.name, each.own, each.other]);
  $("neighbor").replaceChildren(title, line, tableOf(["Value", "Here", "There"], rows));
}

/** The part of a map with some points (x, y), and some room round it. */
function extentOf(points, whole) {
  const ends = [0, 1].flatMap((axis) => {
    const [low, high] = rangeOf(points.filter((_, k) => k % 2 === axis));
    return [low - ROOM_M, high + ROOM_M];
  });
  return ends.map((end, k) => (k % 2 ? Math.min(end, whole[k]) : Math.max(end, whole[k])));
}

const showMap = (found) =>
  shown($("map"), async () => {
    const content = await fetchPacked(address("/api/configuration/paths", { c, name }));
    const { header } = content;
    if (!header.floor || header.form === "nothing") {
      $("map").replaceChildren(element("h2", {}, "Map"), element("p", { class: "muted" }, header.problem));
      return;
    }
    $("map").replaceChildren(element("h2", {}, "Map"));
    const map = new MapView($("map"), `${name}-map`, runAddress);
    const contacts = found.events.filter(({ kind }) => kind === "contact");
    const { start, goals, obstacles } = found.around;
    const marks = (shape, places) => places.map(([x, y]) => ({ shape, x, y }));
    const met = contacts.map((event) => [event.x_m, event.y_m]);
    map.marks = [...marks("ring", start ? [start] : []), ...marks("diamond", goals), ...marks("cross", met)];
    map.outlines = obstacles;
    $("map").append(
      verdictKey(),
      element(
        "p",
        { class: "muted" },
        `${count(header.runs)} recorded runs from start (○) to goal (◇); ${count(contacts.length)} contacts (✕); ${count(obstacles.length)} obstacles.`,
      ),
    );
    map.extent = extentOf([...content.arrays.xy, ...(start ?? []), ...goals.flat()], header.floor.extent);
    await map.show(content, address("/api/map.png", { c, environment: header.environment }));
  });

const showSignals = (found) =>
  shown($("signals"), async () => {
    const title = element("h2", {}, "Signals");
    if (!found.signals.length) {
      $("signals").replaceChildren(title, element("p", { class: "muted" }, "No run of it was recorded."));
      return;
    }
    if (!found.signals.includes(state.signal)) state.signal = found.signals[0];
    const place = address("/api/configuration/signals", { c, name, signal: state.signal, over: state.over });
    const { arrays } = await fetchPacked(place);
    const { x, y, starts, run: runs, verdict: verdicts } = arrays;
    const line = element("p", { class: "muted" }, "A line tells its run.");
    const chart = lineChart(
      widthIn($("signals")) - 24,
      OVER[state.over],
      state.signal,
      x,
      y,
      starts,
      verdicts,
      (k, at, value) => {
        const t = state.over === "t_s" ? number(at) : null;
        const link = element("a", { href: runAddress(name, runs[k], t) }, `Run ${runs[k]}`);
        line.replaceChildren(link, `: ${VERDICTS[verdicts[k]].word}, ${number(value)} at ${number(at)}`);
      },
    );
    const pick = (key, options) => {
      const change = (event) => {
        state[key] = event.target.value;
        remember();
        showSignals(found);
      };
      return element(
        "select",
        { change, "aria-label": key },
        ...options.map(([value, words]) => element("option", { value, selected: value === state[key] }, words)),
      );
    };
    const signals = found.signals.map((each) => [each, each]);
    const tools = [
      pick("signal", signals),
      " over ",
      pick("over", Object.entries(OVER)),
      ...saveButtons(`${name}-${state.signal}`, () => chart),
    ];
    const focus = document.activeElement?.getAttribute("aria-label");
    $("signals").replaceChildren(title, element("div", { class: "tools" }, ...tools), chart, verdictKey(), line);
    if (focus)
      /** @type {HTMLElement | null} */ (
        $("signals").querySelector(`select[aria-label="${CSS.escape(focus)}"]`)
      )?.focus();
  });

async function start() {
  try {
    const found = await fetchJson(address("/api/configuration", { c, name }));
    const judged = found.passed + found.failed;
    const rate = judged
      ? `${percent(found.rate)} passed (${count(found.passed)} of ${count(judged)} judged runs)`
      : "Nothing was judged";
    const f = `configuration=${encodeURIComponent(name).replace(/[!*]/g, (sign) => (sign === "!" ? "%21" : "%2A"))}`;
    const all = element("a", { href: address("/campaign", { c, f }) }, "select it in the campaign");
    const others = found.not_judged ? `, ${count(found.not_judged)} not judged` : "";
    $("summary").replaceChildren(
      element(
        "p",
        { class: "headline" },
        element("b", {}, rate + others),
        element("span", { class: "muted" }, `family ${found.family}`),
        all,
      ),
    );
    showRuns(found);
    showEvents(found);
    showNeighbor(found);
    const values = found.values.filter(({ value }) => value !== null).map(({ name: key, value }) => [key, value]);
    $("values").replaceChildren(element("h2", {}, "Values"), tableOf(["Name", "Value"], values));
    await Promise.all([showMap(found), showSignals(found)]);
  } catch (error) {
    showError($("error"), error);
  }
  document.documentElement.dataset.shown = "1";
}

start();
