/** Packed replies: a line of JSON, then arrays of numbers that are read in place. */

const KINDS = {
  uint8: Uint8Array,
  uint16: Uint16Array,
  uint32: Uint32Array,
  int16: Int16Array,
  int32: Int32Array,
  float32: Float32Array,
};

/**
 * @typedef {Object} Packed
 * @property {any} header
 * @property {Object<string, any>} arrays Typed arrays by name; the header has their shapes.
 */

/**
 * Read a packed reply.
 * @param {ArrayBuffer} buffer
 * @returns {Packed}
 */
export function unpacked(buffer) {
  const bytes = new Uint8Array(buffer);
  const line = bytes.indexOf(10);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(0, line)));
  const arrays = {};
  for (const [name, { type, shape, offset }] of Object.entries(header.arrays)) {
    const count = shape.reduce((product, n) => product * n, 1);
    arrays[name] = new KINDS[type](buffer, line + 1 + offset, count);
  }
  return { header, arrays };
}
