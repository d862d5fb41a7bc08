/** The map: trajectories, final poses, or rates of cells on a floor that is moved by pointer or keys. */
import { placeIn } from "./brush.js";
import { DOTS, nearestTo } from "./chart.js";
import { count, drawn, element, filled, stepOf, tellRun, VERDICTS, within } from "./dom.js";
import { picture, ShownPart } from "./maps.js";
import { saveButtons } from "./save.js";

/** Signs of places, as paths from their middle. */
const MARKS = {
  cross: "m-5 -5l10 10m0 -10l-10 10",
  ring: "m-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0",
  diamond: "m0 -6l6 6l-6 6l-6 -6z",
};
const NEAR_PX = 8;
const STEP_PX = 40;
/** Sign of a button, its keys, its name, and what it does. */
const ZOOMS = [
  ["+", ["+", "="], "Zoom in", (map) => map.zoom(1.5)],
  ["−", ["−", "-"], "Zoom out", (map) => map.zoom(1 / 1.5)],
  ["⤢", ["0"], "Whole map", (map) => map.fit()],
];
const OBSTACLE = { fill: "var(--obstacle)", "fill-opacity": 0.4, stroke: "var(--obstacle-edge)", "stroke-width": 0.02 };
const DASHED = { "stroke-dasharray": "5 4" };
const PIXELS = { preserveAspectRatio: "none", "image-rendering": "pixelated" };
/** Viridis from yellow (little) to purple (much), as in the report. */
const RAMP = ["#fde725", "#5ec962", "#21918c", "#3b528b", "#440154"];
const SELDOM = [150, 150, 150, 70];

export class MapView extends ShownPart {
  /** Places with signs of `MARKS`, and corners of obstacles, in meters. */
  marks = [];
  outlines = [];
  /** Least and greatest x and y that are shown at first; null for the whole map. */
  extent = null;

