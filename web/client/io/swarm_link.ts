// A connection that maintains the swarm's state: it sends requests when needed, and notifies listeners of changes.

import type { Json } from "../core/json";
import { Lately } from "../lately";
import {
  NO_SWARM,
  REQUEST_AREA,
  REQUEST_LIT,
  REQUEST_ROBOTS,
  REQUEST_WALLS,
  type Swarm,
  type SwarmAction,
  swarmReducer,
} from "../swarm";
import { NO_VISIT, type Visit } from "../visit";
import { type Health, Watch } from "../watch";
import type { Transport, TransportEvent } from "./transport";

/** The known state. A new object whenever a part of it changed. */
export interface SwarmView {
  readonly swarm: Swarm;
  readonly health: Health;
  readonly visit: Visit;
}

/** A source of the swarm's current state. */
export interface SwarmSource {
  readonly view: SwarmView;
  /** Call `listener` when `view` changes; call the result to unsubscribe. */
  subscribe(listener: () => void): () => void;
}

const TICK_MS = 100;
/** A working connection answers within this time. */
const WAKE_MS = 3000;
/** Walls do not change. */
const WALLS_AGAIN_MS = 5000;
// Messages on their way when the network was lost arrive within this time.
const NETWORK_LAG_MS = 2000;

export class SwarmLink<T extends Transport = Transport> implements SwarmSource {
  readonly transport: T;
  readonly #watch = new Watch(performance.now());
  readonly #lately = new Lately();
  readonly #listeners = new Set<() => void>();
  readonly #ticking: ReturnType<typeof setInterval>;
  #waking: ReturnType<typeof setTimeout> | undefined;
  #heardAt_ms = 0;
  #networkAt_ms = performance.now(); // when the device last reported a network
  #needsNoNetwork = false;
  #wallsAskedAt_ms = Number.NEGATIVE_INFINITY;
  #view: SwarmView = { swarm: NO_SWARM, health: { state: "connecting", broker: "away" }, visit: NO_VISIT };

  /** Closes the transport with itself. */
  constructor(transport: T) {
    this.transport = transport;
    transport.listen((event) => this.#on(event));
    // Events from before this listener was added.
    this.#on({ kind: "visit", visit: transport.visit });
    if (transport.state !== "connecting") this.#on({ kind: "broker", state: transport.state });
    this.#ticking = setInterval(() => this.#tick(), TICK_MS);
  }

  get view(): SwarmView {
    return this.#view;
  }

  subscribe(listener: () => void): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Send one robot a command; return false if disconnected: nothing is queued. */
  command(address: string, name: string, payload: unknown): boolean {
    const sent = this.transport.command(address, name, payload);
    if (sent && name === "clear_position_history") this.#reduce({ kind: "history_cleared", address });
    return sent;
  }

  /** Return the data of the answer. @throws Unanswered (the promise) */
  request(request: number, timeout_ms?: number): Promise<Json> {
    return this.transport.request(request, timeout_ms);
  }

  /**
   * The phone was asleep, or the page in the background: request missed state at once.
   *
   * A connection that died meanwhile can look alive until the next keepalive, up to 90 s; silence now counts as dead.
   */
  wake(): void {
    this.transport.wake();
    const woke_ms = performance.now();
    this.#watch.missed(woke_ms, 0);
    clearTimeout(this.#waking);
    this.#waking = setTimeout(() => {
      if (this.#heardAt_ms < woke_ms) this.transport.restart();
    }, WAKE_MS);
  }

  /** The page is hidden, and may be frozen at once. */
  hide(): void {
    this.transport.hide();
  }

  /** The page is being closed. */
  leave(): void {
    this.transport.leave();
  }

  close(): void {
    clearInterval(this.#ticking);
    clearTimeout(this.#waking);
    this.#listeners.clear();
    this.transport.close();
  }

  #on(event: TransportEvent): void {
    const now_ms = performance.now();
    if (event.kind !== "broker" && event.kind !== "visit") this.#heardAt_ms = now_ms;
    switch (event.kind) {
      case "visit":
        this.#show({ ...this.#view, visit: event.visit });
        return;
      case "broker":
        this.#watch.broker(event.state, now_ms, Math.random());
        if (event.state === "online") this.#reduce({ kind: "reconnected" });
        this.#lately.forget();
        this.#tick();
        return;
      case "rejected":
        return;
      default:
        this.#watch.heard(now_ms);
        if (event.kind === "notified") {
          this.#reduce({ ...event, at_ms: now_ms });
          if (this.#view.swarm.seq !== undefined) this.#watch.framed();
          this.#lately.heard(event.payload, now_ms);
        } else if (event.request === REQUEST_ROBOTS) {
          this.#watch.answered();
          const { said, cut } = this.#lately.tell();
          this.#reduce({ ...event, at_ms: now_ms, said });
          if (cut) this.#watch.missed(now_ms, Math.random());
        } else {
          this.#reduce({ ...event, at_ms: now_ms });
        }
    }
  }

  #reduce(action: SwarmAction): void {
    const swarm = swarmReducer(this.#view.swarm, action);
    if (swarm.missed !== this.#view.swarm.missed) {
      this.#watch.missed(performance.now(), Math.random());
      this.#lately.forget();
    }
    if (swarm !== this.#view.swarm) this.#show({ ...this.#view, swarm });
  }

  #tick(): void {
    const now_ms = performance.now();
    if (this.#watch.due(now_ms, Math.random())) {
      this.#ask(REQUEST_ROBOTS);
      if (!this.#view.swarm.areaTold) this.#ask(REQUEST_AREA);
      if (this.#view.swarm.missions) this.#ask(REQUEST_LIT);
    }
    this.#askForWalls(now_ms);
    const health = this.#watch.health(now_ms, this.#hasNetwork(now_ms));
    if (JSON.stringify(health) !== JSON.stringify(this.#view.health)) this.#show({ ...this.#view, health });
  }

  /** Whether silence can have other causes than the device's network. */
  #hasNetwork(now_ms: number): boolean {
    if (hasNetwork()) this.#networkAt_ms = now_ms;
    // Data long after the network was lost does not need it: a broker on this machine.
    else if (this.#heardAt_ms - this.#networkAt_ms > NETWORK_LAG_MS) this.#needsNoNetwork = true;
    return this.#networkAt_ms === now_ms || this.#needsNoNetwork;
  }

  #askForWalls(now_ms: number): void {
    const { missions } = this.#view.swarm;
    if (!missions || missions.walls || now_ms - this.#wallsAskedAt_ms < WALLS_AGAIN_MS) return;
    this.#wallsAskedAt_ms = now_ms;
    this.#ask(REQUEST_WALLS);
    this.#ask(REQUEST_LIT);
  }

  #ask(request: number): void {
    // The answer also arrives as an event; the watch notices if none arrives.
    this.request(request).catch(() => {});
  }

  #show(view: SwarmView): void {
    this.#view = view;
    for (const listener of this.#listeners) listener();
  }
}

/** Programs without a browser do not report a network. */
function hasNetwork(): boolean {
  const { navigator } = globalThis as { readonly navigator?: { readonly onLine?: boolean } };
  return navigator?.onLine ?? true;
}
