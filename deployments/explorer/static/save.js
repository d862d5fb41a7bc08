/** Figures as files: SVG with its colors in it, and PNG of twice the size. */
import { readTheme } from "./colors.js";
import { drawn, element } from "./dom.js";

const KEPT = [
  "fill",
  "stroke",
  "stroke-width",
  "stroke-opacity",
  "fill-opacity",
  "stroke-linecap",
  "font-size",
  "font-family",
  "text-anchor",
];

/**
 * Make the two buttons that save a figure.
 * @param {string} name Of the file, without its ending.
 * @param {() => SVGElement | null} made The figure, in or outside of the page.
 * @returns {HTMLElement[]}
 */
export function saveButtons(name, made) {
  const button = (ending, save) => {
    const click = () => {
      const figure = made();
      if (figure) save(alone(figure), `${name}.${ending}`);
    };
    return element("button", { click, title: `Save the figure as ${ending.toUpperCase()}` }, ending.toUpperCase());
  };
  return [button("png", savePng), button("svg", (figure, name) => save(blobOf(figure), name))];
}

/** A copy of a figure that needs no style sheet. */
function alone(figure) {
  const copy = /** @type {SVGElement} */ (figure.cloneNode(true));
  if (figure.isConnected) {
    const [from, to] = [figure, copy].map((each) => [each, ...each.querySelectorAll("*")]);
    from.forEach((each, k) => {
      const style = getComputedStyle(each);
      for (const key of KEPT) to[k].setAttribute(key, style.getPropertyValue(key));
      to[k].removeAttribute("class");
    });
  }
  const box = copy.getAttribute("viewBox").split(" ").map(Number);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("width", String(box[2]));
  copy.setAttribute("height", String(box[3]));
  copy.prepend(drawn("rect", { width: "100%", height: "100%", fill: readTheme().panel }));
  return copy;
}

function blobOf(figure) {
  return new Blob([new XMLSerializer().serializeToString(figure)], { type: "image/svg+xml" });
}

async function savePng(figure, name) {
  const address = URL.createObjectURL(blobOf(figure));
  const picture = new Image();
  picture.src = address;
  await picture.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [2 * picture.width, 2 * picture.height];
  canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(address);
  canvas.toBlob((blob) => blob && save(blob, name));
}

function save(blob, name) {
  const address = URL.createObjectURL(blob);
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}
