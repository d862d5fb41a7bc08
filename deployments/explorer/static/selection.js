/** The state of a campaign's page, as its address has it. */

/** @typedef {{column: string, values?: (string | null)[], low?: number | null, high?: number | null, part?: string}} Condition */

const quote = (text) => encodeURIComponent(text).replace(/[!*]/g, (sign) => (sign === "!" ? "%21" : "%2A"));

/**
 * Write conditions as the text `f`; the server puts them in order.
 * @param {Condition[]} conditions
 * @returns {string}
 */
export function filterText(conditions) {
  return conditions
    .map(({ column, values, low, high, part }) => {
      if (values) return `${quote(column)}=${values.map((value) => (value === null ? "!" : quote(value))).join("|")}`;
      if (part !== undefined) return `${quote(column)}*${quote(part)}`;
      return `${quote(column)}:${low ?? ""}..${high ?? ""}`;
    })
    .join(";");
}

/**
 * Put a condition in the place of its column's; null takes it away.
 * @param {Condition[]} conditions
 * @param {string} column
 * @param {Condition | null} condition
 * @returns {Condition[]}
 */
export function changed(conditions, column, condition) {
  const others = conditions.filter((each) => each.column !== column);
  return condition ? [...others, condition] : others;
}

/**
 * Say a condition in words.
 * @param {Condition} condition
 * @returns {string}
 */
export function conditionWords({ column, values, low, high, part }) {
  if (values) return `${column}: ${values.map((value) => value ?? "missing").join(" or ")}`;
  if (part !== undefined) return `${column} contains “${part}”`;
  if (low === null || low === undefined) return `${column} ≤ ${number(high)}`;
  if (high === null || high === undefined) return `${column} ≥ ${number(low)}`;
  return `${column}: ${number(low)} to ${number(high)}`;
}

/**
 * Write a number in four digits; what was not measured is a dash.
 * @param {number | null | undefined} value
 * @returns {string}
 */
export function number(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return String(value);
  return String(Number(value.toPrecision(4)));
}

/**
 * A name that may be broken after each underscore and dot.
 * @param {string} name
 * @returns {(string | Node)[]}
 */
export const breakable = (name) => name.split(/(?<=[_.])/).flatMap((part) => [part, document.createElement("wbr")]);

/** @param {number} value @returns {string} */
export const count = (value) => value.toLocaleString("en-US");

/** @param {number | null} share @returns {string} */
export const percent = (share) => (share === null ? "–" : `${(100 * share).toFixed(1)} %`);

/**
 * Write an interval in percent, rounded outwards.
 * @param {[number, number] | null} ends
 * @returns {string}
 */
export function interval(ends) {
  if (!ends) return "";
  const outwards = [Math.floor(1000 * ends[0] + 1e-6) / 10, Math.ceil(1000 * ends[1] - 1e-6) / 10];
  return `${outwards[0].toFixed(1)}–${outwards[1].toFixed(1)} %`;
}
