// Draws the scene when something changed or moves; otherwise idle, to save the phone's battery.

import type { Point } from "../client";
import { Motion } from "./motion";
import { Names } from "./names";
import type { Pinch } from "./gesture";
import { fitArea, type Projection, toScreen, type Zoom, zoomed } from "./projection";
import { drawGround, drawRobots, rimOf, type Scene, shownRobots } from "./scene";
import { areFlashing } from "./shields";
import { readTheme, type Theme } from "./theme";

/** More pixels per CSS pixel cost time, but are hardly visible. */
const MOST_DENSE = 2;
const MANY = 200;
/** Zoom factor to show a robot that was searched. */
const FOUND_TIMES = 3;
/** Share of the map's width and height that counts as its edge. */
const EDGE_PART = 0.2;
/** Arcs of tokens get shorter by two pixels a second. */
const DRAIN_EVERY_MS = 100;
const DRAIN_EVERY_MS_STILL = 1000;

export class Painter {
  readonly #ground: HTMLCanvasElement;
  readonly #robots: HTMLCanvasElement;
  readonly #motion = new Motion();
  readonly #names = new Names();
  readonly #still = matchMedia("(prefers-reduced-motion: reduce)");
  readonly #dark = matchMedia("(prefers-color-scheme: dark)");
  readonly #resizing: ResizeObserver;
  readonly #onTheme = () => {
    this.#theme = undefined;
    this.#changed();
  };
  #scene: Scene | undefined;
  #theme: Theme | undefined;
  #projection: Projection | undefined;
  #zoom: Zoom | undefined;
  /** The robot that is kept in sight. */
  #followed: string | undefined;
  #width = 0;
  #height = 0;
  #groundIsOld = true;
  #frame: number | undefined;
  #drawnAt_ms = 0;
  #draining: number | undefined;

  constructor(ground: HTMLCanvasElement, robots: HTMLCanvasElement) {
    this.#ground = ground;
    this.#robots = robots;
    this.#resizing = new ResizeObserver(() => this.#resize());
    this.#resizing.observe(ground);
    this.#dark.addEventListener("change", this.#onTheme);
    this.#resize();
  }

  stop(): void {
    this.#resizing.disconnect();
    this.#dark.removeEventListener("change", this.#onTheme);
    if (this.#frame !== undefined) cancelAnimationFrame(this.#frame);
    window.clearTimeout(this.#draining);
  }

  show(scene: Scene): void {
    this.#scene = scene;
    this.#changed();
  }

  get projection(): Projection | undefined {
    return this.#projection;
  }

  /** Apply a part of a gesture; without one, show the whole area. Return whether the map is zoomed. */
  zoom(pinch?: Pinch): boolean {
    this.#zoom = pinch && this.#projection && zoomed(this.#projection, this.#width, this.#height, pinch);
    this.#followed = undefined;
    this.#changed();
    return this.#zoom !== undefined;
  }

  /** Centre a robot, enlarged if the map is crowded, and keep it in sight until the map is moved by hand. */
  find(address: string): boolean {
    const at = this.#scene?.swarm.robots.get(address)?.position;
    if (at) {
      this.#zoom = { times: Math.max(this.#zoom?.times ?? 1, FOUND_TIMES), at };
      this.#followed = address;
      this.#changed();
    }
    return this.#zoom !== undefined;
  }

  get middle(): Point {
    return { x: this.#width / 2, y: this.#height / 2 };
  }

  /** Robots' places on the screen, as drawn. */
  get places(): ReadonlyMap<string, Point> {
    return this.#motion.places;
  }

  #resize(): void {
    const { width, height } = this.#ground.getBoundingClientRect();
    if (width === 0 || height === 0) return;
    const density = Math.min(window.devicePixelRatio || 1, MOST_DENSE);
    for (const canvas of [this.#ground, this.#robots]) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
      canvas.getContext("2d")?.setTransform(density, 0, 0, density, 0, 0);
    }
    this.#width = width;
    this.#height = height;
    this.#changed();
  }

  #changed(): void {
    if (!this.#scene || this.#width === 0) return;
    const { area, robots: known } = this.#scene.swarm;
    const followed = this.#followed === undefined ? undefined : known.get(this.#followed)?.position;
    if (followed && this.#zoom && !this.#isInSight(toScreen(fitArea(area, this.#width, this.#height, this.#zoom), followed))) {
      this.#zoom = { ...this.#zoom, at: followed };
    }
    const projection = fitArea(area, this.#width, this.#height, this.#zoom);
    // After a change of scale old pixels are invalid.
    const before = this.#projection;
    const rescaled =
      projection.scale !== before?.scale || projection.left !== before.left || projection.top !== before.top;
    this.#projection = projection;
    const places = new Map<string, Point>();
    for (const robot of shownRobots(this.#scene.swarm)) {
      if (robot.position) places.set(robot.address, toScreen(projection, robot.position));
    }
    this.#motion.aim(places, this.#still.matches || rescaled);
    this.#groundIsOld = true;
    this.#drawSoon();
  }

  /** Not near the edge: moving the map with each step of a robot would be hard to watch. */
  #isInSight({ x, y }: Point): boolean {
    const [across, down] = [x / this.#width, y / this.#height];
    return Math.min(across, down) > EDGE_PART && Math.max(across, down) < 1 - EDGE_PART;
  }

  #drawSoon(): void {
    this.#frame ??= requestAnimationFrame((now_ms) => this.#draw(now_ms));
  }

  #draw(now_ms: number): void {
    this.#frame = undefined;
    const [ground, robots] = [this.#ground.getContext("2d"), this.#robots.getContext("2d")];
    if (!this.#scene || !this.#projection || !ground || !robots) return;
    // Large swarms are drawn at half the screen's rate, which is hardly visible.
    if (this.#motion.places.size > MANY && now_ms - this.#drawnAt_ms < 25) {
      this.#drawSoon();
      return;
    }
    this.#theme ??= readTheme(this.#ground);
    // After a pause the first step is one frame long.
    const moving = this.#motion.advance(Math.min(now_ms - this.#drawnAt_ms, 50));
    this.#drawnAt_ms = now_ms;
    if (this.#groundIsOld) {
      ground.clearRect(0, 0, this.#width, this.#height);
      drawGround(ground, this.#projection, this.#theme, this.#scene);
      this.#groundIsOld = false;
    }
    robots.clearRect(0, 0, this.#width, this.#height);
    const { swarm } = this.#scene;
    const still = this.#still.matches;
    drawRobots(robots, this.#projection, this.#theme, this.#scene, this.#motion.places, now_ms, still);
    const shown = shownRobots(swarm);
    const rim = rimOf(this.#projection, swarm, shown.length);
    const room = { width: this.#width, height: this.#height, buttons: this.#scene.buttons };
    const { selected } = this.#scene;
    this.#names.draw(robots, this.#projection, this.#theme, shown, this.#motion.places, rim, selected, room);
    window.clearTimeout(this.#draining);
    if (moving || (!still && areFlashing(swarm.audits, now_ms))) this.#drawSoon();
    else if (swarm.terms) {
      const wait_ms = still ? DRAIN_EVERY_MS_STILL : DRAIN_EVERY_MS;
      this.#draining = window.setTimeout(() => this.#drawSoon(), wait_ms);
    }
  }
}
