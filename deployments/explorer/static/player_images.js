/** Pictures of grids, a pixel for each cell. */

const INSCRIBED = 253;
const LETHAL = 254;
const UNKNOWN_COST = 255;

/**
 * Picture of a map, of the world where it differs from it, of a filter's mask, or of costs.
 * @param {"map" | "world" | "keepout" | "speed" | "global" | "local"} kind
 * @param {{cells: Uint8Array, rows: number, columns: number}} grid
 * @param {Object<string, string>} theme
 * @returns {HTMLCanvasElement}
 */
export function gridImage(kind, { cells, rows, columns }, theme) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [columns, rows];
  if (!rows || !columns) return canvas;
  const colors = Uint32Array.from({ length: 256 }, (_, value) => pixel(...look(kind, value, theme)));
  const pixels = Uint32Array.from(cells, (cell) => colors[cell]);
  const image = new ImageData(new Uint8ClampedArray(pixels.buffer), columns, rows);
  /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")).putImageData(image, 0, 0);
  return canvas;
}

/** Color and opacity of a cell. Of the local costmap only what forbids is shown. */
function look(kind, value, theme) {
  if (kind === "map") return [[theme.free, theme.wall, theme.unknown][value] || theme.unknown, 255];
  if (kind === "world") return [theme["world-wall"], value === 1 ? 255 : 0];
  if (kind === "keepout" || kind === "speed") return [theme[kind], Math.min(Math.round(1.3 * value), 255)];
  const color = kind === "local" ? theme.belief : theme.cost;
  if (value === 0 || value === UNKNOWN_COST) return [color, 0];
  if (value >= INSCRIBED)
    return [color, kind === "local" ? (value === LETHAL ? 230 : 50) : value === LETHAL ? 255 : 140];
  return [color, kind === "local" ? 0 : 8 + Math.round((90 * value) / 252)];
}

/** Bytes red, green, blue, alpha, as a number of processors that begin with the lowest byte. */
function pixel(color, alpha) {
  const [red, green, blue] = color.match(/\d+/g).map(Number);
  return ((alpha << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}
