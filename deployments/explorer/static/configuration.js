/** The page of a configuration: its runs over each other on the map, and their signals. */
import { lineChart, rangeOf, widthIn } from "./chart.js";
import { $, address, element, fetchPacked, number, query, remember, replace } from "./dom.js";
import { shown, tellRun, tellShown } from "./dom.js";
import { MapView } from "./map_view.js";
import { saveButtons } from "./save.js";

const [c, name] = [query.get("c"), query.get("name")];
const ROOM_M = 1;

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
  const map = new MapView(place, `${name}-map`);
  const marks = (shape, places) => places.map(([x, y]) => ({ shape, x, y }));
  const crosses = contacts.map(({ x_m: x, y_m: y }) => ({ shape: "cross", x, y }));
  map.marks = [...marks("ring", start ? [start] : []), ...marks("diamond", goals), ...crosses];
  map.outlines = obstacles;
  map.extent = extentOf([...arrays.xy, ...(start ?? []), ...goals.flat()], header.floor.extent);
  map.show(content);
}

async function showSignals(place) {
  const [signal, over] = place.parentElement.querySelectorAll("select");
  const note = place.parentElement.querySelector(".note");
  const asked = { c, name, signal: signal.value, over: over.value };
  const { arrays } = await fetchPacked(address("/api/configuration/signals", asked));
  const chart = lineChart(widthIn(place), over.selectedOptions[0].text, signal.value, arrays, (k, at, value) => {
    const time = over.value === "t_s" ? number(at) : null;
    tellRun(note, name, arrays.run[k], arrays.verdict[k], `, ${number(value)} at ${number(at)}`, time);
  });
  replace(place, chart, element("div", { class: "row" }, ...saveButtons(`${name}-${signal.value}`, () => chart)));
}

const [map, signals] = ["map", "signals"].map((id) => $(id).querySelector(".drawing"));
$("signals").addEventListener("change", ({ target }) => {
  remember({ [target.name]: target.value });
  shown(signals, () => showSignals(signals));
});
await Promise.all([shown(map, () => showMap(map)), signals && shown(signals, () => showSignals(signals))]);
tellShown();
