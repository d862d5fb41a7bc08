/** One moment of a run on its map, in meters; y points up. */

import { verdictOf } from "./colors.js";
import { gridImage } from "./player_images.js";

const TURN = 2 * Math.PI;

/**
 * Draw the layers that are shown.
 * @param {CanvasRenderingContext2D} context Its transform is from meters.
 * @param {import("./player_map.js").RunMap} view
 * @param {number} t
 * @param {Set<string>} shown
 * @param {number} px Meters of a pixel.
 */
export function drawMoment(context, view, t, shown, px) {
  const { run, layers, theme, grids } = view;
  const moment = layers ? layers.moment(t) : -1;
  const points = (name) => (shown.has(name) && moment >= 0 ? layers.points(name, moment) : []);
  context.imageSmoothingEnabled = false;
  context.lineJoin = context.lineCap = "round";
  drawGrid(context, grids[0]);
  drawCosts(context, view, "global", shown.has("global") ? moment : -1, px);
  for (const grid of grids.slice(1)) drawGrid(context, grid);
  drawCosts(context, view, "local", shown.has("local") ? moment : -1, px);
  if (shown.has("obstacles")) for (const each of run.obstacles(t)) drawObstacle(context, each, theme, px);
  if (shown.has("reference")) stroke(context, run.arrays.reference, theme.muted, 1.5 * px, [6 * px, 4 * px]);
  drawTrajectory(context, run, t, shown, theme, px);
  stroke(context, points("plan"), theme.goal, 1.8 * px);
  stroke(context, points("horizon"), theme.horizon, 2.6 * px);
  drawDots(context, points("particles"), theme.belief, 2 * px);
  drawDots(context, points("scan"), theme.ink, 2.4 * px);
  for (const [x, y] of run.header.goals) {
    placed(context, x, y, Math.PI / 4, () =>
      fill(context, () => context.rect(-4 * px, -4 * px, 8 * px, 8 * px), theme.goal),
    );
    stroke(context, null, theme.panel, px);
  }
  drawRobot(context, run, run.pose(t), theme.panel, theme.ink, px);
  if (shown.has("belief")) drawRobot(context, run, run.pose(t, true), theme.belief, "", 1.8 * px);
  for (const { x_m: x, y_m: y, t_s } of shown.has("contacts") ? run.contacts : []) {
    const [r, there] = [5 * px, t_s <= t + 1e-6];
    const cross = [x - r, y - r, x + r, y + r, x, y, x - r, y + r, x + r, y - r];
    if (there) stroke(context, cross, theme.panel, 5 * px);
    if (there) stroke(context, null, theme.fail, 2.5 * px);
  }
}

/** Draw in the frame of a place. */
function placed(context, x, y, yaw, draw) {
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  draw();
  context.restore();
}

/** Stroke a line of x, y, x, y …; null for the last path. */
function stroke(context, xy, color, width, dashes = []) {
  if (xy) context.beginPath();
  for (let k = 0; xy && k < xy.length; k += 2) context.lineTo(xy[k], xy[k + 1]);
  context.setLineDash(dashes);
  context.strokeStyle = color;
  context.lineWidth = width;
  context.stroke();
}

function fill(context, path, color) {
  context.beginPath();
  path();
  context.closePath();
  context.fillStyle = color;
  context.fill();
}

/** Row 0 is at the lowest y, as y points up here. */
function drawGrid(context, { image, x_m, y_m, yaw_rad, rows, columns, resolution_m }) {
  const size = [columns * resolution_m, rows * resolution_m];
  placed(context, x_m, y_m, yaw_rad, () => context.drawImage(image, 0, 0, ...size));
}

function drawCosts(context, view, name, moment, px) {
  const costs = moment < 0 ? null : view.layers.costs(name, moment);
  if (!costs) return;
  const known = view.costs[name];
  const image = known?.first === costs.first ? known.image : gridImage(name, costs, view.theme);
  view.costs[name] = { first: costs.first, image };
  drawGrid(context, { ...costs, image });
  if (name === "global") return;
  const [width, height] = [costs.columns * costs.resolution_m, costs.rows * costs.resolution_m];
  placed(context, costs.x_m, costs.y_m, costs.yaw_rad, () =>
    stroke(context, [0, 0, width, 0, width, height, 0, height, 0, 0], view.theme.belief, px, [4 * px, 3 * px]),
  );
}

function drawObstacle(context, { shape, length_m, width_m, x, y, yaw }, theme, px) {
  placed(context, x, y, yaw, () => {
    context.globalAlpha = 0.6;
    const outline = () =>
      shape === "cylinder"
        ? context.arc(0, 0, length_m / 2, 0, TURN)
        : context.rect(-length_m / 2, -width_m / 2, length_m, width_m);
    fill(context, outline, theme.obstacle);
    context.globalAlpha = 1;
    stroke(context, null, theme["obstacle-edge"], 1.2 * px);
  });
}

function drawTrajectory(context, run, t, shown, theme, px) {
  const { row } = run.between(t);
  const line = (first, end, believed) => {
    const [xs, ys] = ["x_mm", "y_mm"].map((name) => run.columns[believed ? `estimated_${name}` : name]);
    const { x, y } = run.pose(t, believed);
    const xy = first ? [x, y] : [];
    for (let k = first; k < end; k += 1) xy.push(xs[k], ys[k]);
    return first ? xy : [...xy, x, y];
  };
  if (shown.has("future")) stroke(context, line(row + 1, run.t.length), theme.muted, px, [2 * px, 3 * px]);
  if (shown.has("belief")) stroke(context, line(0, row + 1, true), theme.belief, px, [4 * px, 2 * px]);
  if (shown.has("past")) stroke(context, line(0, row + 1), theme[verdictOf(run.header.judgement).color], 2 * px);
}

function drawDots(context, xy, color, edge) {
  context.fillStyle = color;
  for (let k = 0; k < xy.length; k += 2) context.fillRect(xy[k] - edge / 2, xy[k + 1] - edge / 2, edge, edge);
}

function drawRobot(context, run, { x, y, yaw }, edge, inside, width) {
  const { radius_m, vertices } = run.header.robot;
  placed(context, x, y, yaw, () => {
    const outline = () =>
      vertices.length ? vertices.forEach((each) => context.lineTo(...each)) : context.arc(0, 0, radius_m, 0, TURN);
    fill(context, outline, inside || "transparent");
    stroke(context, null, edge, width);
    stroke(context, [0, 0, radius_m, 0], edge, inside ? 2 * width : width);
  });
}
