/** The page of a campaign: one selection, and views of it that follow. */
import { showParallel, showPython, showScatter } from "./campaign_charts.js";
import { verdictKey } from "./chart.js";
import { address, element, fetchJson, showError } from "./dom.js";
import { showFacets } from "./facets.js";
import { MapView } from "./map.js";
import { fetchPacked } from "./packed.js";
import { changed, conditionWords, count, filterText, interval, percent, VERDICTS } from "./selection.js";
import { showTable } from "./table.js";

const ROWS = 50;
const AGAIN_MS = 1000;
const LAYERS = { paths: "Trajectories", ends: "Final poses", rate: "Failure rate" };
const query = new URLSearchParams(location.search);
const c = query.get("c");
const $ = (id) => document.getElementById(id);

/** What the address has. */
const state = {
  f: query.get("f") ?? "",
  map: query.get("map"),
  layer: query.get("layer") ?? "paths",
  sort: query.get("sort") ?? "rate",
  descending: query.get("order") === "descending",
  start: Number(query.get("start") ?? 0),
  x: query.get("x"),
  y: query.get("y"),
  open: new Set((query.get("open") ?? "").split(",").filter(Boolean)),
};
let told = null;
let waiting = new AbortController();
const runAddress = (configuration, run) => address("/run", { c, configuration, run });
const name = document.querySelector("h1").firstChild.textContent.trim();
let map = null;

/** Put the state into the address; the back button leaves the page as before. */
function remember() {
  const given = {
    c,
    f: state.f || null,
    map: state.map,
    layer: state.layer === "paths" ? null : state.layer,
    sort: state.sort === "rate" ? null : state.sort,
    order: state.descending ? "descending" : null,
    start: state.start || null,
    x: state.x,
    y: state.y,
    open: state.open.size ? [...state.open].join(",") : null,
  };
  history.replaceState(null, "", address("/campaign", given));
}

/** Ask for a view of the selection; a change of the selection gives up what is still asked. */
const view = (name, more = {}) => address(`/api/${name}`, { c, f: state.f || null, ...more });
const ask = (name, more = {}) => fetchJson(view(name, more), { signal: waiting.signal });

/** Run a view; its error takes its place. */
function shown(place, view) {
  return view().catch((error) => showError(place, error));
}

function choose(column, condition) {
  select(changed(told?.conditions ?? [], column, condition));
}

function select(conditions) {
  if (told) told.conditions = conditions; // a second change may come before the reply to the first
  state.f = filterText(conditions);
  state.start = 0;
  refresh();
}

async function refresh() {
  waiting.abort();
  waiting = new AbortController();
  remember();
  try {
    const rows = showRows();
    const [facets, summary] = await Promise.all(["facets", "summary"].map((each) => ask(each)));
    told = summary;
    $("error").replaceChildren();
    state.f = told.filter;
    remember();
    showSummary();
    showReasons();
    const drawnMap = showMap();
    showFacets($("facets"), facets, told.conditions, choose);
    await Promise.all([rows, drawnMap, ...["scatter", "parallel", "python"].map(showDetails)]);
  } catch (error) {
    showError($("error"), error);
    if (!(error instanceof DOMException)) $("error").append(clearButton());
  }
  document.documentElement.dataset.shown = String(Number(document.documentElement.dataset.shown ?? 0) + 1);
}

const clearButton = () => element("button", { click: () => select([]) }, "Clear all filters");

const muted = (text) => element("span", { class: "muted" }, text);

function showSummary() {
  const { summary } = told;
  const parts = [summary.passed, summary.failed, summary.not_judged].map((n, k) => {
    return element("span", { class: VERDICTS[k].name.replace(" ", "-") }, `${count(n)} ${VERDICTS[k].word}`);
  });
  const rate = summary.rate === null ? "Nothing was judged" : `${percent(summary.rate)} passed`;
  // Runs that were chosen by their result tell nothing of the rate.
  const ends = summary.interval && !told.by_result ? `${interval(summary.interval)}, 95 % interval of these runs` : "";
  const of = (n, all) => (n === all ? `all ${count(n)}` : `${count(n)} of ${count(all)}`);
  const configurations = of(summary.configurations, summary.all_configurations);
  const size = `${of(summary.runs, summary.all_runs)} runs, ${configurations} configurations`;
  const chips = told.conditions.map((each) => {
    const click = () => choose(each.column, null);
    return element(
      "button",
      { class: "chip", click, "aria-label": `Remove: ${conditionWords(each)}` },
      `${conditionWords(each)} ✕`,
    );
  });
  const files = ["csv", "parquet"].map((format) => {
    const to = address("/api/table", { c, f: state.f || null, format });
    return element("a", { class: "button", href: to, download: "" }, format === "csv" ? "CSV" : "Parquet");
  });
  const line = element("p", { class: "headline" }, element("b", {}, rate), muted(ends), ...parts, muted(size));
  const tools = element("div", { class: "tools" }, ...chips, ...(chips.length ? [clearButton()] : []), ...files);
  $("summary").replaceChildren(line, tools);
}

