/** The time line and the signals of one or two runs, over one time axis. */

import { element } from "./dom.js";
import { band } from "./player_theme.js";

const LEFT = 52;
const RIGHT = 12;
const BAND_H = 16;
const TICKS_H = 18;
const AXIS_H = 18;
const PLOT_H = 64;
const SNAP_PX = 6;
const MARK_COLORS = {
  contact: "fail",
  recovery: "recovery",
  error: "error",
  goal: "goal",
  obstacle: "obstacle-edge",
  stop: "stop",
};

export class Tracks {
  /**
   * @param {HTMLElement} place
   * @param {Array<{run: import("./player_run.js").Run, activities: Array<[number, number, string]>}>} sides
   * @param {number} end Time of the end of the longer run.
   * @param {(t: number) => void} seek
   */
  constructor(place, sides, end, seek) {
    this.sides = sides;
    this.end = Math.max(end, 0.1);
    this.seek = seek;
    this.cursor = element("div", { class: "cursor" });
    this.hint = element("div", { class: "hint", hidden: true });
    this.line = element("canvas", {
      class: "track",
      tabindex: 0,
      role: "slider",
      "aria-label": "Time",
      "aria-valuemin": 0,
      "aria-valuemax": this.end.toFixed(2),
    });
    this.plots = this.#titles().map((plot) => ({ ...plot, ...plotElements(plot) }));
    const rows = this.plots.flatMap(({ caption, canvas }) => [caption, canvas]);
    place.replaceChildren(this.line, ...rows, this.cursor, this.hint);
    this.place = place;
    for (const canvas of [this.line, ...this.plots.map((plot) => plot.canvas)]) {
      canvas.addEventListener("pointerdown", (event) => this.#point(/** @type {PointerEvent} */ (event), true));
      canvas.addEventListener("pointermove", (event) => this.#point(/** @type {PointerEvent} */ (event), false));
      canvas.addEventListener("pointerleave", () => (this.hint.hidden = true));
    }
  }

  /** Plots that any of the runs has, in the order of the first. */
  #titles() {
    const found = new Map();
    for (const { run } of this.sides) {
      for (const { title, unit, lines } of run.header.signals || []) {
        const known = found.get(title) || { title, unit, lines: {} };
        found.set(title, { ...known, lines: { ...known.lines, ...lines } });
      }
    }
    return [...found.values()];
  }

  #point(event, pressed) {
    const { left, width } = event.currentTarget.getBoundingClientRect();
    const px = event.clientX - left;
    let t = ((px - LEFT) / (width - LEFT - RIGHT)) * this.end;
    const near = event.currentTarget === this.line ? this.#near(px, width) : null;
    if (pressed) event.currentTarget.setPointerCapture(event.pointerId);
    if (pressed || event.buttons & 1) this.seek(near && pressed ? near.t_s : Math.min(Math.max(t, 0), this.end));
    this.hint.hidden = !near;
    if (!near) return;
    this.hint.textContent = `${near.t_s.toFixed(2)} s: ${near.text}`;
    const x = Math.min(px + 8, width - this.hint.offsetWidth - 4);
    this.hint.style.transform = `translate(${Math.max(x, 0)}px, ${this.line.offsetTop + this.line.offsetHeight}px)`;
  }

  #near(px, width) {
    const apart = (event) => Math.abs(this.#x(event.t_s, width) - px);
    const events = this.sides.flatMap(({ run }) => run.events).filter((event) => apart(event) <= SNAP_PX);
    return events.sort((a, b) => apart(a) - apart(b))[0] || null;
  }

