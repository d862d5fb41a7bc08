/** The page of a campaign: one selection, which the address has, and views of it that follow. */
import { parallelChart, scatterChart, widthIn } from "./chart.js";
import { $, copy, count, element, fetchPacked, fetchParts, query, remember } from "./dom.js";
import { replace, showError, shown, stepOf, tellRun, tellShown, within } from "./dom.js";
import { brushHistograms, changed, followFields, rangeText, valuesText } from "./facets.js";
import { MapView } from "./map_view.js";
import { saveButtons } from "./save.js";

const AGAIN_MS = 1000;
/** Steps of keys that go to the end of a row or column of the table. */
const FAR = { Home: [-1e6, 0], End: [1e6, 0], PageUp: [0, -1e6], PageDown: [0, 1e6] };
const name = document.querySelector("h1").firstChild.textContent.trim();
const map = new MapView($("map").querySelector(".drawing"), `${name}-map`);
let waiting = new AbortController();

/** Ask for a view of the selection with all that the address has, of which the server takes what it knows. */
const view = (kind, ...more) => `/api/${kind}?${new URLSearchParams([...query, ...more])}`;
const packed = (...asked) => fetchPacked(view(...asked), { signal: waiting.signal });
const showPart = (kind) => fetchParts(view(kind), { signal: waiting.signal });

function setFilter(f) {
  remember({ f, start: "" });
  refresh();
}

const choose = (column, rest) => setFilter(changed(query.get("f") ?? "", column, rest));

async function refresh() {
  waiting.abort(); // what is still asked of an earlier selection
  waiting = new AbortController();
  try {
    await Promise.all(["summary", "facets", "rows"].map(showPart));
    $("error").replaceChildren();
    remember({ f: $("summary").querySelector("[data-filter]").dataset.filter });
    brushHistograms($("facets"), choose);
    await Promise.all([showMap(), showScatter(), showParallel()]);
  } catch (error) {
    showError($("error"), error);
    if (!(error instanceof DOMException))
      $("error").append(element("button", { "data-clear": "" }, "Clear all filters"));
  }
  tellShown();
}

const showMap = () => {
  const note = $("map").querySelector(".note");
  return shown(note, async () => {
    const environment = $("maps").querySelector("select")?.value;
    if (!environment) return (note.textContent = "These scenarios have no map.");
    const content = await packed("paths", ["environment", environment]);
    const { header } = content;
    map.show(content);
    const { read, configurations_here: all, damaged, problem } = header;
    const words = [
      `${count(header.runs ?? 0)} recorded runs on this map.`,
      header.form === "grid" &&
        header.layer !== "rate" &&
        "Too many to draw each, so their number in each cell is shown.",
      read < all && `Read so far: ${count(read)} of ${count(all)} configurations.`,
      damaged && `${count(damaged)} recordings are damaged.`,
    ];
    note.textContent = problem || words.filter(Boolean).join(" ");
    const { signal } = waiting;
    if (read < all && !problem) setTimeout(() => signal.aborted || showMap(), AGAIN_MS);
  });
};

/** Fill a part of the page that is folded until somebody opens it. */
const unfolded = (id, draw) => async () => {
  const place = $(id).querySelector(".drawing");
  if ($(id).open) await shown(place, () => draw(place, $(id).querySelector(".note")));
};

/** Columns of a reply with their values. */
const columnsOf = ({ header, arrays }) => header.columns.map((each, k) => ({ ...each, values: arrays[`column${k}`] }));

const sampled = ({ shown: n, total }) =>
  n < total ? `${count(n)} of ${count(total)} runs, evenly chosen.` : `All ${count(n)} selected runs.`;

