/** One moment of a run on its map, in meters; y points up. */

import { costImage } from "./player_images.js";
import { VERDICTS } from "./player_theme.js";

const FULL_TURN = 2 * Math.PI;

/**
 * Draw the layers that are shown.
 * @param {CanvasRenderingContext2D} context Its transform is from meters.
 * @param {import("./player_map.js").MapView} view
 * @param {number} t
 * @param {Set<string>} shown
 * @param {number} px Meters of a pixel.
 */
export function drawMoment(context, view, t, shown, px) {
  const { run, layers, theme } = view;
  const moment = layers ? layers.moment(t) : -1;
  const draws = (name) => shown.has(name) && moment >= 0;
  context.imageSmoothingEnabled = false;
  context.lineJoin = context.lineCap = "round";
  for (const grid of view.images.filter((each) => each.kind === "map")) image(context, grid, grid.image);
  if (draws("global")) costs(context, view, "global", moment);
  for (const grid of view.images.filter((each) => each.kind !== "map")) image(context, grid, grid.image);
  if (draws("local")) costs(context, view, "local", moment, px);
  if (shown.has("obstacles")) for (const each of run.obstacles(t)) obstacle(context, each, theme, px);
  if (shown.has("reference")) line(context, run.arrays.reference, theme.reference, 1.5 * px, [6 * px, 4 * px]);
  trajectory(context, run, t, shown, theme, px);
  if (draws("plan")) points(context, layers.points("plan", moment), theme.plan, 1.8 * px);
  if (draws("horizon")) points(context, layers.points("horizon", moment), theme.horizon, 2.6 * px);
  if (draws("particles")) dots(context, layers.points("particles", moment), theme.belief, 1.6 * px, px);
  if (draws("scan")) dots(context, layers.points("scan", moment), theme.scan, 2.4 * px, px);
  if (shown.has("contacts")) for (const event of run.contacts) if (event.t_s <= t + 1e-6) cross(context, event, theme, px);
  run.header.goals.forEach((goal) => diamond(context, goal[0], goal[1], 6 * px, theme.goal, theme.panel));
  robot(context, run, t, shown, theme, px);
}

function image(context, grid, picture) {
  context.save();
  context.translate(grid.x_m, grid.y_m);
  context.rotate(grid.yaw_rad);
  // Row 0 is at the lowest y, as y points up here.
  context.drawImage(picture, 0, 0, grid.columns * grid.resolution_m, grid.rows * grid.resolution_m);
  context.restore();
}

function costs(context, view, name, moment, px) {
  const found = view.layers.costs(name, moment);
  if (!found) return;
  if (view.costs[name]?.first !== found.first) {
    view.costs[name] = { first: found.first, image: costImage(name, found, view.theme) };
  }
  const { rows, columns, x, y, yaw, resolution } = found;
  const grid = { x_m: x, y_m: y, yaw_rad: yaw, rows, columns, resolution_m: resolution };
  image(context, grid, view.costs[name].image);
  if (name !== "local") return;
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  context.setLineDash([4 * px, 3 * px]);
  context.strokeStyle = view.theme.belief;
  context.lineWidth = px;
  context.strokeRect(0, 0, columns * resolution, rows * resolution);
  context.restore();
}

function obstacle(context, { obstacle: { shape, length_m, width_m }, x, y, yaw }, theme, px) {
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  context.beginPath();
  if (shape === "cylinder") context.arc(0, 0, length_m / 2, 0, FULL_TURN);
  else context.rect(-length_m / 2, -width_m / 2, length_m, width_m);
  context.globalAlpha = 0.6;
  context.fillStyle = theme.obstacle;
  context.fill();
  context.globalAlpha = 1;
  context.strokeStyle = theme["obstacle-edge"];
  context.lineWidth = 1.2 * px;
  context.stroke();
  context.restore();
}

