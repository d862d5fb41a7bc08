/** Colors of the cells of a map, and their legend. */
import { drawn } from "./dom.js";
import { count } from "./selection.js";

const RAMP = [
  [253, 231, 37],
  [94, 201, 98],
  [33, 145, 140],
  [59, 82, 139],
  [68, 1, 84],
];
/** Viridis from yellow (little) to purple (much), as in the report. */
const SELDOM = [150, 150, 150];

/** @returns {number[]} Color of a share from 0 to 1. */
function rampColor(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[k].map((part, c) => Math.round(part + (RAMP[k + 1][c] - part) * (at - k)));
}

/**
 * Color the cells of a grid, and write their legend.
 * @param {{header: any, arrays: any}} content
 * @param {HTMLElement} legend
 * @returns {HTMLCanvasElement} A pixel for each cell.
 */
export function coloredCells({ header, arrays }, legend) {
  const { runs, failed } = arrays;
  const { rows, columns } = header.grid;
  const shown = document.createElement("canvas");
  [shown.width, shown.height] = [columns, rows];
  const picture = new ImageData(columns, rows);
  const isRate = header.layer === "rate";
  const values = header.layer === "ends" && failed.some((n) => n > 0) ? failed : runs;
  const most = isRate ? 1 : values.reduce((a, b) => Math.max(a, b), 1);
  for (let k = 0; k < runs.length; k++) {
    if (!(isRate ? runs[k] : values[k])) continue;
    const pixel = 4 * ((rows - 1 - Math.floor(k / columns)) * columns + (k % columns));
    const seldom = isRate && runs[k] < header.minimum;
    const share = isRate ? failed[k] / runs[k] : Math.log1p(values[k]) / Math.log1p(most);
    const color = seldom ? SELDOM : rampColor(share);
    picture.data.set([...color, seldom ? 70 : isRate && !failed[k] ? 60 : 200], pixel);
  }
  shown.getContext("2d").putImageData(picture, 0, 0);
  const words = isRate
    ? `share of the runs that came here and failed here; gray: fewer than ${header.minimum} visits; faint: no failure`
    : values === failed
      ? "failed runs that ended here"
      : `runs that ${header.layer === "ends" ? "ended" : "came"} here`;
  const stops = Array.from({ length: 30 }, (_, k) => {
    return drawn("rect", { x: 4 * k, y: 0, width: 4, height: 8, fill: `rgb(${rampColor(k / 29)})` });
  });
  const ramp = drawn("svg", { viewBox: "0 0 120 8", width: 120, height: 8, "aria-hidden": "true" }, ...stops);
  legend.replaceChildren(isRate ? "0 % " : "1 ", ramp, isRate ? " 100 % " : ` ${count(most)} `, words);
  return shown;
}
