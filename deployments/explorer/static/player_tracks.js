/** The time line and the signals over the same time, which the server drew: cursors, values, and what robots did. */
import { drawn, element } from "./dom.js";

/** Pixels; the style sheet has the same edges. */
const [LEFT, RIGHT] = [52, 12];
const SNAP_PX = 6;
const LETTER_PX = 6.5;

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
  constructor(place, sides, end, seek) {
    Object.assign(this, { place, sides, seek, end: Math.max(end, 0.1) });
    this.line = place.querySelector("[role=slider]");
    this.legend = element("p", { class: "row muted", "aria-label": "Colors of what the robot did" });
    this.line.after(this.legend);
    for (const track of place.querySelectorAll(".tracks:not(.still) .track")) {
      track.addEventListener("pointerdown", (event) => this.#point(event, true));
      track.addEventListener("pointermove", (event) => this.#point(event, false));
    }
  }

  #point(event, pressed) {
    const track = event.currentTarget;
    const box = track.getBoundingClientRect();
    const width = box.width - LEFT - RIGHT;
    const x = event.clientX - box.left - LEFT;
    const apart = (t) => Math.abs((t / this.end) * width - x);
    const events = [...track.querySelectorAll("[data-t]")].map(({ dataset }) => Number(dataset.t));
    const near = events.filter((t) => apart(t) <= SNAP_PX).sort((a, b) => apart(a) - apart(b))[0];
    if (pressed) track.setPointerCapture(event.pointerId);
    if (!pressed && !(event.buttons & 1)) return;
    this.seek(pressed && near !== undefined ? near : (x / width) * this.end);
  }

  /** Show a time: the cursors, and the signals' values. */
  moveTo(t) {
    this.place.style.setProperty("--at", t / this.end);
    this.line.setAttribute("aria-valuenow", t.toFixed(2));
    for (const output of this.place.querySelectorAll("[data-column]")) {
      const { run } = this.sides[output.dataset.side];
      const value = t > run.end ? NaN : run.value(output.dataset.column, t);
      output.textContent = Number.isNaN(value) ? "–" : value.toFixed(2);
    }
  }

  /** Draw what the robots did, which an execution tells better. */
  paint() {
    const width = this.line.clientWidth - LEFT - RIGHT;
    this.line.querySelectorAll(".robot").forEach((row, k) => {
      const bars = this.sides[k].activities.map(([start, end, kind]) => {
        const [x, share] = [start, end - start].map((t) => t / this.end);
        const [color, alpha] = BANDS[kind] ?? ["muted", 0.22];
        const look = { width: "100%", height: "100%", fill: `var(--${color})`, "fill-opacity": alpha };
        const fits = kind.length * LETTER_PX + 8 < share * width;
        const ink = `var(--${alpha > 0.6 ? "panel" : "ink"})`;
        const name = drawn("text", { x: 4, y: 11, fill: ink }, fits ? kind : "");
        const place = { x: `${100 * x}%`, width: `${100 * share}%` };
        return drawn("svg", place, drawn("rect", look), name, drawn("title", {}, kind));
      });
      row.replaceChildren(...bars);
    });
    const kinds = new Set(this.sides.flatMap(({ activities }) => activities.map(([, , kind]) => kind)));
    this.legend.replaceChildren(
      ...[...kinds].map((kind) => {
        const [color, alpha] = BANDS[kind] ?? ["muted", 0.22];
        const swatch = element("span", { "aria-hidden": "true" }, "■");
        Object.assign(swatch.style, { color: `var(--${color})`, opacity: Math.max(alpha, 0.4) });
        return element("span", {}, swatch, ` ${kind}`);
      }),
    );
  }
}