const showScatter = unfolded("scatter", async (place, note) => {
  const axes = [...$("axes").querySelectorAll("select")].map((each) => each.value);
  if (!axes.length) return (note.textContent = "No column varies.");
  const content = await packed("points", ...axes.map((axis) => ["column", axis]));
  const { header, arrays } = content;
  const [column, other] = columnsOf(content);
  note.textContent = `${sampled(header)} A point tells its run; a rectangle that is dragged, or moved by arrow keys, selects.`;
  const tell = (k) => {
    tellRun(note, header.configurations[arrays.configuration[k]], arrays.run[k], arrays.verdict[k]);
  };
  const chart = scatterChart(widthIn(place), column, other, arrays.verdict, tell, (x, y) =>
    select([column, x], [other, y]),
  );
  replace(place, chart, element("div", { class: "row" }, ...saveButtons(`${name}-scatter`, () => chart)));
});

const showParallel = unfolded("parallel", async (place, note) => {
  const content = await packed("points");
  const { header, arrays } = content;
  const columns = columnsOf(content);
  if (!columns.length) return (note.textContent = "No column varies in the selection.");
  const width = widthIn(place, columns.length);
  const chart = parallelChart(width, columns, arrays.verdict, (k, ends) => select([columns[k], ends]));
  const words = [
    sampled(header),
    header.constant.length && `The same in the selection: ${header.constant.join(", ")}.`,
    header.left_out.length && `Not drawn for want of room: ${header.left_out.join(", ")}.`,
    "Values below an axis were not measured. Drag along an axis, or use its arrow keys and Enter, to select a range.",
  ];
  note.textContent = words.filter(Boolean).join(" ");
  const tools = element("div", { class: "row" }, ...saveButtons(`${name}-parallel`, () => chart));
  replace(place, element("div", { class: "scroll" }, chart), tools);
});

/** Select ranges of some columns, of texts by their places. */
function select(...ranges) {
  let filter = query.get("f") ?? "";
  for (const [{ name: column, levels }, [low, high]] of ranges) {
    const values = levels?.filter((_, k) => k >= low - 0.3 && k <= high + 0.3);
    if (values?.length !== 0) filter = changed(filter, column, values ? valuesText(values) : rangeText([low, high]));
  }
  setFilter(filter);
}

document.addEventListener("click", ({ target }) => {
  const button = target.closest("button");
  const { column, rest, clear, go, copy: copies } = button?.dataset ?? {};
  if (column) choose(column, rest);
  if (clear !== undefined) setFilter("");
  if (go) {
    remember(Object.fromEntries(new URLSearchParams(go)));
    shown($("rows"), () => showPart("rows"));
  }
  const otherwise = " The browser does not let this page copy; select the text.";
  if (copies !== undefined) copy($("program").textContent, button.nextElementSibling, " copied", otherwise);
});
followFields($("facets"), choose);
for (const [id, show] of Object.entries({ map: showMap, scatter: showScatter })) {
  $(id).addEventListener("change", ({ target }) => {
    remember({ [target.name]: target.value });
    show();
  });
}
for (const [id, show] of Object.entries({ scatter: showScatter, parallel: showParallel, python: () => {} })) {
  $(id).addEventListener("toggle", () => {
    const open = [...document.querySelectorAll(".views > details[open]")].map((each) => each.id).join(",");
    if (open === (query.get("open") ?? "")) return;
    remember({ open });
    show();
  });
}

/** Move in the table by keys; the cell that had the focus last is the one that Tab reaches. */
$("rows").addEventListener("focusin", ({ target }) => {
  const table = target.closest("table");
  for (const each of table?.querySelectorAll('[tabindex="0"]') ?? []) each.tabIndex = -1;
  if (table) target.tabIndex = 0;
});
$("rows").addEventListener("keydown", (event) => {
  const cell = event.target.closest("td, th");
  const step = FAR[event.key] ?? stepOf(event);
  if (!cell || !step) return;
  event.preventDefault();
  const { rows } = cell.closest("table");
  const line = rows[within(cell.parentElement.rowIndex + step[1], 0, rows.length - 1)];
  const next = line.cells[within(cell.cellIndex + step[0], 0, line.cells.length - 1)];
  (next.querySelector("a, button") ?? next).focus();
});
$("side").open = matchMedia("(min-width: 60rem)").matches;
refresh();
