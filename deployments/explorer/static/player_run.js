/** A stored run, and what an execution added: values at any time. */

const NEXT_PLACE_S = 0.25;

export class Run {
  constructor({ header, arrays }) {
    Object.assign(this, { header, arrays });
    this.hasRobot = !header.sentence;
    this.name = `${header.configuration}, run ${header.run}`;
    this.columns = {};
    for (const [name, values] of Object.entries(arrays)) {
      if (!(values instanceof Int32Array)) continue;
      // Stored columns are thousandths.
      this.columns[name] = Float64Array.from(values, (value) => (value === header.nowhere ? NaN : value / 1000));
    }
    this.t = this.columns.t_ms || new Float64Array(1);
    this.end = Math.max(header.simulated_s || 0, this.t[this.t.length - 1]);
    this.events = header.events || [];
    this.contacts = this.events.filter((event) => event.kind === "contact");
  }

  /** Sample at or before a time, the one after it, and the share of the time between them. */
  between(t) {
    const row = Math.max(
      this.t.findLastIndex((each) => each <= t + 1e-9),
      0,
    );
    const next = Math.min(row + 1, this.t.length - 1);
    const step = this.t[next] - this.t[row];
    return { row, next, share: step > 0 ? Math.min(Math.max((t - this.t[row]) / step, 0), 1) : 0 };
  }

  /** Value of a signal, NaN where it was not measured. */
  value(column, t) {
    const { row, next, share } = this.between(t);
    const [before, after] = [this.columns[column]?.[row] ?? NaN, this.columns[column]?.[next]];
    return share > 0 ? before + share * (after - before) : before;
  }

  /** Where the robot is, or believes to be, in m and rad. */
  pose(t, believed = false) {
    const name = (each) => (believed ? `estimated_${each}` : each);
    const { row, next, share } = this.between(t);
    const yaws = this.columns[name("yaw_mrad")];
    const turn = Math.atan2(Math.sin(yaws[next] - yaws[row]), Math.cos(yaws[next] - yaws[row]));
    return { x: this.value(name("x_mm"), t), y: this.value(name("y_mm"), t), yaw: yaws[row] + share * turn };
  }

  /** Obstacles that are there at a time, with their poses. */
  obstacles(t) {
    return this.header.obstacles.flatMap(({ places, ...obstacle }) => {
      // Times are stored to the millisecond.
      const last = places.findLastIndex(([since]) => since <= t + 5e-4);
      const k = Math.max(last, 0);
      const [since, x, y, yaw] = places[k];
      const [until, ...to] = places[k + 1] || [Infinity];
      if (x === null) return [];
      const moves = until - since < NEXT_PLACE_S && to[0] !== null;
      const share = moves ? Math.min(Math.max((t - since) / (until - since), 0), 1) : 0;
      const at = (from, value) => (share ? from + share * (value - from) : from);
      const turn = Math.atan2(Math.sin(to[2] - yaw), Math.cos(to[2] - yaw));
      return [{ ...obstacle, x: at(x, to[0]), y: at(y, to[1]), yaw: share ? yaw + share * turn : yaw }];
    });
  }
}

export class Layers {
  constructor({ header, arrays }) {
    Object.assign(this, { header, arrays });
    this.moments = header.arrays["plan spans"].shape[0];
  }

  moment(t) {
    return Math.min(Math.floor(t / this.header.every_s + 1e-6), this.moments - 1);
  }

  /** Points x, y, x, y … of a moment (m). */
  points(name, moment) {
    const [first, end] = this.arrays[`${name} spans`].subarray(2 * moment);
    return Float32Array.from(this.arrays[`${name} points`].subarray(2 * first, 2 * end), (at) => at / 1000);
  }

  /** Costs of a moment, and where they are; null while there are none. */
  costs(name, moment) {
    const [first, rows, columns] = this.arrays[`${name} spans`].subarray(3 * moment);
    const [x_m, y_m, yaw_rad, resolution_m] = this.arrays[`${name} places`].subarray(4 * moment);
    const cells = this.arrays[`${name} cells`].subarray(first, first + rows * columns);
    return rows && columns ? { first, cells, rows, columns, x_m, y_m, yaw_rad, resolution_m } : null;
  }
}
