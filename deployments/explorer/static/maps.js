/** What maps share: a pointer moves them, the wheel or two pointers zoom them, and cells become pictures. */
import { within } from "./dom.js";

const PX_PER_M = [0.5, 600];

/** A part of a map that an element shows. */
export class ShownPart {
  center = { x: 0, y: 0 };
  /** Pixels of a meter. */
  scale = 50;
  /** The whole map is shown, in whatever size the page gives it. */
  fitted = true;
  follow = false;
  pointers = new Map();

  /** `moved` draws the map, `hovered` is told of other pointers, and `zooms` says whether a wheel does. */
  constructor(element, moved, { hovered = () => {}, zooms = () => true } = {}) {
    this.element = element;
    this.moved = moved;
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      element.addEventListener(kind, (event) => this.#pointer(event) || hovered(event));
    }
    const wheel = (event) => {
      if (!zooms(event)) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.002 * (event.deltaMode === 1 ? 33 : 1) * event.deltaY), ...this.#place(event));
    };
    element.addEventListener("wheel", wheel, { passive: false });
    element.addEventListener("dblclick", () => this.fit());
  }

  /** Show the whole map. */
  fit() {
    this.fitted = true;
    this.follow = false;
    this.moved();
  }

  /** Zoom about a point of the element, by default its middle. */
  zoom(factor, x = this.element.clientWidth / 2, y = this.element.clientHeight / 2) {
    const scale = within(this.scale * factor, ...PX_PER_M);
    const apart = 1 / this.scale - 1 / scale;
    this.center.x += (x - this.element.clientWidth / 2) * apart;
    this.center.y -= (y - this.element.clientHeight / 2) * apart;
    this.scale = scale;
    this.fitted = false;
    this.moved();
  }

  pan(dx, dy) {
    this.center.x -= dx / this.scale;
    this.center.y += dy / this.scale;
    this.follow = this.fitted = false;
    this.moved();
  }

  /** Take the middle and size of least and greatest x, least and greatest y (m), if the whole map is shown. */
  take([left, right, bottom, top], margin = 0) {
    if (!this.fitted) return;
    const [width, height] = [this.element.clientWidth - 2 * margin, this.element.clientHeight - 2 * margin];
    this.center = { x: (left + right) / 2, y: (bottom + top) / 2 };
    this.scale = Math.max(Math.min(width / (right - left), height / (top - bottom)), PX_PER_M[0]);
  }

  #place({ clientX, clientY }) {
    const { x, y } = this.element.getBoundingClientRect();
    return [clientX - x, clientY - y];
  }

  /** Move or zoom with pointers that are down; false for one that only hovers. */
  #pointer(event) {
    const before = this.pointers.get(event.pointerId);
    const now = this.#place(event);
    if (event.type === "pointerdown") this.element.setPointerCapture(event.pointerId);
    else if (event.type !== "pointermove") return this.pointers.delete(event.pointerId);
    else if (!before) return false;
    this.pointers.set(event.pointerId, now);
    if (!before) return true;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    if (other) this.zoom(apart(now) / apart(before), ...other);
    else this.pan(now[0] - before[0], now[1] - before[1]);
    return true;
  }
}

/** Make a picture of the colors of cells: red, green, blue, and opacity of each. */
export function picture(rows, columns, colors) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [columns, rows];
  if (rows && columns) canvas.getContext("2d").putImageData(new ImageData(colors, columns, rows), 0, 0);
  return canvas;
}
