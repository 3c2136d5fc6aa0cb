// Draw the map on two canvases: the lower one (grid, trails, routes) changes at most ten times a second, the upper one has
// moving robots with their names (names.ts), and the route being drawn.

import { INACTIVE, LOST, type Point, type Rgb, type Robot, type Swarm } from "../client";
import { drawLit, drawWalls } from "./building";
import { circle } from "./circle";
import { drawPattern, type Mark, markOf } from "./marks";
import { gridStep, type Projection, toScreen } from "./projection";
import { crossOut, drawAudits, drawShields, RING_OFF_PX } from "./shields";
import type { Theme } from "./theme";

export interface Scene {
  readonly swarm: Swarm;
  readonly selected: string | undefined;
  /** The route being drawn, not yet sent. */
  readonly draft: readonly Point[];
  readonly threshold: number;
  /** Keyboard cursor for waypoints. */
  readonly cursor: Point | undefined;
  /** Whether robots show their marks; otherwise only their lights. */
  readonly marked: boolean;
  /** Number of buttons on the map. */
  readonly buttons: number;
}

/** Trails of robots that are not selected are short: 200 long ones are unreadable, and slow on a phone. */
const TRAIL_OF_FEW = 60;
const TRAIL_OF_MANY = 15;
/** Up to this number, robots are few. */
const FEW = 30;
const ROBOT_MM = 60;
const LEAST_RADIUS = 5;
/** Few robots are drawn larger than to scale, for thumbs. */
const LEAST_RADIUS_OF_FEW = 7.5;
/** On large maps robots are drawn to scale, up to this radius. */
const MOST_RADIUS = 20;
const THING_PX = 9;
const TURN = 2 * Math.PI;

export function shownRobots(swarm: Swarm): Robot[] {
  // A stopped robot is silent, but remains visible.
  return [...swarm.robots.values()].filter((robot) => robot.position && (robot.status !== LOST || isStopped(robot)));
}

export function robotRadius({ scale }: Projection, robots: number): number {
  const least = robots <= FEW ? LEAST_RADIUS_OF_FEW : LEAST_RADIUS;
  return Math.min(Math.max(ROBOT_MM * scale, least), MOST_RADIUS);
}

/** Radius of a robot with its rings. */
export function rimOf(p: Projection, { terms }: Swarm, robots: number): number {
  return robotRadius(p, robots) + (terms ? RING_OFF_PX + 2 : 0);
}

function isStopped({ shield }: Robot): boolean {
  return shield?.safeMode === true;
}

/** The look of a robot's disc: its mark, with a rim in the colour of its light. */
interface Look {
  readonly rim: string;
  readonly mark: Mark | undefined;
}

function lookOf(robot: Robot, theme: Theme, marked: boolean): Look {
  const isMarked = marked && robot.number !== undefined && !isStopped(robot);
  return { rim: isStopped(robot) ? theme.unlit : ledColour(robot.led, theme), mark: isMarked ? markOf(robot.number) : undefined };
}

function trailColour(robot: Robot, theme: Theme, marked: boolean): string {
  return marked && robot.number !== undefined ? markOf(robot.number).colour : ledColour(robot.led, theme);
}

function alphaOf(robot: Robot): number {
  return robot.status === INACTIVE && !isStopped(robot) ? 0.35 : 1;
}

/** The colour of a disc. A dark LED is drawn as unlit, or it would look like a hole in a dark map. */
export function ledColour(led: Rgb | undefined, theme: Theme): string {
  if (!led || Math.max(led.red, led.green, led.blue) < 24) return theme.unlit;
  return `rgb(${led.red} ${led.green} ${led.blue})`;
}

export function drawGround(ctx: CanvasRenderingContext2D, p: Projection, theme: Theme, scene: Scene): void {
  const { area, scale, left, top } = p;
  ctx.fillStyle = theme.ground;
  ctx.beginPath();
  ctx.roundRect(left, top, area.width * scale, area.height * scale, 6);
  ctx.fill();
  drawGrid(ctx, p, theme);
  const { missions } = scene.swarm;
  if (missions) {
    drawWalls(ctx, p, theme, missions.walls ?? []);
    drawLit(ctx, p, theme, missions);
  }
  drawThings(ctx, p, theme, scene.swarm.work?.things ?? []);
  const robots = shownRobots(scene.swarm);
  const short = robots.length <= FEW ? TRAIL_OF_FEW : robots.length <= 200 ? TRAIL_OF_MANY : 0;
  for (const robot of short > 0 ? robots : []) {
    if (robot.address !== scene.selected) drawTrail(ctx, p, robot, short, trailColour(robot, theme, scene.marked), 0.35);
  }
  const selected = scene.selected === undefined ? undefined : scene.swarm.robots.get(scene.selected);
  if (selected?.position) {
    drawTrail(ctx, p, selected, selected.trail.length, trailColour(selected, theme, scene.marked), 0.8);
    drawRoute(ctx, p, theme, selected.waypoints, selected.threshold, false);
  }
  if (scene.cursor) drawCursor(ctx, toScreen(p, scene.cursor), theme);
}

