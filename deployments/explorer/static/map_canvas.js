/** A canvas that shows a part of a map: a pointer moves it, the wheel or two pointers zoom it. */

const PX_PER_M = [0.5, 600];

export class MapCanvas {
  center = { x: 0, y: 0 };
  /** Pixels of a meter. */
  scale = 50;
  /** The whole map is shown, in whatever size the page gives it. */
  fitted = true;
  follow = false;
  pointers = new Map();

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {() => void} moved Draws the map.
   * @param {{hovered?: (event: PointerEvent) => void, zooms?: (event: WheelEvent) => boolean}} [more]
   */
  constructor(canvas, moved, { hovered = () => {}, zooms = () => true } = {}) {
    this.canvas = canvas;
    this.moved = moved;
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => (this.#pointer(event) ? null : hovered(event)));
    }
    const wheel = (event) => {
      if (!zooms(event)) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.002 * (event.deltaMode === 1 ? 33 : 1) * event.deltaY), event.offsetX, event.offsetY);
    };
    canvas.addEventListener("wheel", wheel, { passive: false });
    canvas.addEventListener("dblclick", () => this.fit());
  }

  fit() {
    this.fitted = true;
    this.follow = false;
    this.moved();
  }

  /** Zoom about a point of the canvas, by default its middle. */
  zoom(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    const scale = Math.min(Math.max(this.scale * factor, PX_PER_M[0]), PX_PER_M[1]);
    const apart = 1 / this.scale - 1 / scale;
    this.center.x += (x - this.canvas.clientWidth / 2) * apart;
    this.center.y -= (y - this.canvas.clientHeight / 2) * apart;
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

  /** Move or zoom with pointers that are down; false for one that only hovers. */
  #pointer(event) {
    const before = this.pointers.get(event.pointerId);
    const now = [event.offsetX, event.offsetY];
    if (event.type === "pointerdown") this.canvas.setPointerCapture(event.pointerId);
    else if (event.type !== "pointermove") return this.pointers.delete(event.pointerId);
    else if (!before) return false;
    this.pointers.set(event.pointerId, now);
    if (!before) return true;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (!other) this.pan(now[0] - before[0], now[1] - before[1]);
    const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    if (other) this.zoom(apart(now) / apart(before), ...other);
    return true;
  }

  /**
   * Take the size of the canvas on the page; a map that is shown whole has its middle and size there.
   * @param {number[]} ends Least and greatest x, least and greatest y (m).
   * @param {number} margin In pixels.
   */
  resize([left, right, bottom, top], margin = 0) {
    const { canvas } = this;
    const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio];
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (!this.fitted) return;
    this.center = { x: (left + right) / 2, y: (bottom + top) / 2 };
    const whole = Math.min((width - 2 * margin) / (right - left), (height - 2 * margin) / (top - bottom));
    this.scale = Math.max(whole, PX_PER_M[0]);
  }
}
