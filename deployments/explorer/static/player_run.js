/** A stored run: values at any time between its samples. */

/**
 * @typedef {Object} Pose
 * @property {number} x m
 * @property {number} y m
 * @property {number} yaw rad
 */

const NEXT_PLACE_S = 0.25;
/** Signals of missing layers and of a run without a robot. */
const NOTHING = new Float64Array(0);

export class Run {
  /** @param {import("./packed.js").Packed} reply */
  constructor({ header, arrays }) {
    this.header = header;
    this.arrays = arrays;
    this.hasRobot = !header.sentence;
    this.name = `${header.configuration}, run ${header.run}`;
    this.columns = {};
    for (const [name, values] of Object.entries(arrays)) {
      if (!(values instanceof Int32Array)) continue;
      // Stored columns are thousandths.
      this.columns[name] = Float64Array.from(values, (value) => (value === header.nowhere ? NaN : value / 1000));
    }
    this.t = this.columns.t_ms || NOTHING;
    const last = this.t.length ? this.t[this.t.length - 1] : 0;
    this.end = Math.max(header.simulated_s || 0, last);
    this.events = header.events || [];
    this.contacts = this.events.filter((event) => event.mark === "contact");
  }

  /**
   * Index of the last sample at or before a time.
   * @param {number} t
   */
  row(t) {
    return lastAtOrBefore(this.t, t);
  }

  /**
   * Where the robot is, or where it takes itself to be.
   * @param {number} t
   * @param {boolean} [believed]
   * @returns {Pose}
   */
  pose(t, believed = false) {
    const prefix = believed ? "estimated_" : "";
    const [xs, ys, yaws] = ["x_mm", "y_mm", "yaw_mrad"].map((name) => this.columns[prefix + name]);
    const { row, next, share } = this.between(t);
    const turn = Math.atan2(Math.sin(yaws[next] - yaws[row]), Math.cos(yaws[next] - yaws[row]));
    return {
      x: xs[row] + share * (xs[next] - xs[row]),
      y: ys[row] + share * (ys[next] - ys[row]),
      yaw: yaws[row] + share * turn,
    };
  }

  /**
   * Value of a signal, NaN where it was not measured.
   * @param {string} column
   * @param {number} t
   */
  value(column, t) {
    const values = this.columns[column];
    if (!values || !this.t.length) return NaN;
    const { row, next, share } = this.between(t);
    return values[row] + share * (values[next] - values[row]) || values[row];
  }

  between(t) {
    const row = this.row(t);
    const next = Math.min(row + 1, this.t.length - 1);
    const step = this.t[next] - this.t[row];
    const share = step > 0 ? Math.min(Math.max((t - this.t[row]) / step, 0), 1) : 0;
    return { row, next, share };
  }

  /**
   * Obstacles that are there at a time.
   * @param {number} t
   * @returns {Array<{obstacle: any, x: number, y: number, yaw: number}>}
   */
  obstacles(t) {
    const found = [];
    for (const obstacle of this.header.obstacles || []) {
      const { places } = obstacle;
      let k = 0;
      // Times are stored to the millisecond.
      while (k + 1 < places.length && places[k + 1][0] <= t + 5e-4) k += 1;
      let [since, x, y, yaw] = places[k];
      if (x === null) continue;
      const after = places[k + 1];
      if (after && after[1] !== null && after[0] - since < NEXT_PLACE_S && after[0] > since) {
        const share = Math.min(Math.max((t - since) / (after[0] - since), 0), 1);
        x += share * (after[1] - x);
        y += share * (after[2] - y);
        yaw += share * (after[3] - yaw);
      }
      found.push({ obstacle, x, y, yaw });
    }
    return found;
  }

  /**
   * What the robot or the scenario does.
   * @param {number} t
   * @param {Array<[number, number, string]>} activities
   */
  activity(t, activities) {
    const found = activities.find(([start, end]) => start <= t && t < end);
    return found ? found[2] : t >= this.end && activities.length ? "ended" : "";
  }
}

/** What the execution of a run added. */
export class Layers {
  /** @param {import("./packed.js").Packed} reply */
  constructor({ header, arrays }) {
    this.header = header;
    this.arrays = arrays;
    this.moments = header.arrays["plan spans"].shape[0];
  }

  /** @param {number} t */
  moment(t) {
    return Math.min(Math.floor(t / this.header.every_s + 1e-6), this.moments - 1);
  }

  /**
   * Points of a moment: whole numbers x, y, x, y … in units.
   * @param {"plan" | "scan" | "horizon" | "particles"} name
   * @param {number} moment
   */
  points(name, moment) {
    const [first, end] = this.arrays[`${name} spans`].subarray(2 * moment, 2 * moment + 2);
    const [x, y, size] = this.header.units[name];
    return { units: this.arrays[`${name} points`].subarray(2 * first, 2 * end), x, y, size };
  }

  /**
   * Costs of a moment around the robot; null while there are none.
   * @param {"global" | "local"} name
   * @param {number} moment
   */
  costs(name, moment) {
    const [first, rows, columns] = this.arrays[`${name} spans`].subarray(3 * moment, 3 * moment + 3);
    if (!rows || !columns) return null;
    const [x, y, yaw, resolution] = this.arrays[`${name} places`].subarray(4 * moment, 4 * moment + 4);
    const cells = this.arrays[`${name} cells`].subarray(first, first + rows * columns);
    return { first, cells, rows, columns, x, y, yaw, resolution };
  }
}

/**
 * Index of the last of increasing values that is not above `value`; 0 if all are.
 * @param {ArrayLike<number>} values
 * @param {number} value
 */
export function lastAtOrBefore(values, value) {
  let low = 0;
  let high = values.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (values[middle] <= value + 1e-9) low = middle;
    else high = middle - 1;
  }
  return low;
}
