/** The map: trajectories, final poses, or rates of cells on a floor that is moved by pointer or keys. */
import { coloredCells } from "./cells.js";
import { nearestTo } from "./chart.js";
import { readTheme, VERDICTS } from "./colors.js";
import { drawn, element, link } from "./dom.js";
import { MapCanvas } from "./map_canvas.js";
import { saveButtons } from "./save.js";
import { count, percent } from "./selection.js";

/** Signs of places, as paths from their middle. */
const MARKS = {
  cross: "m-5 -5l10 10m0 -10l-10 10",
  ring: "m-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0",
  diamond: "m0 -6l6 6l-6 6l-6 -6z",
};
const NEAR_PX = 8;
const STEP_PX = 40;

export class MapView extends MapCanvas {
  content = null;
  /** Places with signs of `MARKS`, and corners of obstacles, in meters. */
  marks = [];
  outlines = [];
  /** Least and greatest x and y that are shown at first; null for the whole map. */
  extent = null;

  /**
   * @param {HTMLElement} place
   * @param {string} name Of files that are saved.
   * @param {(configuration: string, run: number) => string} runAddress
   */
  constructor(place, name, runAddress) {
    const canvas = /** @type {HTMLCanvasElement} */ (element("canvas", { tabindex: 0, class: "map" }));
    super(canvas, () => this.draw(), {
      hovered: (event) => this.tell(event),
      zooms: (event) => event.ctrlKey || document.activeElement === canvas, // else the page is scrolled
    });
    this.runAddress = runAddress;
    this.told = element("p", { class: "muted", "aria-live": "polite" });
    this.legend = element("p", { class: "legend" });
    const zoom = [
      ["+", "Zoom in", () => this.zoom(1.5)],
      ["−", "Zoom out", () => this.zoom(1 / 1.5)],
      ["⤢", "Whole map", () => this.fit()],
    ].map(([sign, title, click]) => element("button", { title, "aria-label": title, click }, sign));
    const saved = saveButtons(name, () => this.svg());
    place.append(canvas, element("div", { class: "tools" }, ...zoom, ...saved), this.legend, this.told);
    canvas.addEventListener("click", (event) => this.tell(event));
    canvas.addEventListener("keydown", (event) => this.#key(event));
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  #key(event) {
    const done = {
      "+": () => this.zoom(1.5),
      "=": () => this.zoom(1.5),
      "-": () => this.zoom(1 / 1.5),
      0: () => this.fit(),
      ArrowLeft: () => this.pan(STEP_PX, 0),
      ArrowRight: () => this.pan(-STEP_PX, 0),
      ArrowUp: () => this.pan(0, STEP_PX),
      ArrowDown: () => this.pan(0, -STEP_PX),
    }[event.key];
    if (!done || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    done();
  }

  /**
   * Show a reply of /api/paths over the picture of its floor.
   * @param {{header: any, arrays: any}} content
   * @param {string} pictureAddress
   */
  async show(content, pictureAddress) {
    const { header } = content;
    this.content = null;
    if (header.floor && this.pictureAddress !== pictureAddress) {
      this.pictureAddress = pictureAddress;
      this.picture = new Image();
      this.picture.src = pictureAddress;
      this.fitted = true;
      await this.picture.decode().catch(() => {});
    }
    if (header.floor) this.content = content;
    this.cells = header.form === "grid" ? coloredCells(content, this.legend) : null;
    if (!this.cells) this.legend.replaceChildren();
    const words = "arrows move it, plus and minus zoom, 0 shows all";
    this.canvas.setAttribute("aria-label", `Map with ${header.runs ?? 0} runs; ${words}`);
    this.draw();
  }

  /** Show the whole map. */
  fit() {
    this.extent = null;
    super.fit();
  }

  draw() {
    const width = this.canvas.clientWidth;
    const ends = this.content ? (this.extent ?? this.content.header.floor.extent) : [0, 1, 0, 0];
    const high = (width * (ends[3] - ends[2])) / (ends[1] - ends[0]);
    this.canvas.style.height = `${Math.round(Math.min(Math.max(high, 120), 520))}px`;
    if (!this.content || !width) return;
    this.resize(ends);
    const context = this.canvas.getContext("2d");
    context.scale(devicePixelRatio, devicePixelRatio);
    this.paint(context);
  }

  /** Scale, and where the origin of the map is on the canvas (pixels). */
  get view() {
    const { scale, center, canvas } = this;
    return { scale, x: canvas.clientWidth / 2 - scale * center.x, y: canvas.clientHeight / 2 + scale * center.y };
  }

  /** Paint floor, runs or cells, and marks, in canvas pixels. */
  paint(context) {
    const { header } = this.content;
    const { scale, x, y } = this.view;
    const { floor, grid } = header;
    const theme = readTheme();
    context.save();
    context.translate(x + scale * floor.origin[0], y - scale * floor.origin[1]);
    context.rotate(-floor.yaw);
    context.imageSmoothingEnabled = false;
    const [left, top] = [scale * (floor.x - floor.origin[0]), -scale * (floor.y - floor.origin[1] + floor.height)];
    if (this.picture.naturalWidth)
      context.drawImage(this.picture, left, top, scale * floor.width, scale * floor.height);
    context.restore();
    context.imageSmoothingEnabled = false;
    if (this.cells) {
      const [wide, high] = [scale * grid.cell * grid.columns, scale * grid.cell * grid.rows];
      context.drawImage(this.cells, x + scale * grid.origin[0], y - scale * grid.origin[1] - high, wide, high);
    } else if (header.form === "runs") {
      for (const [k, path] of this.lines().entries()) {
        context.strokeStyle = theme[VERDICTS[k].color];
        const ends = header.layer === "ends";
        context.globalAlpha = ends ? 0.75 : Math.min(Math.max(4 / Math.sqrt(header.runs), 0.15), 0.9);
        context.lineWidth = ends ? 5 : 1.5;
        context.lineCap = "round";
        context.stroke(new Path2D(path));
      }
      context.globalAlpha = 1;
    }
    for (const points of this.outlines) {
      const corners = points.map(([px, py]) => `${x + scale * px} ${y - scale * py}`);
      const shape = new Path2D(`M${corners.join("L")}Z`);
      context.fillStyle = context.strokeStyle = theme.obstacle;
      context.globalAlpha = 0.35;
      context.fill(shape);
      context.globalAlpha = 1;
      context.stroke(shape);
    }
    for (const mark of this.marks) {
      context.strokeStyle = theme.ink;
      context.lineWidth = 2;
      context.stroke(new Path2D(`M${x + scale * mark.x} ${y - scale * mark.y}${MARKS[mark.shape]}`));
    }
  }

  /** @returns {string[]} Paths of the runs of each verdict in canvas pixels. */
  lines() {
    const { header, arrays } = this.content;
    const { xy, starts, verdict } = arrays;
    const { scale, x, y } = this.view;
    const parts = [[], [], []];
    const place = (k) => `${(x + scale * xy[2 * k]).toFixed(1)} ${(y - scale * xy[2 * k + 1]).toFixed(1)}`;
    for (let run = 0; run < verdict.length; run++) {
      if (header.layer === "ends") {
        parts[verdict[run]].push(`M${place(run)}h0`);
        continue;
      }
      const text = [];
      for (let k = starts[run]; k < starts[run + 1]; k++) text.push(place(k));
      parts[verdict[run]].push(`M${text.join("L")}`);
    }
    return parts.map((part) => part.join(""));
  }

  /** Tell what is under the pointer. */
  tell(event) {
    if (!this.content) return;
    const { header, arrays } = this.content;
    const { scale, x, y } = this.view;
    const world = [(event.offsetX - x) / scale, (y - event.offsetY) / scale];
    if (this.cells) {
      const { origin, cell, rows, columns } = header.grid;
      const [column, row] = [Math.floor((world[0] - origin[0]) / cell), Math.floor((world[1] - origin[1]) / cell)];
      const inside = column >= 0 && column < columns && row >= 0 && row < rows;
      const k = row * columns + column;
      if (!inside || !arrays.runs[k]) return this.told.replaceChildren();
      const [failed, runs] = [arrays.failed[k], arrays.runs[k]];
      const place = `x ${world[0].toFixed(2)} m, y ${world[1].toFixed(2)} m`;
      this.told.textContent = `${place}: ${count(failed)} of ${count(runs)} runs failed (${percent(failed / runs)})`;
      return;
    }
    if (header.form !== "runs") return;
    const points = arrays.xy;
    const placeOf = (k) => [points[2 * k], points[2 * k + 1]];
    const at = nearestTo(world, points.length / 2, placeOf, NEAR_PX / scale);
    if (at < 0) return;
    const run = header.layer === "ends" ? at : arrays.starts.findLastIndex((start) => start <= at);
    const name = header.configurations[arrays.configuration[run]];
    const index = arrays.run[run];
    const opened = link(this.runAddress(name, index), `${name}, run ${index}`);
    this.told.replaceChildren(opened, `: ${VERDICTS[arrays.verdict[run]].word}`);
  }

  /** @returns {SVGElement | null} The map as it is shown. */
  svg() {
    if (!this.content) return null;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const back = document.createElement("canvas");
    [back.width, back.height] = [2 * width, 2 * height];
    const context = back.getContext("2d");
    context.scale(2, 2);
    const { header } = this.content;
    const { form } = header;
    if (form === "runs") header.form = ""; // lines stay lines
    this.paint(context);
    header.form = form;
    const picture = drawn("image", { href: back.toDataURL(), width, height });
    const lines = form === "runs" ? this.lines() : [];
    const theme = readTheme();
    const kept = { fill: "none", "stroke-opacity": 0.6, "stroke-linecap": "round" };
    const wide = header.layer === "ends" ? 5 : 1.2;
    const shown = lines.map((d, k) => {
      return drawn("path", { d, stroke: theme[VERDICTS[k].color], "stroke-width": wide, ...kept });
    });
    return drawn("svg", { viewBox: `0 0 ${width} ${height}`, width, height }, picture, ...shown);
  }
}
