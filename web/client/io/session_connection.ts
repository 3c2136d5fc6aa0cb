// A session over a websocket or a broker: connects, joins or resumes, renews keys, and sends commands at a constant rate.
//
// Nothing is queued while disconnected: a late joystick command is worse than none.

import { bytesToHex, randomBytes, utf8ToBytes } from "@noble/hashes/utils.js";
import { PeerError, UsageError } from "../core/errors";
import { type Json, parseJson } from "../core/json";
import { type Reason, type Secret, Session, type SessionEvent, type Where } from "../session";
import { NO_VISIT, type OverReason, type Visit } from "../visit";
import type { BrokerState } from "../watch";
import { Beat } from "./beat";
import { Requests } from "./requests";
import type { ResumeStore } from "./resume_store";
import { Refused, type Transport, type TransportEvent, Unanswered } from "./transport";
import { REFUSED_LOGIN, type Way, WebsocketWay } from "./websocket_way";

/** A swarm to join, and the secret to join with. */
export interface SessionTo {
  /** URL of the websocket, unless `at` names a broker. */
  readonly url: string;
  readonly at: Where;
  /** The swarm's public key. */
  readonly fixed: Uint8Array;
  /** Secret of a code; undefined to resume only. */
  readonly invitation: Secret | undefined;
  readonly name: string;
}

/** Names of requests 0 to 3 in a session. */
const REQUESTS = ["robots", "area", "walls", "lit"];
const TICK_MS = 1000;
const OPEN_MS = 5000;
const RETRY_MS = [300, 1000, 2000, 4000];
/** Close reasons of a websocket instead of an answer: they are unauthenticated, so the client retries. */
const SAID_INVALID = ["unknown_secret", "not_authentic"];
const SAID_TOO_MANY = ["tries_used_up", "too_many"];
const REFUSALS = 2;
/** A longer request exceeds the size of a command, and is visible anyway. */
const SHORT_BYTES = 64;

