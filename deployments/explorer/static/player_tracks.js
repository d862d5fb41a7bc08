/** The time line and the signals of one or two runs, over one time axis. */
import { ticksOf } from "./chart.js";
import { drawn, element } from "./dom.js";
import { MARKS, reading } from "./player_panels.js";

/** Pixels; the style sheet has the same edges. */
const [LEFT, RIGHT, BAND, TICKS, AXIS, PLOT] = [52, 12, 16, 24, 18, 64];
const SNAP_PX = 6;
const [LETTER_PX, TICK_PX] = [6.5, 60];
const DASHES = ["", "4 3", "1 3"];
const ENDS = { SUCCESS: "pass", FAILURE: "fail" };

/** Activities to colors and opacities, as in the pictures of `vastflow replay`. */
const BANDS = {
  driving: ["pass", 0.28],
  standing: ["muted", 0.35],
  following: ["pass", 0.28],
  "no progress": ["belief", 0.5],
  "no command": ["ink", 0.7],
  stopped: ["fail", 0.95],
  spin: ["obstacle", 0.85],
  wait: ["muted", 0.6],
  "back up": ["belief", 0.85],
};

export class Tracks {
  /**
   * Draw runs with their activities, up to the end of the longer one, in an element.
   * @param {Array<{run: import("./player_run.js").Run, activities: Array<[number, number, string]>}>} sides
   */
  constructor(place, sides, end, seek) {
    Object.assign(this, { sides, seek, end: Math.max(end, 0.1) });
    this.cursor = element("div", { class: "cursor" });
    const limits = { "aria-valuemin": 0, "aria-valuemax": end.toFixed(2) };
    this.line = drawn("svg", { class: "track", tabindex: 0, role: "slider", "aria-label": "Time", ...limits });
    // Plots that any of the runs has.
    const plots = new Map();
    for (const { title, unit, lines } of sides.flatMap(({ run }) => run.header.signals || [])) {
      plots.set(title, { title, unit, lines: { ...plots.get(title)?.lines, ...lines } });
    }
    this.plots = [...plots.values()].map((plot) => ({ ...plot, values: element("span", { class: "muted" }) }));
    const drawings = this.plots.flatMap((plot) => [
      element("div", { class: "row" }, element("span", {}, plot.title), plot.values),
      this.#plot(plot),
    ]);
    place.replaceChildren(this.line, this.cursor, ...drawings);
    for (const track of place.querySelectorAll(".track")) {
      track.addEventListener("pointerdown", (event) => this.#point(event, true));
      track.addEventListener("pointermove", (event) => this.#point(event, false));
    }
    this.paint();
  }

  /** Position of a time within the axis. */
  #x = (t) => `${(100 * t) / this.end}%`;

  #point(event, pressed) {
    const track = event.currentTarget;
    const box = track.getBoundingClientRect();
    const width = box.width - LEFT - RIGHT;
    const x = event.clientX - box.left - LEFT;
    const apart = ({ t_s }) => Math.abs((t_s / this.end) * width - x);
    const events = track === this.line ? this.sides.flatMap(({ run }) => run.events) : [];
    const near = events.filter((each) => apart(each) <= SNAP_PX).sort((a, b) => apart(a) - apart(b))[0];
    if (pressed) track.setPointerCapture(event.pointerId);
    if (pressed || event.buttons & 1) this.seek(pressed && near ? near.t_s : (x / width) * this.end);
  }

  /** Show a time: the cursor, and the signals' values. */
  moveTo(t) {
    this.cursor.style.left = `calc(${LEFT}px + ${t / this.end} * (100% - ${LEFT + RIGHT}px))`;
    this.line.setAttribute("aria-valuenow", t.toFixed(2));
    for (const { lines, unit, values } of this.plots) {
      const said = this.sides.map(({ run }) => {
        const there = Object.entries(lines).filter(([column]) => run.columns[column]);
        return there.map(([name, label]) => `${label} ${reading(t > run.end ? NaN : run.value(name, t))}`).join(" · ");
      });
      values.textContent = `${said.join(" | ")} ${unit}`;
    }
  }

  /** Draw the time line, whose activities an execution changes. */
  paint() {
    const parts = [];
    let top = 0;
    this.sides.forEach(({ run, activities }, k) => {
      const lanes = lanesOf(run.header.behaviors || []);
      const name = this.sides.length > 1 ? ` ${"AB"[k]}` : "";
      const [first, second] = [top + TICKS + BAND / 2 + 3, top + TICKS + 1.5 * BAND + 3];
      if (activities.length) parts.push(drawn("text", { x: 2 - LEFT, y: first }, `robot${name}`));
      if (lanes.length) parts.push(drawn("text", { x: 2 - LEFT, y: second }, "scenario"));
      for (const [start, end, kind] of activities) {
        parts.push(this.#bar(top + TICKS, start, end, kind, ...(BANDS[kind] || ["muted", 0.22])));
      }
      lanes.forEach((spans, lane) => {
        const y = top + TICKS + (lane + 1) * BAND;
        for (const { name, start_s, end_s, status } of spans) {
          parts.push(this.#bar(y, start_s, end_s, name, ENDS[status] || "muted", 0.18));
        }
      });
      for (const { mark, t_s, text } of run.events) {
        const [letter, color] = MARKS[mark];
        // A recovery follows an error at once, and a contact an obstacle that appears.
        const y = top + (mark === "recovery" || mark === "contact" ? 21 : 11);
        const title = drawn("title", {}, `${t_s.toFixed(2)} s: ${text}`);
        parts.push(
          drawn("text", { x: this.#x(t_s), y, "text-anchor": "middle", fill: `var(--${color})` }, letter, title),
        );
      }
      top += TICKS + BAND * (1 + lanes.length) + 4;
    });
    for (const t of ticksOf(0, this.end, this.line.clientWidth / TICK_PX)) {
      const [x, text] = [this.#x(t), t ? String(t) : "0 s"];
      parts.push(drawn("rect", { x, y: top, width: 1, height: 4 }));
      parts.push(drawn("text", { x, y: top + 14, "text-anchor": "middle" }, text));
    }
    this.line.style.height = `${top + AXIS}px`;
    this.line.replaceChildren(...parts);
  }

  /** A span of time, with its name where that has room. */
  #bar(y, start, end, name, color, alpha) {
    const share = (end - start) / this.end;
    const fits = name.length * LETTER_PX + 8 < share * (this.line.clientWidth - LEFT - RIGHT);
    const box = { x: this.#x(start), y, width: `${100 * share}%`, height: BAND - 2 };
    const back = drawn("rect", { width: "100%", height: "100%", fill: `var(--${color})`, "fill-opacity": alpha });
    const text = drawn("text", { x: 4, y: BAND - 5, fill: alpha > 0.6 ? "var(--panel)" : "var(--ink)" }, name);
    return drawn("svg", box, back, ...(fits ? [text] : []), drawn("title", {}, name));
  }

  #plot({ title, lines }) {
    const columns = Object.keys(lines);
    const all = this.sides.flatMap(({ run }) => columns.map((column) => run.columns[column] || []));
    let [low, high] = [0, 0];
    for (const values of all) for (const v of values) [low, high] = [v < low ? v : low, v > high ? v : high];
    if (high === low) high = low + 1;
    const y = (value) => 7 + ((high - value) / (high - low)) * (PLOT - 14);
    const labels = [...new Set([low, 0, high])].map((value) =>
      drawn("text", { x: -5, y: y(value) + 4, "text-anchor": "end" }, reading(value)),
    );
    // In seconds and pixels, which the page stretches to its width.
    const paths = this.sides.flatMap(({ run }, side) =>
      columns.map((column, n) => {
        let [d, pen] = ["", "M"];
        run.columns[column]?.forEach((value, k) => {
          if (!Number.isNaN(value)) d += `${pen}${run.t[k]} ${y(value).toFixed(1)}`;
          pen = Number.isNaN(value) ? "M" : "L";
        });
        const color = side ? "horizon" : n ? "muted" : "accent";
        return drawn("path", {
          d,
          color: `var(--${color})`,
          "stroke-dasharray": DASHES[n],
          "stroke-width": n ? 1.1 : 1.4,
        });
      }),
    );
    const zero = drawn("path", { d: `M0 ${y(0)}h${this.end}`, color: "var(--line)" });
    const view = { viewBox: `0 0 ${this.end} ${PLOT}`, preserveAspectRatio: "none" };
    const attributes = { class: "track", role: "img", "aria-label": `${title} over time`, height: PLOT };
    return drawn("svg", attributes, ...labels, drawn("svg", view, zero, ...paths));
  }
}

/** Spans that overlap are put into rows below each other. */
function lanesOf(spans) {
  const lanes = [];
  for (const span of spans.toSorted((a, b) => a.start_s - b.start_s)) {
    const free = lanes.find((lane) => lane.at(-1).end_s <= span.start_s + 1e-9);
    if (free) free.push(span);
    else lanes.push([span]);
  }
  return lanes;
}
