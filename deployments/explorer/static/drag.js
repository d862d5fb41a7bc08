/** Drags by a pointer. */

/**
 * Follow drags over an element.
 * @param {Element} over
 * @param {(event: PointerEvent) => number[]} placeOf In units of the caller.
 * @param {(from: number[], to: number[]) => void} moved
 * @param {(from: number[], to: number[]) => void} done
 * @param {(event: PointerEvent) => void} [hovered] While no button is down.
 */
export function onDrag(over, placeOf, moved, done, hovered = () => {}) {
  let from = null;
  over.addEventListener("pointerdown", (event) => {
    from = placeOf(event);
    over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", (event) => (from ? moved(from, placeOf(event)) : hovered(event)));
  over.addEventListener("pointercancel", () => (from = null));
  over.addEventListener("pointerup", (event) => {
    if (from) done(from, placeOf(event));
    from = null;
  });
}

/** @returns {[number, number]} Two numbers, the lesser first. */
export const ordered = (a, b) => (a < b ? [a, b] : [b, a]);
