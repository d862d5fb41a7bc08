/** Pictures of grids, a pixel for each cell. */

import { rgb } from "./player_theme.js";

const INSCRIBED = 253;
const LETHAL = 254;
const UNKNOWN_COST = 255;

/**
 * Picture of a map, of the world where it differs, or of a filter's mask.
 * @param {string} kind
 * @param {Uint8Array} cells
 * @param {number} rows
 * @param {number} columns
 * @param {Object<string, string>} theme
 * @returns {HTMLCanvasElement}
 */
export function gridImage(kind, cells, rows, columns, theme) {
  const colors = new Uint32Array(256);
  if (kind === "map") {
    colors[0] = pixel(theme.free, 255);
    colors[1] = pixel(theme.wall, 255);
    colors[2] = pixel(theme.unknown, 255);
  } else if (kind === "world") {
    colors[1] = pixel(theme["world-wall"], 255);
  } else {
    // Values of masks are percent.
    const color = kind === "keepout" ? theme.keepout : theme["speed-zone"];
    for (let value = 1; value <= 100; value += 1) colors[value] = pixel(color, Math.round(1.28 * value));
  }
  return painted(cells, rows, columns, colors);
}

/**
 * Picture of costs: those of the global costmap by their height, of the local one only what forbids.
 * @param {"global" | "local"} name
 * @param {{cells: Uint8Array, rows: number, columns: number}} costs
 * @param {Object<string, string>} theme
 * @returns {HTMLCanvasElement}
 */
export function costImage(name, { cells, rows, columns }, theme) {
  const colors = new Uint32Array(256);
  const local = name === "local";
  const color = local ? theme.belief : theme.cost;
  for (let cost = 1; cost < INSCRIBED; cost += 1) colors[cost] = local ? 0 : pixel(color, 8 + Math.round((90 * cost) / 252));
  colors[INSCRIBED] = pixel(color, local ? 50 : 140);
  colors[LETHAL] = pixel(color, local ? 230 : 255);
  colors[UNKNOWN_COST] = 0;
  return painted(cells, rows, columns, colors);
}

function pixel(color, alpha) {
  const [red, green, blue] = rgb(color);
  // Bytes red, green, blue, alpha on processors that begin with the lowest, as all that browsers run on do.
  return ((alpha << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

function painted(cells, rows, columns, colors) {
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(columns, 1);
  canvas.height = Math.max(rows, 1);
  if (!rows || !columns) return canvas;
  const pixels = new Uint32Array(rows * columns);
  for (let k = 0; k < pixels.length; k += 1) pixels[k] = colors[cells[k]];
  const image = new ImageData(new Uint8ClampedArray(pixels.buffer), columns, rows);
  /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")).putImageData(image, 0, 0);
  return canvas;
}