export class SessionConnection implements Transport {
  readonly #to: SessionTo;
  readonly #store: ResumeStore;
  readonly #listeners = new Set<(event: TransportEvent) => void>();
  readonly #requests = new Requests();
  readonly #beat = new Beat({
    isJoined: () => this.#session?.isJoined === true,
    holds: () => (this.#visit.standing?.robot ?? "") !== "",
    alive: (now_ms) => this.#carry(this.#session ? [this.#session.alive(now_ms)] : []),
  });
  readonly #ticking: ReturnType<typeof setInterval>;
  /** Secrets to try in turn, the current one first. */
  #secrets: Secret[];
  #refusals = 0;
  #retries = 0;
  #retrying: ReturnType<typeof setTimeout> | undefined;
  #opening: ReturnType<typeof setTimeout> | undefined;
  readonly #dial: () => Way;
  #way: Way | undefined;
  #session: Session | undefined;
  #state: BrokerState = "connecting";
  #visit: Visit = NO_VISIT;
  #asked = 0;
  #isHidden = false;
  /** Id of this tab: the stored secret belongs to the tab that used it last. */
  readonly #tab = bytesToHex(randomBytes(8));
  #wasHere = false;

  /** Connects at once, and again whenever the connection is lost, until it is over or close() is called. */
  constructor(to: SessionTo, store: ResumeStore, dial: () => Way = () => new WebsocketWay(to.url)) {
    this.#to = to;
    this.#store = store;
    this.#dial = dial;
    this.#secrets = this.#known();
    this.#ticking = setInterval(() => this.#tick(), TICK_MS);
    this.#connect();
  }

  get state(): BrokerState {
    return this.#state;
  }

  get visit(): Visit {
    return this.#visit;
  }

  /** Number of refused messages, by reason. */
  get rejected(): ReadonlyMap<string, number> {
    return this.#session?.rejected ?? new Map<string, number>();
  }

  listen(listener: (event: TransportEvent) => void): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  command(address: string, name: string, payload: unknown): boolean {
    const session = this.#session;
    if (session?.hasSeen !== true || !session.isJoined) return false;
    const stop = name === "move_raw" && isRest(payload);
    const body = utf8ToBytes(JSON.stringify(payload));
    const say = (now_ms: number) => this.#carry([session.command(address, name, body, now_ms, stop)]);
    const saying = { robot: address, name, say };
    const { slots } = this.#beat;
    if (stop) slots.stop(saying);
    else if (name === "move_raw") slots.hold(saying, performance.now());
    else if (!slots.put(saying)) return false;
    // A hidden page may never get another slot.
    if (stop && this.#isHidden) this.#beat.take();
    else this.#beat.start();
    return true;
  }

  request(request: number, timeout_ms = 3000): Promise<Json> {
    const name = REQUESTS[request];
    if (name === undefined) throw new UsageError(`no request ${request}`);
    return this.#ask(name, new Uint8Array(0), timeout_ms, request);
  }

  /** Return the answer to an operator's request. @throws Refused, Unanswered (the promise) */
  ask(name: string, words: object = {}, timeout_ms = 3000): Promise<Json> {
    return this.#ask(name, utf8ToBytes(JSON.stringify(words)), timeout_ms);
  }

  #ask(name: string, payload: Uint8Array, timeout_ms: number, request?: number): Promise<Json> {
    const session = this.#session;
    if (session?.isJoined !== true) return Promise.reject(new Unanswered("not connected"));
    return this.#requests.open(request, timeout_ms, (sent) => {
      const say = (now_ms: number) => {
        const { number, event } = session.request(name, payload, now_ms);
        sent(number);
        this.#carry([event]);
      };
      this.#asked += 1;
      // An operator's stop is sent without waiting for a slot: everybody sees the robots stop anyway.
      const isPaced = payload.length <= SHORT_BYTES && name !== "stop" && this.#beat.isBeating;
      if (isPaced) return this.#beat.slots.put({ robot: "", name: `${name} ${this.#asked}`, say });
      say(performance.now());
      return true;
    });
  }

  wake(): void {
    this.#isHidden = false;
    if (this.#way === undefined && this.#visit.stage !== "over") this.#connect();
    else this.#tick();
  }

  hide(): void {
    this.#isHidden = true;
    if (this.#beat.slots.hasStop) this.#beat.take();
  }

  leave(): void {
    this.hide();
    this.#carry(this.#session?.leave(performance.now()) ?? []);
  }

  restart(): void {
    if (this.#visit.stage !== "over") this.#connect();
  }

  /** Retry after it was over, with the secrets known now. */
  again(): void {
    this.#secrets = this.#known();
    this.#refusals = 0;
    this.#wasHere = false;
    this.#show({ stage: "joining", over: undefined });
    this.#connect();
  }

  close(): void {
    this.#listeners.clear();
    clearInterval(this.#ticking);
    this.#hangUp();
  }

  /** A ticket or a room code takes precedence over the stored secret; an open code does not. */
  #known(): Secret[] {
    const { fixed, invitation } = this.#to;
    const resume = this.#store.find(fixed, now_s())?.secret;
    const all = invitation?.kind === "open" ? [resume, invitation] : [invitation, resume];
    return all.filter((each) => each !== undefined);
  }

  #connect(): void {
    this.#hangUp();
    const kept = this.#store.find(this.#to.fixed, now_s());
    // Two tabs that resume in turn would end each other's sessions for ever.
    if (this.#wasHere && kept && kept.tab !== this.#tab) {
      this.#end("replaced");
      return;
    }
    const [first] = this.#secrets;
    const secret = first?.kind === "resume" ? (kept?.secret ?? first) : first;
    if (secret === undefined) {
      this.#end("code");
      return;
    }
    const way = this.#dial();
    const session = new Session({ ...this.#to.at, fixed: this.#to.fixed, secret }, randomBytes, this.#to.name);
    this.#way = way;
    this.#session = session;
    this.#opening = setTimeout(() => this.#lost("offline"), OPEN_MS);
    // Events of an abandoned connection are ignored.
    way.onOpen = () => {
      if (this.#way !== way) return;
      clearTimeout(this.#opening);
      this.#carry(session.start(performance.now()));
    };
    way.onMessage = (data) => {
      if (this.#way === way) this.#carry(session.receive(data, performance.now()));
    };
    way.onClose = (reason) => {
      if (this.#way !== way) return;
      if (!session.isJoined && SAID_INVALID.includes(reason)) this.#refuse();
      else if (!session.isJoined && SAID_TOO_MANY.includes(reason)) this.#end("too_many");
      else this.#lost(reason === REFUSED_LOGIN ? "refused" : "offline");
    };
    if (way.isOpen) way.onOpen();
  }

  /** The server does not know the secret, or claims so. */
  #refuse(): void {
    this.#refusals += 1;
    // Each attempt with a room code counts against everybody at this address.
    const most = this.#secrets[0]?.kind === "room" ? 1 : REFUSALS;
    if (this.#refusals >= most) this.#drop();
    if (this.#secrets.length > 0) this.#lost("connecting");
    else this.#end("code");
  }

  /** The current secret is no longer valid. */
  #drop(): void {
    const [dead] = this.#secrets.splice(0, 1);
    this.#refusals = 0;
    if (dead?.kind === "resume") this.#store.forget(this.#to.fixed);
  }

  #lost(state: BrokerState): void {
    this.#hangUp();
    this.#show({ stage: "joining" });
    this.#setState(state);
    // Hidden pages have slow timers: each connection would be lost again.
    if (this.#isHidden) return;
    const wait_ms = RETRY_MS[Math.min(this.#retries, RETRY_MS.length - 1)] ?? 0;
    this.#retries += 1;
    this.#retrying = setTimeout(() => this.#connect(), wait_ms * (1 + Math.random()) / 2);
  }

  #end(over: OverReason): void {
    this.#hangUp();
    this.#show({ stage: "over", over, standing: undefined });
    this.#setState("over");
  }

  #hangUp(): void {
    clearTimeout(this.#retrying);
    clearTimeout(this.#opening);
    this.#beat.stop();
    this.#retrying = undefined;
    this.#requests.lose();
    const way = this.#way;
    this.#way = undefined;
    this.#session = undefined;
    way?.close();
  }

  #tick(): void {
    if (this.#session && this.#way?.isOpen === true) this.#carry(this.#session.tick(performance.now()));
  }

  #carry(events: readonly SessionEvent[]): void {
    for (const event of events) this.#on(event);
  }

  #on(event: SessionEvent): void {
    switch (event.kind) {
      case "transmit":
        this.#way?.send(event.data, event.topic);
        return;
      case "hear":
        this.#way?.hear(event.topics);
        return;
      case "admitted":
        this.#refusals = 0;
        this.#retries = 0;
        this.#wasHere = true;
        this.#show({ stage: "here", name: event.name, over: undefined });
        return;
      case "keep":
        this.#keep(event.secret, event.lifetime_s);
        return;
      case "stands":
        this.#show({ standing: event.standing, standingAt_ms: performance.now() });
        this.#setState(event.standing.waiting ? "waiting" : "online");
        if (event.standing.robot !== "") this.#beat.start();
        return;
      case "updated":
        this.#read(event.state, (payload) => this.#emit({ kind: "notified", payload }));
        return;
      case "replied":
        this.#read(event.payload, (data) => this.#reply(event.number, data));
        return;
      case "refused":
        this.#refused(event.number, event.reason);
        return;
      case "ended":
        this.#ended(event.reason);
        return;
    }
  }

  #keep(secret: Secret, lifetime_s: number): void {
    const { fixed, at } = this.#to;
    this.#store.keep({ fixed, at, secret, name: this.#visit.name, tab: this.#tab }, lifetime_s, now_s());
    const invitation = this.#secrets.find(({ kind }) => kind === "open");
    this.#secrets = invitation ? [secret, invitation] : [secret];
    if (this.#session?.isJoined === true) this.#carry([this.#session.stored(secret, performance.now())]);
  }

  #reply(number: number, data: Json): void {
    const waiting = this.#requests.settle(number);
    if (waiting === undefined) return;
    waiting.resolve(data);
    const { request } = waiting;
    if (request !== undefined) this.#emit({ kind: "replied", request, data });
  }

  #refused(number: number, reason: Reason): void {
    if (number === 0) this.#show({ refused: { reason, at_ms: performance.now() } });
    else this.#requests.settle(number)?.reject(new Refused(reason));
  }

  #ended(reason: Extract<SessionEvent, { kind: "ended" }>["reason"]): void {
    switch (reason) {
      case "removed":
      case "new_code":
        this.#store.forget(this.#to.fixed);
        this.#end(reason);
        return;
      case "replaced":
      case "full":
        this.#end(reason);
        return;
      case "not_admitted":
        this.#drop();
        if (this.#secrets.length > 0) this.#lost("connecting");
        else this.#end("code");
        return;
      case undefined:
        // A broker does not report invalid secrets: try the next one.
        if (this.#to.at.broker !== "" && !this.#wasHere) this.#secrets.push(...this.#secrets.splice(0, 1));
        this.#lost("no_answer");
        return;
      default:
        this.#lost("offline");
    }
  }

  #read(raw: Uint8Array, take: (value: Json) => void): void {
    let value: Json;
    try {
      value = parseJson(raw);
    } catch (error) {
      if (!(error instanceof PeerError)) throw error;
      this.#emit({ kind: "rejected", reason: error.reason });
      return;
    }
    take(value);
  }

  #show(change: Partial<Visit>): void {
    this.#visit = { ...this.#visit, ...change };
    this.#emit({ kind: "visit", visit: this.#visit });
  }

  #setState(state: BrokerState): void {
    if (state === this.#state) return;
    this.#state = state;
    this.#emit({ kind: "broker", state });
  }

  #emit(event: TransportEvent): void {
    for (const listener of this.#listeners) listener(event);
  }
}

/** Whether the joystick was released. */
function isRest(payload: unknown): boolean {
  const { left_y, right_y } = payload as { readonly left_y?: unknown; readonly right_y?: unknown };
  return left_y === 0 && right_y === 0;
}

function now_s(): number {
  return Date.now() / 1000;
}