function trajectory(context, run, t, shown, theme, px) {
  const row = run.row(t);
  const { x_mm, y_mm, estimated_x_mm, estimated_y_mm } = run.columns;
  const now = run.pose(t);
  if (shown.has("future")) path(context, x_mm, y_mm, row + 1, x_mm.length, theme.muted, px, [2 * px, 3 * px], now);
  if (shown.has("belief")) {
    const believed = run.pose(t, true);
    path(context, estimated_x_mm, estimated_y_mm, 0, row + 1, theme.belief, px, [4 * px, 2 * px], null, believed);
  }
  const [color] = VERDICTS[run.header.judgement];
  if (shown.has("past")) path(context, x_mm, y_mm, 0, row + 1, theme[color], 2 * px, [], null, now);
}

function path(context, xs, ys, first, end, color, width, dashes, before = null, after = null) {
  context.beginPath();
  if (before) context.moveTo(before.x, before.y);
  for (let k = first; k < end; k += 1) context.lineTo(xs[k], ys[k]);
  if (after) context.lineTo(after.x, after.y);
  stroke(context, color, width, dashes);
}

function line(context, xy, color, width, dashes) {
  context.beginPath();
  for (let k = 0; k < xy.length; k += 2) context.lineTo(xy[k], xy[k + 1]);
  stroke(context, color, width, dashes);
}

function points(context, { units, x, y, size }, color, width) {
  context.beginPath();
  for (let k = 0; k < units.length; k += 2) context.lineTo(x + size * units[k], y + size * units[k + 1]);
  stroke(context, color, width, []);
}

function stroke(context, color, width, dashes) {
  context.setLineDash(dashes);
  context.strokeStyle = color;
  context.lineWidth = width;
  context.stroke();
  context.setLineDash([]);
}

function dots(context, { units, x, y, size }, color, width, px) {
  const edge = Math.max(width, 2 * px);
  context.fillStyle = color;
  for (let k = 0; k < units.length; k += 2) {
    context.fillRect(x + size * units[k] - edge / 2, y + size * units[k + 1] - edge / 2, edge, edge);
  }
}

function cross(context, { x_m, y_m }, theme, px) {
  const reach = 5 * px;
  for (const [color, width] of [
    [theme.panel, 4.5 * px],
    [theme.fail, 2.5 * px],
  ]) {
    context.beginPath();
    context.moveTo(x_m - reach, y_m - reach);
    context.lineTo(x_m + reach, y_m + reach);
    context.moveTo(x_m - reach, y_m + reach);
    context.lineTo(x_m + reach, y_m - reach);
    stroke(context, color, width, []);
  }
}

function diamond(context, x, y, reach, fill, edge) {
  context.beginPath();
  context.moveTo(x + reach, y);
  context.lineTo(x, y + reach);
  context.lineTo(x - reach, y);
  context.lineTo(x, y - reach);
  context.closePath();
  context.fillStyle = fill;
  context.fill();
  stroke(context, edge, reach / 6, []);
}

function robot(context, run, t, shown, theme, px) {
  const { radius_m, vertices } = run.header.robot;
  const outline = (pose) => {
    context.save();
    context.translate(pose.x, pose.y);
    context.rotate(pose.yaw);
    context.beginPath();
    if (vertices.length) vertices.forEach(([x, y]) => context.lineTo(x, y));
    else context.arc(0, 0, radius_m, 0, FULL_TURN);
    context.closePath();
    context.restore();
  };
  const heading = (pose, color, width) => {
    context.beginPath();
    context.moveTo(pose.x, pose.y);
    context.lineTo(pose.x + radius_m * Math.cos(pose.yaw), pose.y + radius_m * Math.sin(pose.yaw));
    stroke(context, color, width, []);
  };
  const pose = run.pose(t);
  outline(pose);
  context.fillStyle = theme.ink;
  context.fill();
  stroke(context, theme.panel, px, []);
  heading(pose, theme.panel, 2 * px);
  if (!shown.has("belief")) return;
  const believed = run.pose(t, true);
  outline(believed);
  stroke(context, theme.belief, 1.8 * px, []);
  heading(believed, theme.belief, 1.5 * px);
}