/** Objects of the robots' task, as diamonds, unlike robots. */
function drawThings(ctx: CanvasRenderingContext2D, p: Projection, theme: Theme, things: readonly Point[]): void {
  ctx.fillStyle = theme.bad;
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 1.5;
  for (const thing of things) {
    const { x, y } = toScreen(p, thing);
    ctx.beginPath();
    ctx.moveTo(x, y - THING_PX);
    ctx.lineTo(x + THING_PX, y);
    ctx.lineTo(x, y + THING_PX);
    ctx.lineTo(x - THING_PX, y);
    ctx.closePath();
    ctx.fill();
    ctx.stroke();
  }
}

function drawGrid(ctx: CanvasRenderingContext2D, { area, scale, left, top }: Projection, theme: Theme): void {
  const step = gridStep(area);
  ctx.strokeStyle = theme.grid;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let x = step; x < area.width - step / 100; x += step) {
    ctx.moveTo(left + x * scale, top);
    ctx.lineTo(left + x * scale, top + area.height * scale);
  }
  for (let y = step; y < area.height - step / 100; y += step) {
    ctx.moveTo(left, top + y * scale);
    ctx.lineTo(left + area.width * scale, top + y * scale);
  }
  ctx.stroke();
  ctx.strokeStyle = theme.edge;
  ctx.beginPath();
  ctx.roundRect(left, top, area.width * scale, area.height * scale, 6);
  ctx.stroke();
}

function drawTrail(
  ctx: CanvasRenderingContext2D,
  { scale, left, top }: Projection,
  { trail, position }: Robot,
  most: number,
  colour: string,
  alpha: number,
): void {
  if (trail.length < 1 || !position) return;
  ctx.globalAlpha = alpha;
  ctx.strokeStyle = colour;
  ctx.lineWidth = 2;
  ctx.lineJoin = "round";
  ctx.beginPath();
  const first = Math.max(0, trail.length - most);
  ctx.moveTo(left + trail.x(first) * scale, top + trail.y(first) * scale);
  for (let i = first + 1; i < trail.length; i += 1) ctx.lineTo(left + trail.x(i) * scale, top + trail.y(i) * scale);
  ctx.lineTo(left + position.x * scale, top + position.y * scale);
  ctx.stroke();
  ctx.globalAlpha = 1;
}

/** The first point is the robot's place at the start, not a waypoint. */
function drawRoute(
  ctx: CanvasRenderingContext2D,
  p: Projection,
  theme: Theme,
  points: readonly Point[],
  threshold: number,
  isDraft: boolean,
): void {
  const [start, ...waypoints] = points.map((point) => toScreen(p, point));
  if (!start || waypoints.length === 0) return;
  const reach = Math.max(threshold * p.scale, 2);
  ctx.strokeStyle = theme.accent;
  ctx.fillStyle = theme.accent;
  ctx.globalAlpha = 0.16;
  for (const { x, y } of waypoints) {
    circle(ctx, x, y, reach);
    ctx.fill();
  }
  ctx.globalAlpha = 0.9;
  ctx.lineWidth = 2;
  ctx.setLineDash(isDraft ? [3, 6] : [8, 5]);
  ctx.beginPath();
  ctx.moveTo(start.x, start.y);
  for (const { x, y } of waypoints) ctx.lineTo(x, y);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.lineWidth = 1.5;
  for (const { x, y } of waypoints) {
    circle(ctx, x, y, reach);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
  ctx.font = "600 11px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  waypoints.forEach(({ x, y }, i) => {
    ctx.fillStyle = theme.accent;
    circle(ctx, x, y, 8);
    ctx.fill();
    ctx.fillStyle = theme.ground;
    ctx.fillText(String(i + 1), x, y + 0.5);
  });
}

function drawCursor(ctx: CanvasRenderingContext2D, { x, y }: Point, theme: Theme): void {
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x - 12, y);
  ctx.lineTo(x + 12, y);
  ctx.moveTo(x, y - 12);
  ctx.lineTo(x, y + 12);
  ctx.stroke();
}

/** `places` are pixels, interpolated. `still`: nothing fades. */
export function drawRobots(
  ctx: CanvasRenderingContext2D,
  p: Projection,
  theme: Theme,
  scene: Scene,
  places: ReadonlyMap<string, Point>,
  now_ms: number,
  still: boolean,
): void {
  const { terms, audits } = scene.swarm;
  const robots = shownRobots(scene.swarm);
  const radius = robotRadius(p, robots.length);
  const rim = rimOf(p, scene.swarm, robots.length);
  drawAudits(ctx, theme, audits, places, radius, now_ms, still);
  if (terms) drawShields(ctx, theme, terms, robots, places, radius, now_ms);
  if (robots.length > FEW) drawMany(ctx, theme, scene, robots, places, radius);
  else {
    for (const robot of robots) {
      const place = places.get(robot.address);
      if (place && robot.address !== scene.selected) drawRobot(ctx, theme, robot, place, radius, scene.marked);
    }
  }
  const stopped = robots.filter(isStopped);
  crossOut(ctx, theme, stopped, places, radius);
  const selected = robots.find((robot) => robot.address === scene.selected);
  const place = selected && places.get(selected.address);
  if (!selected || !place) return;
  // Drawn last: among a hundred robots a new point could be hidden.
  if (selected.position) drawRoute(ctx, p, theme, [selected.position, ...scene.draft], scene.threshold, true);
  const larger = Math.max(radius, LEAST_RADIUS_OF_FEW);
  drawHalo(ctx, theme, place, rim + larger - radius + 6);
  drawRobot(ctx, theme, selected, place, terms ? larger : larger + 1, scene.marked);
  if (isStopped(selected)) crossOut(ctx, theme, [selected], places, radius);
}

