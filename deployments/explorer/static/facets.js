/** The side bar: what is ticked, written, or brushed becomes a condition. */
import { onBrush } from "./brush.js";

const [WIDTH, HEIGHT] = [240, 48];

const quoted = (text) => encodeURIComponent(text).replace(/[!*]/g, (sign) => (sign === "!" ? "%21" : "%2A"));

/** Put a condition on a column into a filter, in the place of an earlier one; an empty one only takes that away. */
export function changed(filter, column, rest) {
  const others = filter.split(";").filter((each) => decodeURIComponent(each.split(/[=:*]/)[0]) !== column);
  return [...others, rest && quoted(column) + rest].filter(Boolean).join(";");
}

/** The condition of a chosen range; its ends are rounded to a thousandth of it, so that addresses stay short. */
export function rangeText([low, high]) {
  const digits = Math.max(Math.ceil(3 - Math.log10(high - low)), 0);
  return `:${Number(low.toFixed(digits))}..${Number(high.toFixed(digits))}`;
}

/** The condition of some values; null is a missing one. */
export const valuesText = (values) => `=${values.map((value) => (value === null ? "!" : quoted(value))).join("|")}`;

/** Follow the fields of a side bar. @type {(bar: Element, choose: (column: string, rest: string) => void) => void} */
export function followFields(bar, choose) {
  bar.addEventListener("change", ({ target }) => {
    if (target.type === "search") return choose("configuration", target.value && `*${quoted(target.value)}`);
    const facet = target.closest(".facet");
    const [low, high] = [...facet.querySelectorAll("[type=number]")].map((each) => each.value);
    const ticked = [...facet.querySelectorAll(":checked")].map((each) => each.value);
    const values = ticked.length ? `=${ticked.join("|")}` : "";
    choose(facet.dataset.column, target.type === "number" ? (low || high ? `:${low}..${high}` : "") : values);
  });
}

/** Let histograms be brushed; a click takes a bar. @type {typeof followFields} */
export function brushHistograms(bar, choose) {
  for (const drawing of bar.querySelectorAll(".histogram")) {
    const [least, greatest, bins] = ["low", "high", "bins"].map((name) => Number(drawing.dataset[name]));
    const limits = { x: [0, WIDTH], y: [0, HEIGHT] };
    onBrush(drawing, drawing.querySelector(".band"), limits, "x", ([start, end]) => {
      const bin = WIDTH / bins;
      const first = Math.min(Math.floor(start / bin), bins - 1) * bin;
      const ends = end - start < WIDTH / 200 ? [first, first + bin] : [start, end];
      const range = ends.map((at) => least + (at / WIDTH) * (greatest - least));
      choose(drawing.closest(".facet").dataset.column, rangeText(range));
    });
  }
}
