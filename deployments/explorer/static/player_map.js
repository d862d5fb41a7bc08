/** The map of one run, drawn in meters; y points up. */
import { picture, ShownPart } from "./maps.js";

const TURN = 2 * Math.PI;
const MARGIN_PX = 12;
const BAR_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];
const [INSCRIBED, LETHAL, UNKNOWN_COST] = [253, 254, 255];

export class RunMap extends ShownPart {
  layers = null;

  constructor(canvas, run, moved) {
    super(canvas, moved);
    this.run = run;
    this.context = canvas.getContext("2d");
  }

  paint(theme) {
    this.theme = theme;
    this.costs = {};
    this.grids = this.run.header.grids.map((grid) => {
      const [rows, columns] = this.run.header.arrays[grid.cells].shape;
      const image = this.#image(grid.kind, { cells: this.run.arrays[grid.cells], rows, columns });
      return { ...grid, rows, columns, image };
    });
  }

  /** Take the size that the page gives the canvas. */
  place() {
    const { element: canvas } = this;
    canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
    canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
  }

  /** Draw a moment with the layers whose names are in `shown`. */
  draw(t, shown) {
    const time = Math.min(t, this.run.end);
    this.take(this.grids[0].extent, MARGIN_PX);
    if (this.follow) this.center = this.run.pose(time);
    const { element: canvas, context, theme } = this;
    const scale = this.scale * devicePixelRatio;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = theme.well;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const [left, top] = [canvas.width / 2 - scale * this.center.x, canvas.height / 2 + scale * this.center.y];
    context.setTransform(scale, 0, 0, -scale, left, top);
    this.px = 1 / this.scale;
    this.#moment(time, shown);
    const length = BAR_M.findLast((each) => each * this.scale < 90) || BAR_M[0];
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 10, canvas.height - 10 * devicePixelRatio);
    context.fillStyle = theme.ink;
    context.fillRect(0, -2, length * this.scale, 2);
    context.font = "11px system-ui, sans-serif";
    context.fillText(`${length} m`, 0, -6);
  }

  #moment(t, shown) {
    const { context, run, layers, theme, grids, px } = this;
    const moment = layers ? layers.moment(t) : -1;
    const points = (name) => (shown.has(name) && moment >= 0 ? layers.points(name, moment) : []);
    context.imageSmoothingEnabled = false;
    context.lineJoin = context.lineCap = "round";
    this.#grid(grids[0]);
    this.#costs("global", shown.has("global") ? moment : -1);
    for (const grid of grids.slice(1)) this.#grid(grid);
    this.#costs("local", shown.has("local") ? moment : -1);
    if (shown.has("obstacles")) for (const each of run.obstacles(t)) this.#obstacle(each);
    if (shown.has("reference")) this.#stroke(run.arrays.reference, theme.muted, 1.5, [6, 4]);
    this.#trajectory(t, shown);
    this.#stroke(points("plan"), theme.goal, 1.8);
    this.#stroke(points("horizon"), theme.horizon, 2.6);
    this.#dots(points("particles"), theme.belief, 2 * px);
    this.#dots(points("scan"), theme.ink, 2.4 * px);
    for (const [x, y] of run.header.goals) {
      this.#placed(x, y, Math.PI / 4, () => {
        this.#fill(() => context.rect(-4 * px, -4 * px, 8 * px, 8 * px), theme.goal);
        this.#stroke(null, theme.panel, 1);
      });
    }
    this.#robot(run.pose(t), theme.panel, theme.ink, 1);
    if (shown.has("belief")) this.#robot(run.pose(t, true), theme.belief, "transparent", 1.8);
    for (const { x_m: x, y_m: y, t_s } of shown.has("contacts") ? run.contacts : []) {
      if (t_s > t + 1e-6) continue;
      const r = 5 * px;
      this.#stroke([x - r, y - r, x + r, y + r, x, y, x - r, y + r, x + r, y - r], theme.panel, 5);
      this.#stroke(null, theme.fail, 2.5);
    }
  }

  /** Draw in the frame of a place. */
  #placed(x, y, yaw, draw) {
    this.context.save();
    this.context.translate(x, y);
    this.context.rotate(yaw);
    draw();
    this.context.restore();
  }

  /** Stroke a line of x, y, x, y …, or the last path for null; width and dashes are in pixels. */
  #stroke(xy, color, width, dashes = []) {
    const { context, px } = this;
    if (xy) context.beginPath();
    for (let k = 0; xy && k < xy.length; k += 2) context.lineTo(xy[k], xy[k + 1]);
    context.setLineDash(dashes.map((each) => each * px));
    context.strokeStyle = color;
    context.lineWidth = width * px;
    context.stroke();
  }

  #fill(path, color) {
    this.context.beginPath();
    path();
    this.context.closePath();
    this.context.fillStyle = color;
    this.context.fill();
  }

  #dots(xy, color, edge) {
    this.context.fillStyle = color;
    for (let k = 0; k < xy.length; k += 2) {
      this.context.fillRect(xy[k] - edge / 2, xy[k + 1] - edge / 2, edge, edge);
    }
  }

  /** Row 0 is at the lowest y, as y points up here. */
  #grid({ image, x_m, y_m, yaw_rad, rows, columns, resolution_m }) {
    const size = [columns * resolution_m, rows * resolution_m];
    this.#placed(x_m, y_m, yaw_rad, () => this.context.drawImage(image, 0, 0, ...size));
  }

  #costs(name, moment) {
    const costs = moment < 0 ? null : this.layers.costs(name, moment);
    if (!costs) return;
    const known = this.costs[name];
    const image = known?.first === costs.first ? known.image : this.#image(name, costs);
    this.costs[name] = { first: costs.first, image };
    this.#grid({ ...costs, image });
    if (name === "global") return;
    const [width, height] = [costs.columns * costs.resolution_m, costs.rows * costs.resolution_m];
    this.#placed(costs.x_m, costs.y_m, costs.yaw_rad, () =>
      this.#stroke([0, 0, width, 0, width, height, 0, height, 0, 0], this.theme.belief, 1, [4, 3]),
    );
  }

  #obstacle({ shape, length_m, width_m, x, y, yaw }) {
    const { context, theme } = this;
    this.#placed(x, y, yaw, () => {
      context.globalAlpha = 0.6;
      const round = () => context.arc(0, 0, length_m / 2, 0, TURN);
      const box = () => context.rect(-length_m / 2, -width_m / 2, length_m, width_m);
      this.#fill(shape === "cylinder" ? round : box, theme.obstacle);
      context.globalAlpha = 1;
      this.#stroke(null, theme["obstacle-edge"], 1.2);
    });
  }

  #trajectory(t, shown) {
    const { run, theme } = this;
    const { row } = run.between(t);
    const line = (first, end, believed) => {
      const [xs, ys] = ["x_mm", "y_mm"].map((name) => run.columns[believed ? `estimated_${name}` : name]);
      const { x, y } = run.pose(t, believed);
      const xy = first ? [x, y] : [];
      for (let k = first; k < end; k += 1) xy.push(xs[k], ys[k]);
      return first ? xy : [...xy, x, y];
    };
    if (shown.has("future")) this.#stroke(line(row + 1, run.t.length), theme.muted, 1, [2, 3]);
    if (shown.has("belief")) this.#stroke(line(0, row + 1, true), theme.belief, 1, [4, 2]);
    if (shown.has("past")) this.#stroke(line(0, row + 1), theme[run.header.judgment.replace(" ", "-")], 2);
  }

  #robot({ x, y, yaw }, edge, inside, width) {
    const { context, run } = this;
    const { radius_m, vertices } = run.header.robot;
    this.#placed(x, y, yaw, () => {
      const round = () => context.arc(0, 0, radius_m, 0, TURN);
      const polygon = () => vertices.forEach((each) => context.lineTo(...each));
      this.#fill(vertices.length ? polygon : round, inside);
      this.#stroke(null, edge, width);
      this.#stroke([0, 0, radius_m, 0], edge, inside === "transparent" ? width : 2 * width);
    });
  }

  /** Picture of a map, of the world where it differs from it, of a filter's mask, or of costs. */
  #image(kind, { cells, rows, columns }) {
    const colors = Uint32Array.from({ length: 256 }, (_, value) => pixel(...look(kind, value, this.theme)));
    const pixels = Uint32Array.from(cells, (cell) => colors[cell]);
    return picture(rows, columns, new Uint8ClampedArray(pixels.buffer));
  }
}

/** Color and opacity of a cell. Of the local costmap only what forbids is shown. */
function look(kind, value, theme) {
  if (kind === "map") return [[theme.panel, theme.wall, theme.well][value] || theme.well, 255];
  if (kind === "world") return [theme["obstacle-edge"], value === 1 ? 255 : 0];
  if (kind === "keepout" || kind === "speed") return [theme[kind], Math.min(Math.round(1.3 * value), 255)];
  const isLocal = kind === "local";
  const color = isLocal ? theme.belief : theme.cost;
  if (value === 0 || value === UNKNOWN_COST) return [color, 0];
  if (value < INSCRIBED) return [color, isLocal ? 0 : 8 + Math.round((90 * value) / 252)];
  if (value === LETHAL) return [color, isLocal ? 230 : 255];
  return [color, isLocal ? 50 : 140];
}

/** Bytes red, green, blue, alpha, as a number of processors that begin with the lowest byte. */
function pixel(color, alpha) {
  const [red, green, blue] = color.match(/\d+/g).map(Number);
  return ((alpha << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}