/** Ring around the chosen robot: light on wide dark or the reverse, to stand out in a crowd. */
function drawHalo(ctx: CanvasRenderingContext2D, theme: Theme, { x, y }: Point, radius: number): void {
  for (const [colour, width] of [
    [theme.halo, 9],
    [theme.accent, 4],
  ] as const) {
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    circle(ctx, x, y, radius);
    ctx.stroke();
  }
}

/** Noses in one path and discs as bitmaps: a thousand separate paths take longer than a frame on a phone. */
function drawMany(
  ctx: CanvasRenderingContext2D,
  theme: Theme,
  scene: Scene,
  robots: readonly Robot[],
  places: ReadonlyMap<string, Point>,
  radius: number,
): void {
  ctx.fillStyle = theme.ink;
  ctx.beginPath();
  for (const robot of robots) {
    const place = places.get(robot.address);
    if (!place || robot.direction === undefined || robot.address === scene.selected) continue;
    const { x, y } = place;
    const angle = (robot.direction * TURN) / 360;
    const [noseX, noseY] = [-Math.sin(angle), Math.cos(angle)];
    ctx.moveTo(x + noseX * radius * 1.75, y + noseY * radius * 1.75);
    ctx.lineTo(x + noseY * radius * 0.72, y - noseX * radius * 0.72);
    ctx.lineTo(x - noseY * radius * 0.72, y + noseX * radius * 0.72);
  }
  ctx.fill();
  const half = radius + 1;
  for (const robot of robots) {
    const place = places.get(robot.address);
    if (!place || robot.address === scene.selected) continue;
    ctx.globalAlpha = alphaOf(robot);
    const stamped = stamp(lookOf(robot, theme, scene.marked), theme.ink, radius);
    ctx.drawImage(stamped, place.x - half, place.y - half, 2 * half, 2 * half);
  }
  ctx.globalAlpha = 1;
}

const stamps = new Map<string, HTMLCanvasElement>();
const MOST_STAMPS = 512;

function stamp(look: Look, ink: string, radius: number): HTMLCanvasElement {
  const key = `${look.rim} ${look.mark?.colour} ${look.mark?.pattern} ${ink} ${radius}`;
  const known = stamps.get(key);
  if (known) return known;
  if (stamps.size >= MOST_STAMPS) stamps.clear();
  const made = document.createElement("canvas");
  const density = Math.min(window.devicePixelRatio || 1, 2);
  made.width = made.height = Math.ceil(2 * (radius + 1) * density);
  const ctx = made.getContext("2d");
  if (ctx) {
    ctx.scale(density, density);
    drawDisc(ctx, look, ink, radius + 1, radius + 1, radius);
  }
  stamps.set(key, made);
  return made;
}

function drawRobot(
  ctx: CanvasRenderingContext2D,
  theme: Theme,
  robot: Robot,
  { x, y }: Point,
  radius: number,
  marked: boolean,
): void {
  ctx.globalAlpha = alphaOf(robot);
  if (robot.direction !== undefined) {
    // 0 faces +y and degrees turn clockwise on the screen: the nose points to (-sin, cos).
    const angle = (robot.direction * TURN) / 360;
    const [noseX, noseY] = [-Math.sin(angle), Math.cos(angle)];
    const tip = radius * 1.75;
    ctx.fillStyle = theme.ink;
    ctx.beginPath();
    ctx.moveTo(x + noseX * tip, y + noseY * tip);
    ctx.lineTo(x + noseY * radius * 0.72, y - noseX * radius * 0.72);
    ctx.lineTo(x - noseY * radius * 0.72, y + noseX * radius * 0.72);
    ctx.fill();
  }
  drawDisc(ctx, lookOf(robot, theme, marked), theme.ink, x, y, radius);
  ctx.globalAlpha = 1;
}

function drawDisc(ctx: CanvasRenderingContext2D, { rim, mark }: Look, ink: string, x: number, y: number, radius: number): void {
  ctx.fillStyle = rim;
  ctx.strokeStyle = ink;
  ctx.lineWidth = 1.5;
  circle(ctx, x, y, radius);
  ctx.fill();
  ctx.stroke();
  if (!mark) return;
  const inner = 0.76 * radius;
  ctx.fillStyle = mark.colour;
  circle(ctx, x, y, inner);
  ctx.fill();
  drawPattern(ctx, mark, x, y, inner);
}
