/** The map of one run: a canvas with pan and zoom. */

import { drawMoment } from "./player_drawing.js";
import { gridImage } from "./player_images.js";

const MARGIN_PX = 12;
const PX_PER_M = [2, 600];
const BAR_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];

export class MapView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./player_run.js").Run} run
   * @param {() => void} moved Called when the view was moved or zoomed.
   */
  constructor(canvas, run, moved) {
    this.canvas = canvas;
    this.run = run;
    this.moved = moved;
    /** @type {import("./player_run.js").Layers | null} */
    this.layers = null;
    this.follow = false;
    this.fitted = true;
    this.center = { x: 0, y: 0 };
    this.scale = 50;
    this.pointers = new Map();
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => this.#pointer(event));
    }
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.fit());
  }

  /** Take the colors. */
  paint(theme) {
    this.theme = theme;
    this.costs = {};
    this.grids = this.run.header.grids.map((grid) => {
      const [rows, columns] = this.run.header.arrays[grid.cells].shape;
      const image = gridImage(grid.kind, { cells: this.run.arrays[grid.cells], rows, columns }, theme);
      return { ...grid, rows, columns, image };
    });
  }

  /** Take the size of the canvas on the page. */
  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    if (this.fitted) this.#fitWhole();
  }

  /** Show the whole map. */
  fit() {
    this.follow = false;
    this.fitted = true;
    this.#fitWhole();
    this.moved();
  }

  #fitWhole() {
    const { x_m, y_m, yaw_rad, rows, columns, resolution_m } = this.grids[0];
    const [width, height, c, s] = [columns * resolution_m, rows * resolution_m, Math.cos(yaw_rad), Math.sin(yaw_rad)];
    this.center = { x: x_m + (c * width - s * height) / 2, y: y_m + (s * width + c * height) / 2 };
    const [across, up] = [Math.abs(c) * width + Math.abs(s) * height, Math.abs(s) * width + Math.abs(c) * height];
    const { clientWidth, clientHeight } = this.canvas;
    this.scale = Math.max(
      Math.min((clientWidth - 2 * MARGIN_PX) / across, (clientHeight - 2 * MARGIN_PX) / up),
      PX_PER_M[0],
    );
  }

  /** Zoom about a point of the canvas, by default its middle. */
  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    const scale = Math.min(Math.max(this.scale * factor, PX_PER_M[0]), PX_PER_M[1]);
    const apart = 1 / this.scale - 1 / scale;
    this.center.x += (px - this.canvas.clientWidth / 2) * apart;
    this.center.y -= (py - this.canvas.clientHeight / 2) * apart;
    this.scale = scale;
    this.fitted = false;
    this.moved();
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 33 : 1;
    this.zoom(Math.exp(-0.0015 * lines * event.deltaY), event.offsetX, event.offsetY);
  }

  /** One pointer moves the map, two zoom it. */
  #pointer(event) {
    const before = this.pointers.get(event.pointerId);
    const now = /** @type {[number, number]} */ ([event.offsetX, event.offsetY]);
    if (event.type === "pointerdown") this.canvas.setPointerCapture(event.pointerId);
    else if (event.type !== "pointermove") this.pointers.delete(event.pointerId);
    if (event.type === "pointerdown" || (event.type === "pointermove" && before))
      this.pointers.set(event.pointerId, now);
    if (event.type !== "pointermove" || !before) return;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
      this.zoom(apart(now) / apart(before), other[0], other[1]);
      return;
    }
    this.center.x -= (now[0] - before[0]) / this.scale;
    this.center.y += (now[1] - before[1]) / this.scale;
    this.follow = this.fitted = false;
    this.moved();
  }

  /** Draw a moment with the layers whose names are in `shown`. */
  draw(t, shown) {
    const time = Math.min(t, this.run.end);
    if (this.follow) this.center = this.run.pose(time);
    const { canvas, theme } = this;
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const ratio = canvas.width / Math.max(canvas.clientWidth, 1);
    const scale = this.scale * ratio;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = theme.unknown;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const [left, top] = [canvas.width / 2 - scale * this.center.x, canvas.height / 2 + scale * this.center.y];
    context.setTransform(scale, 0, 0, -scale, left, top);
    drawMoment(context, this, time, shown, 1 / this.scale);
    const length = BAR_M.findLast((each) => each * this.scale < 90) || BAR_M[0];
    context.setTransform(ratio, 0, 0, ratio, 10, canvas.height - 10 * ratio);
    context.fillStyle = theme.ink;
    context.fillRect(0, -2, length * this.scale, 2);
    context.font = "11px system-ui, sans-serif";
    context.fillText(`${length} m`, 0, -6);
  }
}