  #x(t, width) {
    return LEFT + (t / this.end) * (width - LEFT - RIGHT);
  }

  /** @param {number} t */
  moveTo(t) {
    this.cursor.style.transform = `translateX(${this.#x(t, this.line.clientWidth)}px)`;
    this.line.setAttribute("aria-valuenow", t.toFixed(2));
    this.line.setAttribute("aria-valuetext", `${t.toFixed(2)} seconds`);
    for (const { lines, unit, values } of this.plots) {
      const said = this.sides.map(({ run }) =>
        Object.entries(lines)
          .filter(([column]) => run.columns[column])
          .map(([column, label]) => `${label} ${reading(t > run.end ? NaN : run.value(column, t))}`.trim())
          .join(" · "),
      );
      values.textContent = `${said.join("  |  ")} ${unit}`;
    }
  }

  /**
   * Draw all but the cursor.
   * @param {Object<string, string>} theme
   */
  paint(theme) {
    const rows = this.sides.map(({ run }) => laneRows(run.header.behaviors || []));
    const heights = rows.map((lanes) => TICKS_H + BAND_H + lanes.length * BAND_H + 4);
    const height = heights.reduce((sum, each) => sum + each, AXIS_H);
    const [context, width] = sized(this.line, height);
    context.font = "11px system-ui, sans-serif";
    let top = 0;
    this.sides.forEach((side, k) => {
      this.#side(context, width, top, side, rows[k], theme, k);
      top += heights[k];
    });
    this.#axis(context, width, top, theme);
    for (const plot of this.plots) this.#plot(plot, theme);
  }

  #side(context, width, top, { run, activities }, lanes, theme, k) {
    const x = (t) => this.#x(t, width);
    for (const event of run.events) {
      mark(context, event.mark, x(event.t_s), top + TICKS_H / 2, theme[MARK_COLORS[event.mark]], theme.panel);
    }
    const middle = top + TICKS_H;
    context.textBaseline = "middle";
    context.fillStyle = theme.muted;
    context.fillText(this.sides.length > 1 ? `robot ${"AB"[k]}` : "robot", 2, middle + BAND_H / 2);
    for (const [start, end, kind] of activities) {
      const [color, alpha] = band(kind);
      bar(context, x(start), x(end), middle, theme[color], alpha, kind, alpha > 0.6 ? theme.panel : theme.ink);
    }
    lanes.forEach((spans, lane) => {
      const y = middle + (lane + 1) * BAND_H + 2;
      context.fillStyle = theme.muted;
      if (!lane) context.fillText("scenario", 2, y + BAND_H / 2);
      for (const { name, start_s, end_s, status } of spans) {
        const color = status === "FAILURE" ? theme.fail : status === "SUCCESS" ? theme.pass : theme.muted;
        bar(context, x(start_s), x(end_s), y, color, 0.18, name, theme.ink);
      }
    });
  }

  #axis(context, width, top, theme) {
    context.fillStyle = theme.muted;
    context.textBaseline = "top";
    const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
    const step = steps.find((each) => (each / this.end) * (width - LEFT - RIGHT) > 48) || steps[steps.length - 1];
    for (let k = 0; k * step <= this.end + 1e-9; k += 1) {
      const x = this.#x(k * step, width);
      context.fillRect(x, top, 1, 4);
      const text = `${+(k * step).toFixed(1)}${k ? "" : " s"}`;
      context.fillText(text, Math.min(x + 2, width - context.measureText(text).width), top + 5);
    }
  }

  #plot({ canvas, lines, title }, theme) {
    const [context, width] = sized(canvas, PLOT_H);
    const columns = this.sides.map(({ run }) => Object.keys(lines).map((column) => run.columns[column]));
    const all = columns.flat().filter(Boolean);
    let [low, high] = [0, 0];
    for (const values of all) {
      for (const value of values) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    // A jump at one moment, such as a contact's, must not flatten the rest: but it is never cut off either.
    if (high === low) high = low + 1;
    const y = (value) => 5 + ((high - value) / (high - low)) * (PLOT_H - 10);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = theme.line;
    context.fillRect(LEFT, y(0), width - LEFT - RIGHT, 1);
    context.fillStyle = theme.muted;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of low < 0 && high > 0 ? [low, 0, high] : [low, high]) {
      context.fillText(reading(value), LEFT - 5, Math.min(Math.max(y(value), 7), PLOT_H - 7));
    }
    const dashes = [[], [4, 3], [1, 3]];
    this.sides.forEach(({ run }, k) => {
      columns[k].forEach((values, n) => {
        if (!values) return;
        context.beginPath();
        drawLine(context, run.t, values, (t) => this.#x(t, width), y);
        context.setLineDash(dashes[n % dashes.length]);
        context.strokeStyle = k ? theme.second : n === 0 ? theme.accent : theme.muted;
        context.lineWidth = n ? 1.1 : 1.4;
        context.stroke();
      });
    });
    canvas.setAttribute("aria-label", `${title} over time`);
  }
}

