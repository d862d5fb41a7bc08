/** Charts as SVG: points of two columns, lines over time, and parallel coordinates; with brushes. */
import { VERDICTS } from "./colors.js";
import { drawn, onDrag, ordered } from "./dom.js";
import { number } from "./selection.js";

const HEIGHT = 320;
const LEFT = 58;
const RIGHT = 12;
const TOP = 10;
const BOTTOM = 40;
const NEAR = 8;

/** @returns {number[]} Round numbers within a range. */
export function ticksOf(low, high, most = 6) {
  const rough = (high - low) / most || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= rough);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++)
    ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

/** @returns {[number, number]} Least and greatest number, a little apart where they are one. */
export function rangeOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return [0, 1];
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

function frame(width, column, other) {
  const [x, y] = [column, other].map(({ values, levels }) => {
    const [low, high] = rangeOf(values);
    const room = levels ? 0.5 : 0.03 * (high - low);
    return { low: low - room, high: high + room };
  });
  const scale = {
    x: (value) => LEFT + ((value - x.low) / (x.high - x.low)) * (width - LEFT - RIGHT),
    y: (value) => HEIGHT - BOTTOM - ((value - y.low) / (y.high - y.low)) * (HEIGHT - TOP - BOTTOM),
    fromX: (at) => x.low + ((at - LEFT) / (width - LEFT - RIGHT)) * (x.high - x.low),
    fromY: (at) => y.low + ((HEIGHT - BOTTOM - at) / (HEIGHT - TOP - BOTTOM)) * (y.high - y.low),
  };
  const lines = [];
  const named = ({ levels }, value) => (levels ? levels[value] : number(value));
  const marks = (each, range) =>
    each.levels ? each.levels.map((_, k) => k).slice(0, 40) : ticksOf(range.low, range.high);
  for (const value of marks(column, x)) {
    const at = scale.x(value);
    lines.push(drawn("line", { x1: at, x2: at, y1: TOP, y2: HEIGHT - BOTTOM, class: "grid" }));
    lines.push(drawn("text", { x: at, y: HEIGHT - BOTTOM + 14, class: "middle" }, shortened(named(column, value), 14)));
  }
  for (const value of marks(other, y)) {
    const at = scale.y(value);
    lines.push(drawn("line", { x1: LEFT, x2: width - RIGHT, y1: at, y2: at, class: "grid" }));
    lines.push(drawn("text", { x: LEFT - 6, y: at + 4, class: "end" }, shortened(named(other, value), 8)));
  }
  const middle = (HEIGHT - BOTTOM + TOP) / 2;
  lines.push(drawn("text", { x: (width + LEFT) / 2, y: HEIGHT - 8, class: "middle title" }, column.name));
  lines.push(drawn("text", { transform: `translate(12 ${middle}) rotate(-90)`, class: "middle title" }, other.name));
  return { scale, lines };
}

/** A text of at most so many letters, with its whole as a tooltip. */
function shortened(text, most) {
  const shown = drawn("tspan", {}, text.length > most ? `${text.slice(0, most - 1)}…` : text);
  if (text.length > most) shown.append(drawn("title", {}, text));
  return shown;
}

function svgOf(width, label, ...children) {
  return drawn(
    "svg",
    { class: "chart", viewBox: `0 0 ${width} ${HEIGHT}`, role: "img", "aria-label": label },
    ...children,
  );
}

/** @returns {[number, number]} A pointer's place in a chart's own units. */
function placeIn(chart, event) {
  const box = chart.getBoundingClientRect();
  return [
    ((event.clientX - box.left) / box.width) * chart.viewBox.baseVal.width,
    ((event.clientY - box.top) / box.height) * HEIGHT,
  ];
}

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

/**
 * Draw points of two columns; a dragged rectangle chooses ranges of both.
 * @param {number} width In pixels.
 * @param {{name: string, values: Float32Array, levels: string[] | null}} column
 * @param {{name: string, values: Float32Array, levels: string[] | null}} other
 * @param {Uint8Array} verdicts
 * @param {(index: number) => void} tell
 * @param {(x: [number, number], y: [number, number]) => void} choose
 * @returns {SVGElement}
 */
export function scatterChart(width, column, other, verdicts, tell, choose) {
  const { scale, lines } = frame(width, column, other);
  // Texts and whole numbers lie over each other; a fixed pattern moves them apart.
  const moved = (each, k, step) => (each.levels ? ((k * step) % 1) * 0.6 - 0.3 : 0);
  const at = Array.from(verdicts, (_, k) => {
    return [scale.x(column.values[k] + moved(column, k, 0.618)), scale.y(other.values[k] + moved(other, k, 0.7549))];
  });
  const parts = [[], [], []];
  at.forEach(([x, y], k) => {
    if (Number.isFinite(x) && Number.isFinite(y)) parts[verdicts[k]].push(`M${x.toFixed(1)} ${y.toFixed(1)}h0`);
  });
  const dots = parts.map((part, k) => drawn("path", { d: part.join(""), class: `dots ${VERDICTS[k].color}` }));
  const band = drawn("rect", { class: "band", width: 0, height: 0 });
  const chart = svgOf(width, `${other.name} over ${column.name}`, ...lines, ...dots, band);
  const mark = (from, to) => {
    const [[x, x2], [y, y2]] = [ordered(from[0], to[0]), ordered(from[1], to[1])];
    const box = { x, y, width: x2 - x, height: y2 - y };
    for (const [key, value] of Object.entries(box)) band.setAttribute(key, String(value));
  };
  const done = (from, to) => {
    if (Math.abs(from[0] - to[0]) < 4 || Math.abs(from[1] - to[1]) < 4) return;
    choose(ordered(scale.fromX(from[0]), scale.fromX(to[0])), ordered(scale.fromY(from[1]), scale.fromY(to[1])));
  };
  const hovered = (event) => {
    const nearest = nearestTo(placeIn(chart, event), at.length, (k) => at[k]);
    if (nearest >= 0) tell(nearest);
  };
  onDrag(chart, (event) => placeIn(chart, event), mark, done, hovered);
  return chart;
}