const showRows = () =>
  shown($("table"), async () => {
    const { sort, descending, start } = state;
    const found = await ask("rows", { sort, order: descending ? "descending" : null, start, count: ROWS });
    showTable($("table"), found, { c, sort, descending, size: ROWS }, (change) => {
      Object.assign(state, change);
      remember();
      showRows();
    });
  });

function showReasons() {
  const { reasons } = told;
  const lists = [
    ["cause", "Causes"],
    ["reason", "Reasons"],
  ].flatMap(([column, title]) => {
    const rows = reasons[column].rows.map((row) => {
      const only = () => choose(column, { column, values: [row.value] });
      const button = element(
        "button",
        { class: "link", click: only, title: "Select these runs" },
        row.value ?? "none was found",
      );
      const example = element("a", { href: runAddress(row.configuration, row.run) }, "example");
      const cells = [button, count(row.runs), count(row.configurations), example];
      return element("tr", {}, ...cells.map((each, k) => element("td", { class: k ? "n" : "" }, each)));
    });
    const more = reasons[column].left_out
      ? [element("p", { class: "muted" }, `${count(reasons[column].left_out)} more, less frequent`)]
      : [];
    const heads = [title, "Runs", "Configurations", ""].map((each, k) => element("th", { class: k ? "n" : "" }, each));
    const table = element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...heads)),
      element("tbody", {}, ...rows),
    );
    return rows.length ? [table, ...more] : [];
  });
  const none = element("p", { class: "muted" }, "No selected run failed.");
  $("reasons").replaceChildren(
    element("h2", {}, "Why runs failed"),
    element("div", { class: "scroll" }, ...(lists.length ? lists : [none])),
  );
}

const showMap = () =>
  shown($("map"), async () => {
    if (!told.maps.length) {
      $("map").replaceChildren(
        element("h2", {}, "Map"),
        element("p", { class: "muted" }, "These scenarios have no map."),
      );
      return;
    }
    if (!told.maps.some(({ id }) => id === state.map)) state.map = null;
    const environment = state.map ?? told.maps[0].id;
    if (!map) startMap(environment);
    const content = await fetchPacked(view("paths", { environment, layer: state.layer }), { signal: waiting.signal });
    const { header } = content;
    await map.show(content, address("/api/map.png", { c, environment }));
    const note = $("map").querySelector(".note");
    const damaged = header.damaged ? ` ${count(header.damaged)} recordings are damaged.` : "";
    const part =
      header.read < header.configurations_here
        ? ` Read so far: ${count(header.read)} of ${count(header.configurations_here)} configurations.`
        : "";
    const dense =
      header.form === "grid" && header.layer !== "rate"
        ? " Too many to draw each, so their number in each cell is shown."
        : "";
    note.textContent =
      header.problem || `${count(header.runs ?? 0)} recorded runs on this map.${dense}${part}${damaged}`;
    if (part && !header.problem) {
      const { signal } = waiting;
      setTimeout(() => signal.aborted || showMap(), AGAIN_MS);
    }
  });

function startMap(environment) {
  const layers = Object.entries(LAYERS).map(([layer, title]) => {
    const change = () => {
      state.layer = layer;
      remember();
      showMap();
    };
    return element(
      "label",
      {},
      element("input", { type: "radio", name: "layer", checked: layer === state.layer, change }),
      title,
    );
  });
  const choices = told.maps.map(({ id, name: title, failed }) => {
    return element("option", { value: id, selected: id === environment }, `${title} (${count(failed)} failed)`);
  });
  const change = (event) => {
    state.map = event.target.value;
    remember();
    showMap();
  };
  const maps = told.maps.length > 1 ? [element("label", {}, "Map ", element("select", { change }, ...choices))] : [];
  const tools = element("div", { class: "tools", role: "group", "aria-label": "Layer of the map" }, ...layers, ...maps);
  $("map").replaceChildren(element("h2", {}, "Map"), tools);
  map = new MapView($("map"), `${name}-map`, runAddress);
  $("map").append(verdictKey(), element("p", { class: "note muted" }));
}

/** Fill a part of the page that is folded until somebody opens it. */
function showDetails(id) {
  const place = $(id).querySelector("div");
  if (!$(id).open) return Promise.resolve();
  const again = () => {
    remember();
    showDetails(id);
  };
  const page = { c, name, state, told, signal: waiting.signal, select, again };
  return shown(place, () => ({ scatter: showScatter, parallel: showParallel, python: showPython })[id](place, page));
}

for (const id of ["scatter", "parallel", "python"]) {
  $(id).open = state.open.has(id);
  $(id).addEventListener("toggle", () => {
    if ($(id).open === state.open.has(id)) return;
    if ($(id).open) state.open.add(id);
    else state.open.delete(id);
    remember();
    if (told) showDetails(id);
  });
}
$("side").open = matchMedia("(min-width: 60rem)").matches;
refresh();
