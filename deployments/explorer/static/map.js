/** The map: trajectories, final poses, or rates of cells on a floor that is moved by pointer or keys. */
import { coloredCells } from "./cells.js";
import { nearestTo } from "./chart.js";
import { drawn, element } from "./dom.js";
import { onDrag } from "./drag.js";
import { saveButtons } from "./save.js";
import { count, percent, VERDICTS } from "./selection.js";

/** Signs of places, as paths from their middle. */
const MARKS = {
  cross: "m-5 -5l10 10m0 -10l-10 10",
  ring: "m-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0",
  diamond: "m0 -6l6 6l-6 6l-6 -6z",
};
const NEAR_PX = 8;
const STEP_PX = 40;

export class MapView {
  /**
   * @param {HTMLElement} place
   * @param {string} name Of files that are saved.
   * @param {(configuration: string, run: number) => string} runAddress
   */
  constructor(place, name, runAddress) {
    this.runAddress = runAddress;
    this.canvas = /** @type {HTMLCanvasElement} */ (element("canvas", { tabindex: 0, class: "map" }));
    this.told = element("p", { class: "muted", "aria-live": "polite" });
    this.legend = element("p", { class: "legend" });
    const zoom = [
      ["+", "Zoom in", () => this.zoom(1.5)],
      ["−", "Zoom out", () => this.zoom(1 / 1.5)],
      ["⤢", "Whole map", () => this.fit()],
    ].map(([sign, title, done]) => element("button", { title, "aria-label": title, click: done }, sign));
    const saved = saveButtons(name, () => this.svg());
    place.append(this.canvas, element("div", { class: "tools" }, ...zoom, ...saved), this.legend, this.told);
    this.content = null;
    this.view = null;
    /** Places with signs of `MARKS`, and corners of obstacles, in meters. */
    [this.marks, this.outlines] = [[], []];
    /** Least and greatest x and y that are shown at first; null for the whole map. */
    this.extent = null;
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  listen() {
    let last = null;
    const pan = (from, to) => {
      const before = last ?? from;
      this.pan(to[0] - before[0], to[1] - before[1]);
      last = to;
    };
    const placeOf = (event) => [event.clientX, event.clientY];
    onDrag(
      this.canvas,
      placeOf,
      pan,
      () => (last = null),
      (event) => this.tell(event),
    );
    this.canvas.addEventListener("click", (event) => this.tell(event));
    this.canvas.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && document.activeElement !== this.canvas) return; // the page is scrolled
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
    const keys = {
      "+": () => this.zoom(1.5),
      "=": () => this.zoom(1.5),
      "-": () => this.zoom(1 / 1.5),
      0: () => this.fit(),
      ArrowLeft: () => this.pan(STEP_PX, 0),
      ArrowRight: () => this.pan(-STEP_PX, 0),
      ArrowUp: () => this.pan(0, STEP_PX),
      ArrowDown: () => this.pan(0, -STEP_PX),
    };
    this.canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  /**
   * Show a reply of /api/paths over the picture of its floor.
   * @param {{header: any, arrays: any}} content
   * @param {string} pictureAddress
   */
  async show(content, pictureAddress) {
    const { header } = content;
    if (!header.floor) {
      this.content = null;
      this.draw();
      return;
    }
    if (this.pictureAddress !== pictureAddress) {
      this.pictureAddress = pictureAddress;
      this.picture = new Image();
      this.picture.src = pictureAddress;
      this.view = null;
      await this.picture.decode().catch(() => {});
    }
    this.content = content;
    this.cells = header.form === "grid" ? coloredCells(content, this.legend) : null;
    if (!this.cells) this.legend.replaceChildren();
    this.canvas.setAttribute(
      "aria-label",
      `Map with ${header.runs ?? 0} runs; arrows move it, plus and minus zoom, 0 shows all`,
    );
    this.draw();
  }

  /** Show the whole map. */
  fit() {
    this.view = this.extent = null;
    this.draw();
  }

  pan(dx, dy) {
    if (!this.view) return;
    this.view.x += dx;
    this.view.y += dy;
    this.draw();
  }

  zoom(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    if (!this.view) return;
    this.view.x = x + (this.view.x - x) * factor;
    this.view.y = y + (this.view.y - y) * factor;
    this.view.scale *= factor;
    this.draw();
  }

  draw() {
    const ratio = devicePixelRatio || 1;
    const width = this.canvas.clientWidth;
    const extent = this.content && (this.extent ?? this.content.header.floor.extent);
    const high = extent ? (width * (extent[3] - extent[2])) / (extent[1] - extent[0]) : 120;
    const height = Math.round(Math.min(Math.max(high, 120), 520));
    this.canvas.style.height = `${height}px`;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = this.canvas.getContext("2d");
    if (!this.content || !width) return;
    if (!this.view) {
      const scale = Math.min(width / (extent[1] - extent[0]), height / (extent[3] - extent[2]));
      const middle = [(extent[0] + extent[1]) / 2, (extent[2] + extent[3]) / 2];
      this.view = { scale, x: width / 2 - scale * middle[0], y: height / 2 + scale * middle[1] };
    }
    context.scale(ratio, ratio);
    this.paint(context);
  }

  /** Paint floor, runs or cells, and marks, in canvas pixels. */
  paint(context) {
    const { header } = this.content;
    const { scale, x, y } = this.view;
    const { floor, grid } = header;
    const colors = getComputedStyle(this.canvas);
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
        context.strokeStyle = colors.getPropertyValue(VERDICTS[k].color);
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
      context.fillStyle = context.strokeStyle = colors.getPropertyValue("--obstacle");
      context.globalAlpha = 0.35;
      context.fill(shape);
      context.globalAlpha = 1;
      context.stroke(shape);
    }
    for (const mark of this.marks) {
      context.strokeStyle = colors.getPropertyValue("--ink");
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
    if (!this.content || !this.view) return;
    const { header, arrays } = this.content;
    const world = [(event.offsetX - this.view.x) / this.view.scale, (this.view.y - event.offsetY) / this.view.scale];
    if (this.cells) {
      const { origin, cell, rows, columns } = header.grid;
      const [column, row] = [Math.floor((world[0] - origin[0]) / cell), Math.floor((world[1] - origin[1]) / cell)];
      const inside = column >= 0 && column < columns && row >= 0 && row < rows;
      const k = row * columns + column;
      if (!inside || !arrays.runs[k]) return this.told.replaceChildren();
      const share = percent(arrays.failed[k] / arrays.runs[k]);
      this.told.textContent = `x ${world[0].toFixed(2)} m, y ${world[1].toFixed(2)} m: ${count(arrays.failed[k])} of ${count(arrays.runs[k])} runs failed (${share})`;
      return;
    }
    if (header.form !== "runs") return;
    const points = arrays.xy;
    const at = nearestTo(
      world,
      points.length / 2,
      (k) => [points[2 * k], points[2 * k + 1]],
      NEAR_PX / this.view.scale,
    );
    if (at < 0) return;
    const run = header.layer === "ends" ? at : arrays.starts.findLastIndex((start) => start <= at);
    const name = header.configurations[arrays.configuration[run]];
    const index = arrays.run[run];
    const link = element("a", { href: this.runAddress(name, index) }, `${name}, run ${index}`);
    this.told.replaceChildren(link, `: ${VERDICTS[arrays.verdict[run]].word}`);
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
    const colors = getComputedStyle(this.canvas);
    const wide = header.layer === "ends" ? 5 : 1.2;
    const shown = lines.map((d, k) => {
      const stroke = colors.getPropertyValue(VERDICTS[k].color);
      return drawn("path", {
        d,
        stroke,
        fill: "none",
        "stroke-width": wide,
        "stroke-opacity": 0.6,
        "stroke-linecap": "round",
      });
    });
    return drawn("svg", { viewBox: `0 0 ${width} ${height}`, width, height }, picture, ...shown);
  }
}