/**
 * Draw lines of runs, those of one verdict in one color, failed ones on top.
 * @param {number} width In pixels.
 * @param {string} xName
 * @param {string} yName
 * @param {any} arrays Of the reply: x, y, starts, and the verdicts of runs.
 * @param {(run: number, x: number, y: number) => void} tell
 */
export function lineChart(width, xName, yName, { x, y, starts, verdict: verdicts }, tell) {
  const { scale, lines } = frame(width, { name: xName, values: x }, { name: yName, values: y });
  const parts = [[], [], []];
  verdicts.forEach((verdict, run) => {
    let pen = "M";
    for (let k = starts[run]; k < starts[run + 1]; k++) {
      if (Number.isFinite(y[k])) parts[verdict].push(`${pen}${scale.x(x[k]).toFixed(1)} ${scale.y(y[k]).toFixed(1)}`);
      pen = Number.isFinite(y[k]) ? "L" : "M";
    }
  });
  const order = [2, 0, 1];
  const shown = order.map((k) => drawn("path", { d: parts[k].join(""), class: `line ${VERDICTS[k].color}` }));
  const chart = svgOf(width, `${yName} over ${xName}`, ...lines, ...shown);
  chart.addEventListener("pointermove", (event) => {
    const nearest = nearestTo(placeIn(chart, event), x.length, (k) => [scale.x(x[k]), scale.y(y[k])]);
    const run = starts.findLastIndex((start) => start <= nearest);
    if (nearest >= 0) tell(run, x[nearest], y[nearest]);
  });
  return chart;
}

/**
 * Draw parallel coordinates; a range that is dragged on an axis is chosen.
 * @param {number} width In pixels.
 * @param {{name: string, values: Float32Array, levels: string[] | null}[]} columns
 * @param {Uint8Array} verdicts
 * @param {(column: number, ends: [number, number]) => void} choose
 * @returns {SVGElement}
 */
export function parallelChart(width, columns, verdicts, choose) {
  const [top, bottom] = [72, HEIGHT - 26];
  const x = (k) => 30 + (k * (width - 130)) / Math.max(columns.length - 1, 1);
  const ranges = columns.map(({ values }) => rangeOf(values));
  const y = (k, value) => bottom - ((value - ranges[k][0]) / (ranges[k][1] - ranges[k][0])) * (bottom - top);
  // A path for each run, so that many make a darker band; passed and failed ones in turn, so that neither hides the other.
  const threads = Array.from(verdicts, (verdict, run) => {
    // Missing values have a place of their own below the axis.
    const at = columns.map(({ values }, k) => (Number.isNaN(values[run]) ? bottom + 14 : y(k, values[run])));
    const d = `M${at.map((place, k) => `${x(k).toFixed(1)} ${place.toFixed(1)}`).join("L")}`;
    return drawn("path", { d, class: VERDICTS[verdict].color });
  });
  const alpha = Math.min(Math.max(4 / Math.sqrt(verdicts.length), 0.06), 0.7);
  const lines = drawn("g", { class: "threads", "stroke-opacity": alpha }, ...threads);
  const axes = columns.map(({ name, levels }, k) => {
    const [low, high] = ranges[k];
    const label = drawn("text", { transform: `translate(${x(k)} ${top - 16}) rotate(-24)` }, shortened(name, 20));
    const ends = [
      [bottom + 4, levels ? levels[0] : number(low)],
      [top - 4, levels ? levels[levels.length - 1] : number(high)],
    ].map(([at, text]) => drawn("text", { x: x(k) + 4, y: at, class: "small" }, shortened(text ?? "", 7)));
    const band = drawn("rect", { class: "band", x: x(k) - 6, width: 12, y: top, height: 0 });
    const handle = drawn("rect", { class: "handle", x: x(k) - 9, width: 18, y: top, height: bottom - top });
    const at = (event) => [Math.min(Math.max(placeIn(handle.ownerSVGElement, event)[1], top), bottom)];
    const mark = ([from], [to]) => {
      band.setAttribute("y", String(Math.min(from, to)));
      band.setAttribute("height", String(Math.abs(from - to)));
    };
    const value = (place) => low + ((bottom - place) / (bottom - top)) * (high - low);
    onDrag(handle, at, mark, ([from], [to]) => {
      if (Math.abs(from - to) > 3) choose(k, ordered(value(from), value(to)));
    });
    const line = drawn("line", { x1: x(k), x2: x(k), y1: top, y2: bottom, class: "axis" });
    return drawn("g", {}, line, label, ...ends, band, handle);
  });
  return svgOf(width, `${verdicts.length} runs over ${columns.length} columns`, lines, ...axes);
}

/** @returns {number} Width of a chart in a part of the page, with room for some axes. */
export const widthIn = (place, axes = 4) => Math.max(70 * axes, Math.min(place.clientWidth, 900));