  /** @param {HTMLElement} place @param {string} name Of files that are saved. */
  constructor(place, name) {
    const drawing = /** @type {SVGSVGElement} */ (drawn("svg", { tabindex: 0, class: "map", role: "application" }));
    super(drawing, () => this.draw(), {
      hovered: (event) => this.#tell(event),
      zooms: (event) => event.ctrlKey || document.activeElement === drawing, // else the page is scrolled
    });
    this.told = element("p", { class: "muted", "aria-live": "polite" });
    this.legend = element("p", { class: "row muted" });
    const zoom = ZOOMS.map(([sign, , title, act]) =>
      element("button", { title, "aria-label": title, click: () => act(this) }, sign),
    );
    const saved = saveButtons(name, () => this.floor && drawing);
    place.replaceChildren(drawing, element("div", { class: "row" }, ...zoom, ...saved), this.legend, this.told);
    drawing.addEventListener("click", (event) => this.#tell(event)); // where no pointer hovers
    drawing.addEventListener("keydown", (event) => this.#key(event));
    new ResizeObserver(() => this.draw()).observe(drawing);
  }

  #key(event) {
    const step = stepOf(event);
    const zoom = !event.ctrlKey && !event.metaKey && ZOOMS.find(([, keys]) => keys.includes(event.key));
    if (!step && !zoom) return;
    event.preventDefault();
    if (step) this.pan(...step.map((each) => -each * STEP_PX));
    else zoom[3](this);
  }

  fit() {
    this.extent = null;
    super.fit();
  }

  /** Show a reply of /api/paths over the picture of its floor. @param {{header: any, arrays: any}} content */
  show(content) {
    const { header } = content;
    if (header.floor?.picture !== this.floor?.picture) this.fitted = true;
    this.content = content;
    this.floor = header.floor;
    this.legend.replaceChildren();
    const words = "arrows move it, plus and minus zoom, 0 shows all";
    this.element.setAttribute("aria-label", `Map with ${header.runs ?? 0} runs; ${words}`);
    this.element.replaceChildren(...(this.floor ? this.#parts() : []));
    this.draw();
  }

  /** Floor, runs or cells, and marks, in meters with y downwards. */
  #parts() {
    const { floor, form } = this.content.header;
    const [x, y] = floor.origin;
    const turned = `translate(${x} ${-y}) rotate(${(-180 * floor.yaw) / Math.PI})`;
    const box = { x: floor.x - x, y: y - floor.y - floor.height, width: floor.width, height: floor.height };
    const ground = drawn("image", { href: floor.picture, transform: turned, ...PIXELS, ...box });
    const outlines = this.outlines.map((corners) => {
      const points = corners.map(([px, py]) => `${px},${-py}`).join(" ");
      return drawn("polygon", { points, ...OBSTACLE });
    });
    const marks = this.marks.map(({ shape, x: at, y: up }) => {
      const mark = drawn("path", { d: `M0 0${MARKS[shape]}`, "stroke-width": 2 });
      mark.style.transform = `translate(${at}px, ${-up}px) scale(var(--px))`;
      return mark;
    });
    const runs = form === "grid" ? [this.#cells()] : form === "runs" ? this.#runs() : [];
    return [ground, ...runs, ...outlines, ...marks];
  }

  /** A path for the runs of each verdict. */
  #runs() {
    const { header, arrays } = this.content;
    const { xy, starts, verdict: verdicts } = arrays;
    const ends = header.layer === "ends";
    const place = (k) => `${xy[2 * k].toFixed(3)} ${(-xy[2 * k + 1]).toFixed(3)}`;
    const lines = ["", "", ""];
    verdicts.forEach((verdict, run) => {
      const [first, last] = ends ? [run, run + 1] : [starts[run], starts[run + 1]];
      const places = Array.from({ length: last - first }, (_, k) => place(first + k));
      lines[verdict] += `M${places.join("L")}${ends ? "h0" : ""}`;
    });
    // Failed runs cover others, as blended colors of passed and failed ones are those of runs that were not judged; these are dashed.
    const faint = within(4 / Math.sqrt(header.runs), 0.15, 0.9);
    const look = (k) => (ends ? DOTS : { "stroke-width": 1.5, opacity: k === 1 ? 0.9 : faint, ...(k === 2 && DASHED) });
    return [2, 0, 1].map((k) => drawn("path", { d: lines[k], class: VERDICTS[k].color, ...look(k) }));
  }

  /** A picture of the cells; their legend is written. */
  #cells() {
    const { header, arrays } = this.content;
    const { runs, failed } = arrays;
    const { rows, columns, cell, origin } = header.grid;
    const isRate = header.layer === "rate";
    const values = header.layer === "ends" && failed.some((n) => n > 0) ? failed : runs;
    const most = isRate ? 1 : values.reduce((a, b) => Math.max(a, b), 1);
    const colors = new Uint8ClampedArray(4 * rows * columns);
    runs.forEach((n, k) => {
      if (!(isRate ? n : values[k])) return;
      const pixel = 4 * ((rows - 1 - Math.floor(k / columns)) * columns + (k % columns));
      const share = isRate ? failed[k] / n : Math.log1p(values[k]) / Math.log1p(most);
      const seldom = isRate && n < header.minimum;
      colors.set(seldom ? SELDOM : [...rampColor(share), isRate && !failed[k] ? 60 : 200], pixel);
    });
    const words = isRate
      ? `share of the runs that came here and failed here; gray: fewer than ${header.minimum} visits; faint: no failure`
      : values === failed
        ? "failed runs that ended here"
        : `runs that ${header.layer === "ends" ? "ended" : "came"} here`;
    const ramp = element("span");
    ramp.style.cssText = `width: 120px; height: 8px; background: linear-gradient(90deg, ${RAMP})`;
    this.legend.replaceChildren(isRate ? "0 %" : "1", ramp, isRate ? "100 %" : count(most), element("span", {}, words));
    const box = { x: origin[0], y: -origin[1] - cell * rows, width: cell * columns, height: cell * rows };
    return drawn("image", { href: picture(rows, columns, colors).toDataURL(), ...PIXELS, ...box });
  }

  draw() {
    const { element: drawing, floor } = this;
    if (!floor || !drawing.clientWidth) return;
    const ends = this.extent ?? floor.extent;
    drawing.style.aspectRatio = String((ends[1] - ends[0]) / (ends[3] - ends[2]));
    this.take(ends);
    const { center, scale } = this;
    const [width, height] = [drawing.clientWidth / scale, drawing.clientHeight / scale];
    filled(drawing, { viewBox: `${center.x - width / 2} ${-center.y - height / 2} ${width} ${height}` });
    drawing.style.setProperty("--px", String(1 / scale));
  }

  /** Tell what is under the pointer. */
  #tell(event) {
    if (!this.floor) return;
    const { header, arrays } = this.content;
    const [x, down] = placeIn(this.element, event);
    const y = -down;
    if (header.form === "grid") {
      const { origin, cell, rows, columns } = header.grid;
      const [column, row] = [Math.floor((x - origin[0]) / cell), Math.floor((y - origin[1]) / cell)];
      const inside = column >= 0 && column < columns && row >= 0 && row < rows;
      const [failed, runs] = inside ? [arrays.failed, arrays.runs].map((each) => each[row * columns + column]) : [0, 0];
      const share = `${count(failed)} of ${count(runs)} runs failed (${((100 * failed) / runs).toFixed(1)} %)`;
      this.told.textContent = runs ? `x ${x.toFixed(2)} m, y ${y.toFixed(2)} m: ${share}` : "";
    }
    if (header.form !== "runs") return;
    const placeOf = (k) => [arrays.xy[2 * k], arrays.xy[2 * k + 1]];
    const at = nearestTo([x, y], arrays.xy.length / 2, placeOf, NEAR_PX / this.scale);
    if (at < 0) return;
    const run = header.layer === "ends" ? at : arrays.starts.findLastIndex((start) => start <= at);
    tellRun(this.told, header.configurations[arrays.configuration[run]], arrays.run[run], arrays.verdict[run]);
  }
}

/** @returns {number[]} Color of a share from 0 to 1. */
function rampColor(share) {
  const at = within(share, 0, 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(at), RAMP.length - 2);
  const [from, to] = [RAMP[k], RAMP[k + 1]].map((color) => color.match(/\w\w/g).map((part) => parseInt(part, 16)));
  return from.map((part, c) => Math.round(part + (to[c] - part) * (at - k)));
}
