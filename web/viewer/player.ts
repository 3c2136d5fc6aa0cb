// Play a run: load it until it has ended, and show it at the moment being played.

import { NO_VISIT, type SwarmSource, type SwarmView } from "../client";
import { type Line, Run } from "./run";

const TICK_MS = 50;
const AGAIN_MS = 1000;
export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 32] as const;

/** State of the controls. */
export interface Moment {
  readonly t_s: number;
  readonly playing: boolean;
  readonly speed: number;
  readonly away: boolean;
}

export class Player implements SwarmSource {
  readonly run = new Run();
  readonly #listeners = new Set<() => void>();
  #moment: Moment;
  #view: SwarmView = { swarm: this.run.swarmAt(0, 1, 0), health: { state: "connecting", broker: "away" }, visit: NO_VISIT };
  #before_ms = performance.now();

  /** `paused`: start paused, for users who prefer reduced motion. */
  constructor(paused: boolean) {
    this.#moment = { t_s: 0, playing: !paused, speed: 1, away: false };
    setInterval(() => this.#tick(), TICK_MS);
    void this.#load();
  }

  get view(): SwarmView {
    return this.#view;
  }

  get moment(): Moment {
    return this.#moment;
  }

  readonly subscribe = (listener: () => void): (() => void) => {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  };

  change(to: Partial<Moment>): void {
    this.#moment = { ...this.#moment, ...to };
    this.#show();
  }

  /** Play or pause; at the end, play from the start. */
  toggle(): void {
    const { t_s, playing } = this.#moment;
    this.change({ playing: !playing, ...(!playing && t_s >= this.run.end_s && { t_s: 0 }) });
  }

  #tick(): void {
    const now_ms = performance.now();
    const passed_s = (now_ms - this.#before_ms) / 1000;
    this.#before_ms = now_ms;
    const { t_s, playing, speed } = this.#moment;
    if (playing) {
      const t = Math.min(t_s + passed_s * speed, this.run.end_s);
      this.#moment = { ...this.#moment, t_s: t, playing: !(this.run.ended && t >= this.run.end_s) };
    }
    // Also while paused: the map counts down tokens by the clock.
    this.#show();
  }

  #show(): void {
    const { t_s, speed } = this.#moment;
    this.#view = { swarm: this.run.swarmAt(t_s, speed, performance.now()), health: { state: "live" }, visit: NO_VISIT };
    for (const listener of this.#listeners) listener();
  }

  async #load(): Promise<void> {
    let [had, run] = [0, ""];
    while (!this.run.ended) {
      let lines: Line[];
      try {
        const answer = await fetch(`/api/run?from=${had}&run=${run}`, { cache: "no-store" });
        // Another run is served there now: the two are not mixed.
        if (answer.status === 409) {
          location.reload();
          return;
        }
        if (!answer.ok) throw new Error(answer.statusText);
        run = answer.headers.get("Run") ?? "";
        lines = (await answer.text()).split("\n").slice(0, -1).map((line) => JSON.parse(line) as Line);
      } catch {
        this.change({ away: true });
        await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
        continue;
      }
      had += lines.length;
      this.run.add(lines);
      if (this.#moment.away) this.change({ away: false });
    }
  }
}
