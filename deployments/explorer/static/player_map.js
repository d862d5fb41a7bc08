/** The map of one run: a canvas with pan and zoom. */

import { drawMoment } from "./player_drawing.js";
import { gridImage } from "./player_images.js";

const MARGIN = 12;
const CLOSEST_PX_PER_M = 600;
const FARTHEST_PX_PER_M = 2;

export class MapView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./player_run.js").Run} run
   * @param {() => void} moved Called when the view was moved or zoomed.
   */
  constructor(canvas, run, moved) {
    this.canvas = canvas;
    this.run = run;
    this.layers = null;
    this.moved = moved;
    this.images = [];
    this.costs = {};
    this.follow = false;
    this.fitted = true;
    this.center = { x: 0, y: 0 };
    this.scale = 50;
    this.pointers = new Map();
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => this.#pointer(/** @type {PointerEvent} */ (event)));
    }
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.fit());
  }

  /** @param {Object<string, string>} theme */
  paint(theme) {
    this.theme = theme;
    this.costs = {};
    const { grids } = this.run.header;
    this.images = grids.map((grid) => {
      const [rows, columns] = this.run.header.arrays[grid.cells].shape;
      const image = gridImage(grid.kind, this.run.arrays[grid.cells], rows, columns, theme);
      return { ...grid, rows, columns, image };
    });
  }

  /** Take the size of the canvas on the page. */
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
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
    const map = this.images.find((grid) => grid.kind === "map");
    const corners = [
      [0, 0],
      [map.columns, 0],
      [0, map.rows],
      [map.columns, map.rows],
    ].map(([column, row]) => {
      const [dx, dy] = [column * map.resolution_m, row * map.resolution_m];
      const [c, s] = [Math.cos(map.yaw_rad), Math.sin(map.yaw_rad)];
      return [map.x_m + c * dx - s * dy, map.y_m + s * dx + c * dy];
    });
    const [xs, ys] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.center = { x: (x0 + x1) / 2, y: (y0 + y1) / 2 };
    const { clientWidth, clientHeight } = this.canvas;
    this.scale = Math.max(
      Math.min((clientWidth - 2 * MARGIN) / (x1 - x0), (clientHeight - 2 * MARGIN) / (y1 - y0)),
      FARTHEST_PX_PER_M,
    );
  }

  /**
   * Zoom about a point of the canvas, by default its middle.
   * @param {number} factor
   * @param {number} [px]
   * @param {number} [py]
   */
  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    const scale = Math.min(Math.max(this.scale * factor, FARTHEST_PX_PER_M), CLOSEST_PX_PER_M);
    if (!this.follow) {
      const [dx, dy] = [px - this.canvas.clientWidth / 2, py - this.canvas.clientHeight / 2];
      this.center.x += dx / this.scale - dx / scale;
      this.center.y -= dy / this.scale - dy / scale;
    }
    this.scale = scale;
    this.fitted = false;
    this.moved();
  }

  #pan(dx, dy) {
    this.center.x -= dx / this.scale;
    this.center.y += dy / this.scale;
    this.fitted = false;
    this.follow = false;
    this.moved();
  }

  #wheel(event) {
    event.preventDefault();
    const { left, top } = this.canvas.getBoundingClientRect();
    this.zoom(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)), event.clientX - left, event.clientY - top);
  }

  #pointer(event) {
    const { pointers } = this;
    if (event.type === "pointerdown") {
      this.canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      return;
    }
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (event.type !== "pointermove") {
      pointers.delete(event.pointerId);
      return;
    }
    const now = [event.clientX, event.clientY];
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    if (other) {
      const apart = (point) => Math.hypot(point[0] - other[1][0], point[1] - other[1][1]);
      const { left, top } = this.canvas.getBoundingClientRect();
      const middle = [(now[0] + other[1][0]) / 2 - left, (now[1] + other[1][1]) / 2 - top];
      this.zoom(apart(now) / Math.max(apart(before), 1), middle[0], middle[1]);
    } else {
      this.#pan(now[0] - before[0], now[1] - before[1]);
    }
    pointers.set(event.pointerId, now);
  }

  /**
   * Draw a moment.
   * @param {number} t
   * @param {Set<string>} shown Names of the layers to draw.
   */
  draw(t, shown) {
    const time = Math.min(t, this.run.end);
    if (this.follow) {
      const { x, y } = this.run.pose(time);
      this.center = { x, y };
    }
    const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    const ratio = this.canvas.width / Math.max(this.canvas.clientWidth, 1);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.theme.unknown;
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    const scale = this.scale * ratio;
    const [left, top] = [this.canvas.width / 2 - scale * this.center.x, this.canvas.height / 2 + scale * this.center.y];
    context.setTransform(scale, 0, 0, -scale, left, top);
    drawMoment(context, this, time, shown, 1 / this.scale);
    this.#scaleBar(context, ratio);
  }

  #scaleBar(context, ratio) {
    const lengths = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];
    const length = lengths.findLast((each) => each * this.scale < 90) || lengths[0];
    const [x, y] = [10, this.canvas.clientHeight - 10];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = this.theme.ink;
    context.fillRect(x, y - 2, length * this.scale, 2);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "bottom";
    context.fillText(`${length} m`, x, y - 4);
  }
}
