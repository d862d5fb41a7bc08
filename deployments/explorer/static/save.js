/** Figures as files: SVG with its colors in it, and PNG of twice the size. */
import { drawn, element, filled, readTheme } from "./dom.js";

const KEPT = ["fill", "fill-opacity", "font-family", "font-size", "image-rendering", "opacity", "stroke"];
KEPT.push("stroke-linecap", "stroke-opacity", "stroke-width", "text-anchor", "vector-effect");

/** Make the two buttons that save a figure of the page. @type {(name: string, figure: () => any) => HTMLElement[]} */
export function saveButtons(name, figure) {
  return Object.entries({ PNG: pngOf, SVG: (blob) => blob }).map(([kind, made]) => {
    const click = async () => {
      if (figure()) save(await made(blobOf(figure())), `${name}.${kind.toLowerCase()}`);
    };
    return element("button", { click, title: `Save the figure as ${kind}` }, kind);
  });
}

/** A figure as a file that needs no style sheet. */
function blobOf(figure) {
  const copy = /** @type {SVGSVGElement} */ (figure.cloneNode(true));
  const [from, to] = [figure, copy].map((each) => [each, ...each.querySelectorAll("*")]);
  from.forEach((each, k) => {
    const style = getComputedStyle(each);
    for (const key of KEPT) to[k].setAttribute(key, style.getPropertyValue(key));
    to[k].removeAttribute("class");
  });
  const { x, y, width, height } = figure.viewBox.baseVal;
  filled(copy, { xmlns: "http://www.w3.org/2000/svg", width: figure.clientWidth, height: figure.clientHeight });
  copy.prepend(drawn("rect", { x, y, width, height, fill: readTheme().panel }));
  return new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" });
}

async function pngOf(blob) {
  const address = URL.createObjectURL(blob);
  const picture = new Image();
  picture.src = address;
  await picture.decode();
  const canvas = new OffscreenCanvas(2 * picture.width, 2 * picture.height);
  canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(address);
  return canvas.convertToBlob();
}

/** Save a blob as a file. @type {(blob: Blob, name: string) => void} */
export function save(blob, name) {
  const address = URL.createObjectURL(blob);
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}
