/** The page of a campaign: one selection, and views of it that follow. */
import { showParallel, showPython, showScatter } from "./campaign_charts.js";
import { VERDICTS, verdictKey } from "./colors.js";
import { address, element, fetchJson, fetchPacked, link, note, showError, shown, tableOf } from "./dom.js";
import { showFacets } from "./facets.js";
import { MapView } from "./map.js";
import { changed, conditionWords, count, filterText, interval, percent } from "./selection.js";
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
    return element("span", { class: VERDICTS[k].color }, `${count(n)} ${VERDICTS[k].word}`);
  });
  const rate = summary.rate === null ? "Nothing was judged" : `${percent(summary.rate)} passed`;
  // Runs that were chosen by their result tell nothing of the rate.
  const ends = summary.interval && !told.by_result ? `${interval(summary.interval)}, 95 % interval of these runs` : "";
  const of = (n, all) => (n === all ? `all ${count(n)}` : `${count(n)} of ${count(all)}`);
  const configurations = of(summary.configurations, summary.all_configurations);
  const size = `${of(summary.runs, summary.all_runs)} runs, ${configurations} configurations`;
  const chips = told.conditions.map((each) => {
    const click = () => choose(each.column, null);
    const words = conditionWords(each);
    return element("button", { class: "chip", click, "aria-label": `Remove: ${words}` }, `${words} ✕`);
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
  const lists = Object.entries({ cause: "Causes", reason: "Reasons" }).flatMap(([column, title]) => {
    const { rows, left_out: hidden } = told.reasons[column];
    const cells = rows.map(({ value, runs, configurations, configuration, run }) => {
      const click = () => choose(column, { column, values: [value] });
      const attributes = { class: "link", click, title: "Select these runs" };
      const button = element("button", attributes, value ?? "none was found");
      return [button, count(runs), count(configurations), link(runAddress(configuration, run), "example")];
    });
    const table = tableOf([title, "Runs", "Configurations", ""], cells, ["", "n", "n", "n"]).firstChild;
    return rows.length ? [table, ...(hidden ? [note(`${count(hidden)} more, less frequent`)] : [])] : [];
  });
  const box = element("div", { class: "scroll" }, ...(lists.length ? lists : [note("No selected run failed.")]));
  $("reasons").replaceChildren(element("h2", {}, "Why runs failed"), box);
}

const showMap = () =>
  shown($("map"), async () => {
    if (!told.maps.length) {
      $("map").replaceChildren(element("h2", {}, "Map"), note("These scenarios have no map."));
      return;
    }
    if (!told.maps.some(({ id }) => id === state.map)) state.map = null;
    const environment = state.map ?? told.maps[0].id;
    if (!map) startMap(environment);
    const content = await fetchPacked(view("paths", { environment, layer: state.layer }), { signal: waiting.signal });
    const { header } = content;
    await map.show(content, address("/api/map.png", { c, environment }));
    const { read, configurations_here: all, damaged } = header;
    const words = [
      `${count(header.runs ?? 0)} recorded runs on this map.`,
      header.form === "grid" &&
        header.layer !== "rate" &&
        "Too many to draw each, so their number in each cell is shown.",
      read < all && `Read so far: ${count(read)} of ${count(all)} configurations.`,
      damaged && `${count(damaged)} recordings are damaged.`,
    ];
    $("map").querySelector(".note").textContent = header.problem || words.filter(Boolean).join(" ");
    if (read < all && !header.problem) {
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
    const choice = element("input", { type: "radio", name: "layer", checked: layer === state.layer, change });
    return element("label", {}, choice, title);
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