function plotElements({ title }) {
  const values = element("span", { class: "values" });
  const caption = element("div", { class: "caption" }, element("span", {}, title), values);
  return { caption, values, canvas: element("canvas", { class: "track", role: "img" }) };
}

/** Put spans that overlap into rows below each other. */
function laneRows(spans) {
  const lanes = [];
  for (const span of [...spans].sort((a, b) => a.start_s - b.start_s)) {
    const free = lanes.find((lane) => lane[lane.length - 1].end_s <= span.start_s + 1e-9);
    if (free) free.push(span);
    else lanes.push([span]);
  }
  return lanes;
}

function sized(canvas, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.style.height = `${height}px`;
  const width = canvas.clientWidth;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, width];
}

function bar(context, left, right, top, color, alpha, text, ink) {
  context.globalAlpha = alpha;
  context.fillStyle = color;
  context.fillRect(left, top, Math.max(right - left - 0.5, 1), BAND_H - 2);
  context.globalAlpha = 1;
  if (context.measureText(text).width + 8 > right - left) return;
  context.fillStyle = ink;
  context.fillText(text, left + 4, top + BAND_H / 2 - 1);
}

/** Ticks differ by shape as well as by color. */
function mark(context, kind, x, y, color, edge) {
  context.fillStyle = context.strokeStyle = color;
  context.lineWidth = 2;
  context.beginPath();
  if (kind === "contact") {
    context.moveTo(x - 4, y - 4);
    context.lineTo(x + 4, y + 4);
    context.moveTo(x - 4, y + 4);
    context.lineTo(x + 4, y - 4);
    context.stroke();
    return;
  }
  if (kind === "recovery") context.arc(x, y, 4, 0, 2 * Math.PI);
  else if (kind === "goal") for (const [dx, dy] of [[0, -5], [5, 0], [0, 5], [-5, 0]]) context.lineTo(x + dx, y + dy); // prettier-ignore
  else if (kind === "error") for (const [dx, dy] of [[0, -5], [5, 4], [-5, 4]]) context.lineTo(x + dx, y + dy); // prettier-ignore
  else context.rect(x - 3.5, y - 3.5, 7, 7);
  context.closePath();
  context.fill();
  context.strokeStyle = edge;
  context.lineWidth = 1;
  context.stroke();
}

/** A line through samples, broken where nothing was measured; of many on one pixel the least and the greatest. */
function drawLine(context, ts, values, x, y) {
  let open = false;
  let column = NaN;
  let [low, high] = [0, 0];
  for (let k = 0; k < values.length; k += 1) {
    if (Number.isNaN(values[k])) {
      open = false;
      continue;
    }
    const [px, py] = [x(ts[k]), y(values[k])];
    if (open && Math.round(px) === column && py >= low && py <= high) continue;
    if (Math.round(px) !== column) [low, high] = [py, py];
    column = Math.round(px);
    [low, high] = [Math.min(low, py), Math.max(high, py)];
    if (open) context.lineTo(px, py);
    else context.moveTo(px, py);
    open = true;
  }
}

/**
 * A number for people; a missing one is no 0.
 * @param {number | null} value
 */
export function reading(value) {
  if (value === null || Number.isNaN(value)) return "–";
  // 0 + takes the sign from a negative 0.
  return (0 + Math.round(value * 1000) / 1000).toFixed(Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2);
}
