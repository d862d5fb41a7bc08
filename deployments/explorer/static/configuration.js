/** The page of a configuration: its runs over each other on the map, and their signals. */
import { lineChart, rangeOf, widthIn } from "./chart.js";
import { $, address, element, fetchPacked, link, number, replace, shown, tellShown, VERDICTS } from "./dom.js";
import { MapView } from "./map_view.js";
import { saveButtons } from "./save.js";

const query = new URLSearchParams(location.search);
const [c, name] = [query.get("c"), query.get("name")];
const ROOM_M = 1;
const runAddress = (configuration, run, t = null) => address("/run", { c, configuration, run, t });

/** The part of a map with some points (x, y), and some room round it. */
function extentOf(points, whole) {
  const ends = [0, 1].flatMap((axis) => {
    const [low, high] = rangeOf(points.filter((_, k) => k % 2 === axis));
    return [low - ROOM_M, high + ROOM_M];
  });
  return ends.map((end, k) => (k % 2 ? Math.min(end, whole[k]) : Math.max(end, whole[k])));
}

async function showMap(place) {
  const content = await fetchPacked(address("/api/configuration/paths", { c, name }));
  const { header, arrays } = content;
  if (!header.floor || header.form === "nothing") throw new Error(header.problem);
  const [{ start, goals, obstacles }, contacts] = [place.dataset.around, place.dataset.contacts].map(JSON.parse);
  const map = new MapView(place, `${name}-map`, runAddress);
  const marks = (shape, places) => places.map(([x, y]) => ({ shape, x, y }));
  const crosses = contacts.map(({ x_m: x, y_m: y }) => ({ shape: "cross", x, y }));
  map.marks = [...marks("ring", start ? [start] : []), ...marks("diamond", goals), ...crosses];
  map.outlines = obstacles;
  map.extent = extentOf([...arrays.xy, ...(start ?? []), ...goals.flat()], header.floor.extent);
  await map.show(content, address("/api/map.png", { c, environment: header.environment }));
}

async function showSignals(place) {
  const [signal, over] = place.parentElement.querySelectorAll("select");
  const note = place.parentElement.querySelector(".note");
  const { arrays } = await fetchPacked(
    address("/api/configuration/signals", { c, name, signal: signal.value, over: over.value }),
  );
  const chart = lineChart(widthIn(place), over.selectedOptions[0].text, signal.value, arrays, (k, at, value) => {
    const run = arrays.run[k];
    const opened = link(runAddress(name, run, over.value === "t_s" ? number(at) : null), `Run ${run}`);
    note.replaceChildren(opened, `: ${VERDICTS[arrays.verdict[k]].word}, ${number(value)} at ${number(at)}`);
  });
  replace(place, chart, element("div", { class: "row" }, ...saveButtons(`${name}-${signal.value}`, () => chart)));
}

const [map, signals] = ["map", "signals"].map((id) => $(id).querySelector(".drawing"));
$("signals").addEventListener("change", ({ target }) => {
  query.set(target.name, target.value);
  history.replaceState(null, "", `?${query}`);
  shown(signals, () => showSignals(signals));
});
await Promise.all([shown(map, () => showMap(map)), signals && shown(signals, () => showSignals(signals))]);
tellShown();
