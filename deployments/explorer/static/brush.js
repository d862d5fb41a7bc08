/** A rectangle that selects a part of a drawing, by pointer or keys. */
import { filled, stepOf, within } from "./dom.js";

/** @returns {[number, number]} A pointer's place in a drawing's own units. */
export function placeIn(over, event) {
  const drawing = over.ownerSVGElement ?? over;
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(drawing.getScreenCTM().inverse());
  return [x, y];
}

/**
 * Let a rectangle be dragged, or moved by arrow keys, resized by them with shift, and chosen by Enter.
 * @param {SVGElement} over Where a pointer drags, and what has the focus; `band` shows the rectangle.
 * @param {{x: [number, number], y: [number, number]}} limits An axis that is not `free` is selected whole.
 * @param {"x" | "y" | "xy"} free
 * @param {(x: [number, number], y: [number, number]) => void} choose
 * @param {(event: PointerEvent) => void} [hovered] While no button is down.
 */
export function onBrush(over, band, limits, free, choose, hovered = () => {}) {
  let pressed = false;
  let corners = null;
  const spans = () => [0, 1].map((axis) => corners.map((corner) => corner[axis]).sort((a, b) => a - b));
  const mark = (...places) => {
    const inside = (value, axis, k) => (free.includes(axis) ? within(value, ...limits[axis]) : limits[axis][k]);
    corners = places.map(([x, y], k) => [inside(x, "x", k), inside(y, "y", k)]);
    const [[x, right], [y, bottom]] = spans();
    filled(band, { x, y, width: right - x, height: bottom - y });
  };
  over.addEventListener("pointerdown", (event) => {
    pressed = true;
    over.setPointerCapture(event.pointerId);
    mark(placeIn(over, event), placeIn(over, event));
  });
  over.addEventListener("pointermove", (event) => {
    if (pressed) mark(corners[0], placeIn(over, event));
    else hovered(event);
  });
  over.addEventListener("pointerup", () => pressed && choose(...spans()));
  over.addEventListener("lostpointercapture", () => (pressed = false));
  over.addEventListener("keydown", (event) => {
    const step = stepOf(event);
    if (event.key === "Enter" && corners) choose(...spans());
    if (!step) return;
    event.preventDefault();
    const sizes = [limits.x, limits.y].map(([low, high]) => high - low);
    const at = (share) => [limits.x[0] + share * sizes[0], limits.y[0] + share * sizes[1]];
    const [from, to] = corners ?? [at(0.4), at(0.6)];
    const moved = (place) => place.map((value, k) => value + 0.05 * step[k] * sizes[k]);
    mark(event.shiftKey ? from : moved(from), moved(to));
  });
}
