/** Charts as SVG: points of two columns, lines over time, and parallel coordinates; with brushes. */
import { onBrush, placeIn } from "./brush.js";
import { drawn, number, VERDICTS } from "./dom.js";

const HEIGHT = 320;
const [LEFT, RIGHT, TOP, BOTTOM] = [58, 12, 10, 40];
const NEAR = 8;
const LEAST_PX = 4;
const CENTERED = { "text-anchor": "middle" };
export const DOTS = { "stroke-width": 4.5, "stroke-linecap": "round", "stroke-opacity": 0.6 };
/** Lines of failed runs are drawn over those of passed ones. */
const ORDER = [2, 0, 1];

/** @returns {number[]} Round numbers within a range, about so many at most. */
export function ticksOf(low, high, most = 6) {
  const rough = (high - low) / most || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= rough);
  const first = Math.ceil(low / step - 1e-9);
  const many = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: many }, (_, k) => Number(((first + k) * step).toPrecision(12)));
}

/** @returns {[number, number]} Least and greatest number, a little apart where they are one. */
export function rangeOf(values) {
  const wider = ([low, high], value) => [value < low ? value : low, value > high ? value : high];
  const [low, high] = values.reduce(wider, [Infinity, -Infinity]);
  if (low > high) return [0, 1];
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

/** A text of at most so many letters, with its whole as a tooltip. */
function shortened(text, most) {
  const shown = drawn("tspan", {}, text.length > most ? `${text.slice(0, most - 1)}…` : text);
  if (text.length > most) shown.append(drawn("title", {}, text));
  return shown;
}

/** An axis of numbers, or of places in `levels`: scale, its inverse, and ticks with their names. */
function axisOf({ values, levels }, start, end) {
  const [least, greatest] = rangeOf(values);
  const room = levels ? 0.5 : 0.03 * (greatest - least);
  const [low, high] = [least - room, greatest + room];
  const marks = levels ? levels.map((_, k) => k).slice(0, 40) : ticksOf(low, high);
  return {
    place: (value) => start + ((value - low) / (high - low)) * (end - start),
    value: (place) => low + ((place - start) / (end - start)) * (high - low),
    ends: levels ? [levels[0] ?? "", levels.at(-1) ?? ""] : [number(least), number(greatest)],
    ticks: marks.map((value) => [value, levels ? levels[value] : number(value)]),
  };
}

/** Axes with grid and titles. */
function frame(width, column, other) {
  const [right, bottom] = [width - RIGHT, HEIGHT - BOTTOM];
  const [x, y] = [axisOf(column, LEFT, right), axisOf(other, bottom, TOP)];
  const across = x.ticks.flatMap(([value, text]) => {
    const at = x.place(value);
    const label = drawn("text", { x: at, y: bottom + 14, ...CENTERED }, shortened(text, 14));
    return [drawn("line", { x1: at, x2: at, y1: TOP, y2: bottom, stroke: "var(--line)" }), label];
  });
  const up = y.ticks.flatMap(([value, text]) => {
    const at = y.place(value);
    const label = drawn("text", { x: LEFT - 6, y: at + 4, "text-anchor": "end" }, shortened(text, 8));
    return [drawn("line", { x1: LEFT, x2: right, y1: at, y2: at, stroke: "var(--line)" }), label];
  });
  const turned = `translate(12 ${(bottom + TOP) / 2}) rotate(-90)`;
  const below = drawn("text", { x: (width + LEFT) / 2, y: HEIGHT - 8, ...CENTERED }, column.name);
  const beside = drawn("text", { transform: turned, ...CENTERED }, other.name);
  return { x, y, limits: { x: [LEFT, right], y: [TOP, bottom] }, parts: [...across, ...up, below, beside] };
}

const chartOf = (attributes, width, ...children) =>
  drawn("svg", { class: "chart", viewBox: `0 0 ${width} ${HEIGHT}`, ...attributes }, ...children);

/** @returns {number} Index of the nearest of some places, -1 where none is near. */
export function nearestTo([x, y], n, placeOf, near = NEAR) {
  let [best, nearest] = [near ** 2, -1];
  for (let k = 0; k < n; k++) {
    const place = placeOf(k);
    const distance = (place[0] - x) ** 2 + (place[1] - y) ** 2;
    if (distance < best) [best, nearest] = [distance, k];
  }
  return nearest;
}

/** Draw points of two columns, x and y, in so many pixels; a rectangle chooses ranges of both. */
export function scatterChart(width, column, other, verdicts, tell, choose) {
  const { x, y, limits, parts } = frame(width, column, other);
  // Texts and whole numbers lie over each other; a fixed pattern moves them apart.
  const moved = ({ levels, values }, k, step) => values[k] + (levels ? ((k * step) % 1) * 0.6 - 0.3 : 0);
  const places = Array.from(verdicts, (_, k) => {
    return [x.place(moved(column, k, 0.618)), y.place(moved(other, k, 0.7549))];
  });
  const dots = ["", "", ""];
  places.forEach(([left, top], k) => {
    if (Number.isFinite(left + top)) dots[verdicts[k]] += `M${left.toFixed(1)} ${top.toFixed(1)}h0`;
  });
  const drawnDots = dots.map((d, k) => drawn("path", { d, class: VERDICTS[k].color, ...DOTS }));
  const band = drawn("rect", { class: "band" });
  const label = `${other.name} over ${column.name}; arrows move a selection, with shift they resize it, Enter takes it`;
  const attributes = { tabindex: 0, "data-key": "scatter", role: "application", "aria-label": label };
  const chart = chartOf(attributes, width, ...parts, ...drawnDots, band);
  const take = (across, down) => {
    if ([across, down].some(([low, high]) => high - low < LEAST_PX)) return;
    choose(across.map(x.value), down.map(y.value).reverse());
  };
  onBrush(chart, band, limits, "xy", take, (event) => {
    const nearest = nearestTo(placeIn(chart, event), places.length, (k) => places[k]);
    if (nearest >= 0) tell(nearest);
  });
  return chart;
}

/** Draw lines of runs, those of one verdict in one color, failed ones on top; `tell` is given run, x, and y. */
export function lineChart(width, xName, yName, { x: xs, y: ys, starts, verdict: verdicts }, tell) {
  const { x, y, parts } = frame(width, { name: xName, values: xs }, { name: yName, values: ys });
  const lines = ["", "", ""];
  verdicts.forEach((verdict, run) => {
    let pen = "M";
    for (let k = starts[run]; k < starts[run + 1]; k++) {
      const there = Number.isFinite(ys[k]);
      if (there) lines[verdict] += `${pen}${x.place(xs[k]).toFixed(1)} ${y.place(ys[k]).toFixed(1)}`;
      pen = there ? "L" : "M";
    }
  });
  const drawnLines = ORDER.map((k) => drawn("path", { d: lines[k], class: `line ${VERDICTS[k].color}`, opacity: 0.6 }));
  const chart = chartOf({ role: "img", "aria-label": `${yName} over ${xName}` }, width, ...parts, ...drawnLines);
  chart.addEventListener("pointermove", (event) => {
    const nearest = nearestTo(placeIn(chart, event), xs.length, (k) => [x.place(xs[k]), y.place(ys[k])]);
    const run = starts.findLastIndex((start) => start <= nearest);
    if (nearest >= 0) tell(run, xs[nearest], ys[nearest]);
  });
  return chart;
}

/** Draw parallel coordinates; a range of an axis is chosen on it. */
export function parallelChart(width, columns, verdicts, choose) {
  const [top, bottom] = [72, HEIGHT - 26];
  const x = (k) => 30 + (k * (width - 130)) / Math.max(columns.length - 1, 1);
  const scales = columns.map((column) => axisOf(column, bottom, top));
  // A path for each run, so that many make a darker band; passed and failed ones in turn, so that neither hides the other.
  const threads = Array.from(verdicts, (verdict, run) => {
    // Missing values have a place of their own below the axis.
    const at = columns.map(({ values }, k) => (Number.isNaN(values[run]) ? bottom + 14 : scales[k].place(values[run])));
    const d = `M${at.map((place, k) => `${x(k).toFixed(1)} ${place.toFixed(1)}`).join("L")}`;
    return drawn("path", { d, class: `line ${VERDICTS[verdict].color}` });
  });
  const alpha = Math.min(Math.max(4 / Math.sqrt(verdicts.length), 0.06), 0.7);
  const axes = columns.map(({ name }, k) => {
    const label = drawn("text", { transform: `translate(${x(k)} ${top - 16}) rotate(-24)` }, shortened(name, 20));
    const ends = scales[k].ends.map((text, end) => {
      return drawn("text", { x: x(k) + 4, y: end ? top - 4 : bottom + 4 }, shortened(text, 7));
    });
    const line = drawn("line", { x1: x(k), x2: x(k), y1: top, y2: bottom, stroke: "var(--muted)" });
    const band = drawn("rect", { class: "band" });
    const box = { x: x(k) - 9, width: 18, y: top, height: bottom - top, class: "handle", "fill-opacity": 0 };
    const keys = { tabindex: 0, role: "application", "aria-label": name, "data-key": `axis ${name}` };
    const handle = drawn("rect", { ...box, ...keys });
    const axis = drawn("g", {}, line, label, ...ends, band, handle);
    const take = (_, down) => down[1] - down[0] >= LEAST_PX && choose(k, down.map(scales[k].value).reverse());
    onBrush(handle, band, { x: [x(k) - 6, x(k) + 6], y: [top, bottom] }, "y", take);
    return axis;
  });
  const label = `${verdicts.length} runs over ${columns.length} columns`;
  const lines = drawn("g", { "stroke-opacity": alpha }, ...threads);
  return chartOf({ role: "group", "aria-label": label, width }, width, lines, ...axes);
}

/** @returns {number} Width of a chart in a part of the page, with room for some axes. */
export const widthIn = (place, axes = 4) => Math.max(70 * axes, Math.min(place.clientWidth, 900));
