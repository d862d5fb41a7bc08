/** The map of one run. */
import { MapCanvas } from "./map_canvas.js";
import { drawMoment } from "./player_drawing.js";
import { gridImage } from "./player_images.js";

const MARGIN_PX = 12;
const BAR_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];

export class RunMap extends MapCanvas {
  /** @type {import("./player_run.js").Layers | null} */
  layers = null;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./player_run.js").Run} run
   * @param {() => void} moved Called when the view was moved or zoomed.
   */
  constructor(canvas, run, moved) {
    super(canvas, moved);
    this.run = run;
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

  fit() {
    this.fitted = true;
    this.place();
    super.fit();
  }

  /** Show the part of the map that fits into the page, or all of it. */
  place() {
    const { x_m: x, y_m: y, yaw_rad, rows, columns, resolution_m } = this.grids[0];
    const [width, height, c, s] = [columns * resolution_m, rows * resolution_m, Math.cos(yaw_rad), Math.sin(yaw_rad)];
    const [xs, ys] = [
      [0, c * width, -s * height, c * width - s * height],
      [0, s * width, c * height, s * width + c * height],
    ];
    const ends = [x + Math.min(...xs), x + Math.max(...xs), y + Math.min(...ys), y + Math.max(...ys)];
    this.resize(ends, MARGIN_PX);
  }

  /** Draw a moment with the layers whose names are in `shown`. */
  draw(t, shown) {
    const time = Math.min(t, this.run.end);
    if (this.follow) this.center = this.run.pose(time);
    const { canvas, theme } = this;
    const context = canvas.getContext("2d");
    const ratio = devicePixelRatio;
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
