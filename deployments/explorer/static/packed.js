/** Packed replies: a line of JSON, then arrays of numbers that are read in place. */

import { fetched } from "./dom.js";

const KINDS = { Uint8Array, Uint16Array, Uint32Array, Int16Array, Int32Array, Float32Array };

/**
 * Ask the server for a packed reply; its header has the shapes of its arrays.
 * @param {string} place
 * @param {RequestInit} [options]
 * @returns {Promise<{header: any, arrays: Object<string, any>}>}
 */
export async function fetchPacked(place, options = {}) {
  const buffer = await (await fetched(place, options)).arrayBuffer();
  const bytes = new Uint8Array(buffer);
  const line = bytes.indexOf(10);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(0, line)));
  const arrays = {};
  for (const [name, { type, shape, offset }] of Object.entries(header.arrays)) {
    const Kind = KINDS[`${type.replace(/^./, (letter) => letter.toUpperCase())}Array`];
    arrays[name] = new Kind(
      buffer,
      line + 1 + offset,
      shape.reduce((product, n) => product * n, 1),
    );
  }
  return { header, arrays };
}
