/** The time line and the signals of one or two runs, over one time axis. */

import { element } from "./dom.js";
import { BANDS, MARKS, reading } from "./player_theme.js";

const [LEFT, RIGHT, BAND, TICKS, AXIS, PLOT] = [52, 12, 16, 24, 18, 64];
const SNAP_PX = 6;
const STEPS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400];
const DASHES = [[], [4, 3], [1, 3]];
const ENDS = { SUCCESS: "pass", FAILURE: "fail" };
const FONT = "11px system-ui, sans-serif";

export class Tracks {
  /**
   * @param {HTMLElement} place
   * @param {Array<{run: import("./player_run.js").Run, activities: Array<[number, number, string]>}>} sides
   * @param {number} end Time of the end of the longer run.
   * @param {(t: number) => void} seek
   */
  constructor(place, sides, end, seek) {
    this.sides = sides;
    this.seek = seek;
    this.end = Math.max(end, 0.1);
    this.cursor = element("div", { class: "cursor" });
    const limits = { "aria-valuemin": 0, "aria-valuemax": end.toFixed(2) };
    this.line = track({ tabindex: 0, role: "slider", "aria-label": "Time", ...limits });
    // Plots that any of the runs has.
    const plots = new Map();
    for (const { title, unit, lines } of sides.flatMap(({ run }) => run.header.signals || [])) {
      plots.set(title, { title, unit, lines: { ...plots.get(title)?.lines, ...lines } });
    }
    this.plots = [...plots.values()].map((plot) => ({
      ...plot,
      values: element("span", { class: "muted" }),
      canvas: track({ role: "img", "aria-label": `${plot.title} over time` }),
    }));
    place.replaceChildren(this.line, this.cursor);
    for (const { title, values, canvas } of this.plots) {
      place.append(element("div", { class: "caption" }, element("span", {}, title), values), canvas);
    }
    for (const canvas of place.querySelectorAll("canvas")) {
      canvas.addEventListener("pointerdown", (event) => this.#point(event, true));
      canvas.addEventListener("pointermove", (event) => this.#point(event, false));
    }
  }

  /** Position of a time (px). */
  #x(t) {
    return LEFT + (t / this.end) * (this.line.clientWidth - LEFT - RIGHT);
  }

  #point(event, pressed) {
    const canvas = event.currentTarget;
    const apart = ({ t_s }) => Math.abs(this.#x(t_s) - event.offsetX);
    const close = this.sides.flatMap(({ run }) => run.events).filter((each) => apart(each) <= SNAP_PX);
    const near = canvas === this.line ? close.sort((a, b) => apart(a) - apart(b))[0] : undefined;
    const t = ((event.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT)) * this.end;
    if (pressed) canvas.setPointerCapture(event.pointerId);
    if (pressed || event.buttons & 1) this.seek(pressed && near ? near.t_s : t);
    canvas.title = near ? `${near.t_s.toFixed(2)} s: ${near.text}` : "";
  }

  /** Show a time: the cursor, and the signals' values. */
  moveTo(t) {
    this.cursor.style.transform = `translateX(${this.#x(t)}px)`;
    this.line.setAttribute("aria-valuenow", t.toFixed(2));
    for (const { lines, unit, values } of this.plots) {
      const said = this.sides.map(({ run }) => {
        const there = Object.entries(lines).filter(([column]) => run.columns[column]);
        return there.map(([name, label]) => `${label} ${reading(t > run.end ? NaN : run.value(name, t))}`).join(" · ");
      });
      values.textContent = `${said.join(" | ")} ${unit}`;
    }
  }

  /** Draw all but the cursor. */
  paint(theme) {
    const lanes = this.sides.map(({ run }) => lanesOf(run.header.behaviors || []));
    const heights = lanes.map((each) => TICKS + BAND * (1 + each.length) + 4);
    const context = sized(
      this.line,
      heights.reduce((sum, each) => sum + each, AXIS),
    );
    let top = 0;
    this.sides.forEach((side, k) => {
      this.#side(context, top, side, lanes[k], this.sides.length > 1 ? ` ${"AB"[k]}` : "", theme);
      top += heights[k];
    });
    context.fillStyle = theme.muted;
    const step = STEPS_S.find((each) => this.#x(each) - LEFT > 48) || this.end;
    for (let k = 0; k * step <= this.end + 1e-9; k += 1) {
      const text = `${+(k * step).toFixed(1)}${k ? "" : " s"}`;
      context.fillRect(this.#x(k * step), top, 1, 4);
      const last = this.line.clientWidth - context.measureText(text).width;
      context.fillText(text, Math.min(this.#x(k * step) + 2, last), top + 11);
    }
    for (const plot of this.plots) this.#plot(plot, theme);
  }

  #side(context, top, { run, activities }, lanes, name, theme) {
    const bars = activities.map(([start, end, kind]) => [0, start, end, kind, ...(BANDS[kind] || ["muted", 0.22])]);
    lanes.forEach((spans, lane) =>
      spans.forEach(({ name, start_s, end_s, status }) =>
        bars.push([lane + 1, start_s, end_s, name, ENDS[status] || "muted", 0.18]),
      ),
    );
    for (const [row, start, end, text, color, alpha] of bars) {
      const [x, width, y] = [this.#x(start), this.#x(end) - this.#x(start), top + TICKS + row * BAND];
      context.globalAlpha = alpha;
      context.fillStyle = theme[color];
      context.fillRect(x, y, Math.max(width - 0.5, 1), BAND - 2);
      context.globalAlpha = 1;
      context.fillStyle = alpha > 0.6 ? theme.panel : theme.ink;
      if (context.measureText(text).width + 8 < width) context.fillText(text, x + 4, y + BAND / 2 - 1);
    }
    context.fillStyle = theme.muted;
    if (activities.length) context.fillText(`robot${name}`, 2, top + TICKS + BAND / 2 - 1);
    if (lanes.length) context.fillText("scenario", 2, top + TICKS + 1.5 * BAND - 1);
    context.textAlign = "center";
    for (const { mark, t_s } of run.events) {
      const [letter, color] = MARKS[mark];
      context.fillStyle = theme[color];
      // A recovery follows an error at once, and a contact an obstacle that appears.
      context.fillText(letter, this.#x(t_s), top + (mark === "recovery" || mark === "contact" ? 17 : 7));
    }
    context.textAlign = "left";
  }

  #plot({ canvas, lines }, theme) {
    const context = sized(canvas, PLOT);
    const all = this.sides.flatMap(({ run }) => Object.keys(lines).map((column) => run.columns[column] || []));
    let [low, high] = [0, 0];
    for (const values of all) for (const v of values) [low, high] = [v < low ? v : low, v > high ? v : high];
    if (high === low) high = low + 1;
    const y = (value) => 7 + ((high - value) / (high - low)) * (PLOT - 14);
    context.fillStyle = theme.line;
    context.fillRect(LEFT, y(0), this.#x(this.end) - LEFT, 1);
    context.fillStyle = theme.muted;
    context.textAlign = "right";
    for (const value of new Set([low, 0, high])) context.fillText(reading(value), LEFT - 5, y(value));
    this.sides.forEach(({ run }, side) =>
      Object.keys(lines).forEach((column, n) => {
        context.setLineDash(DASHES[n]);
        context.strokeStyle = side ? theme.second : n ? theme.muted : theme.accent;
        context.lineWidth = n ? 1.1 : 1.4;
        context.beginPath();
        let open = false;
        run.columns[column]?.forEach((value, k) => {
          const measured = !Number.isNaN(value);
          if (measured && open) context.lineTo(this.#x(run.t[k]), y(value));
          else if (measured) context.moveTo(this.#x(run.t[k]), y(value));
          open = measured;
        });
        context.stroke();
      }),
    );
  }
}

function track(attributes) {
  return /** @type {HTMLCanvasElement} */ (element("canvas", { class: "track", ...attributes }));
}

/** Spans that overlap are put into rows below each other. */
function lanesOf(spans) {
  const lanes = [];
  for (const span of spans.toSorted((a, b) => a.start_s - b.start_s)) {
    const free = lanes.find((lane) => lane[lane.length - 1].end_s <= span.start_s + 1e-9);
    if (free) free.push(span);
    else lanes.push([span]);
  }
  return lanes;
}

function sized(canvas, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.style.height = `${height}px`;
  [canvas.width, canvas.height] = [Math.round(canvas.clientWidth * ratio), Math.round(height * ratio)];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.font = FONT;
  context.textBaseline = "middle";
  return context;
}
