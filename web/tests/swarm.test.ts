// The reducer, and whatever else a peer may say.

import fc from "fast-check";
import { describe, expect, test } from "vitest";
import { encodeBase64url } from "../client/core/base64url";
import { type Json, type JsonObject, label, MOST_ROBOTS, NO_SWARM, type Swarm, swarmReducer, TRAIL_POINTS, Trail } from "../client";

const A = "DECAFBAD00000001";
const B = "DECAFBAD00000002";

const told = (request: number, data: unknown) => ({ kind: "replied", request, data: data as Json, at_ms: 0 }) as const;
const notified = (cmd: number, data?: unknown) => ({ kind: "notified", payload: { cmd, data } as Json, at_ms: 0 }) as const;
type Action = Parameters<typeof swarmReducer>[1];
const play = (actions: readonly Action[], from: Swarm = NO_SWARM) => actions.reduce(swarmReducer, from);

function robot(address: string, more: object = {}) {
  return {
    address,
    n: address === A ? 1 : 2,
    name: "Ada",
    swarm: "0000",
    status: 0,
    mode: 0,
    last_seen: 1.7e9,
    direction: 90,
    lh2_position: { x: 100, y: 200, z: 0 },
    rgb_led: { red: 255, green: 0, blue: 10 },
    waypoints: [],
    waypoints_threshold: 40,
    position_history: [{ x: 90, y: 200, z: 0 }],
    calibrated: 1,
    battery: 2.9,
    ...more,
  };
}

const START = play([told(1, { width: 3000, height: 2000 }), told(0, [robot(A), robot(B, { name: "Bo" })])]);
type Row = readonly [number: number, x: number, y: number, direction: number];
const frame = (seq: number, { robots = [], ...more }: { robots?: readonly Row[]; [key: string]: unknown } = {}) =>
  notified(16, { seq, ...(robots.length > 0 && { places: packed(robots) }), ...more });

/** As a gateway packs them; by number, none more than 180 after the one before, on less than 65 m. */
function packed(robots: readonly Row[]): Json {
  const [[first] = [0]] = robots;
  const [left, top] = [Math.min(...robots.map((row) => row[1])), Math.min(...robots.map((row) => row[2]))];
  const records = robots.flatMap(([number, x, y, direction], i) => {
    const skipped = i === 0 ? 0 : number - (robots[i - 1]?.[0] ?? 0) - 1;
    return [360 * skipped + direction, x - left, y - top];
  });
  return [[first, left, top, 1, encodeBase64url(new Uint8Array(Uint16Array.from(records).buffer))]];
}

const of = (swarm: Swarm, address = A) => {
  const found = swarm.robots.get(address);
  if (!found) throw new Error(`no robot ${address}`);
  return found;
};

describe("the operator's stop", () => {
  test("lasts as long as frames say so, whichever were missed", () => {
    const held = play([frame(1), frame(2, { held: true })], START);
    expect([START.held, held.held, play([frame(3, { held: true })], held).held]).toEqual([false, true, true]);
    expect(play([frame(9)], held).held).toBe(false);
    expect(play([frame(1, { held: 1 })], START).held).toBe(false);
  });
});

describe("answers", () => {
  test("request 0 lists the robots, request 1 gives the area", () => {
    expect(of(START)).toMatchObject({
      name: "Ada",
      direction: 90,
      position: { x: 100, y: 200 },
      led: { red: 255, green: 0, blue: 10 },
      threshold: 40,
      battery_v: 2.9,
    });
    expect(of(START).trail.length).toBe(1);
    expect(START.area).toEqual({ width: 3000, height: 2000 });
    expect(START.roster.map(label)).toEqual(["Ada (0001)", "Bo (0002)"]);
  });

  test("a resync with the newest points only does not shorten a trail that was seen growing", () => {
    const grown = play([frame(1, { robots: [[1, 500, 200, 0]] }), frame(2, { robots: [[1, 900, 200, 0]] })], START);
    expect(of(play([told(0, [robot(A), robot(B)])], grown)).trail.length).toBe(3);
  });

  test("who joins has a number, and frames may use it at once", () => {
    const swarm = play([frame(1, { joined: [robot("C", { n: 9 })], robots: [[9, 700, 800, 45]] })], START);
    expect(of(swarm, "C")).toMatchObject({ position: { x: 700, y: 800 }, direction: 45 });
    expect(swarm.missed).toBe(0);
  });

  test("what frames told while a long list was on its way is newer than the list", () => {
    const green = { red: 0, green: 255, blue: 0 };
    const meanwhile = [
      frame(1, { changed: [{ address: A, rgb_led: green, status: 1 }], robots: [[1, 500, 500, 0]] }),
      frame(2, { joined: [robot("C", { n: 9 })], changed: [{ address: "C", rgb_led: green }] }),
      frame(3, { left: [B] }),
    ];
    const before = play(meanwhile, START);
    const said = meanwhile.map(({ payload }) => ({ words: (payload as { data: JsonObject }).data, at_ms: 0 }));
    const answer = { ...told(0, [robot(A), robot(B)]), said };
    const swarm = play([answer], before);
    expect([...swarm.robots.keys()]).toEqual([A, "C"]);
    expect(of(swarm)).toMatchObject({ led: green, status: 1, position: { x: 100, y: 200 } });
    expect(of(swarm, "C").led).toEqual(green);
    expect(swarm.seq).toBe(3);
    expect(play([frame(4, { robots: [[9, 1, 1, 1]] })], swarm).missed).toBe(before.missed);
  });

  test("a second answer forgets robots that are no longer listed", () => {
    expect([...play([told(0, [robot(B)])], START).robots.keys()]).toEqual([B]);
  });

  test("an answer whose histories were all dropped for its size leaves the trails", () => {
    const bare = [robot(A, { position_history: [] }), robot(B, { position_history: [] })];
    expect(of(play([told(0, bare)], START)).trail.length).toBe(1);
    expect(of(play([told(0, [bare[0], robot(B)])], START)).trail.length).toBe(0);
  });

  test("an answer that is no list, or an area that is none, changes nothing", () => {
    for (const data of [null, {}, "robots", 7]) expect(swarmReducer(START, told(0, data))).toBe(START);
    for (const data of [
      null,
      [],
      { width: 0, height: 10 },
      { width: 10 },
      { width: 1e300, height: 1e300 },
      { width: "9", height: 9 },
    ]) {
      expect(swarmReducer(START, told(1, data))).toBe(START);
    }
  });
});

describe("frames", () => {
  test("move robots, and grow their trails by steps that can be seen", () => {
    const swarm = play(
      [
        frame(1, { robots: [[1, 110, 200, 270]], changed: [{ address: A, battery_mv: 3100, status: 1 }] }),
        frame(2, { robots: [[1, 400, 200, 270]] }),
        frame(3, { robots: [[1, 401, 200, 90]], changed: [{ address: A, battery_mv: 3000, status: 0 }] }),
      ],
      START,
    );
    expect(of(swarm)).toMatchObject({ position: { x: 401, y: 200 }, direction: 90, battery_v: 3, status: 0 });
    const { trail } = of(swarm);
    expect(Array.from({ length: trail.length }, (_, i) => trail.x(i))).toEqual([90, 110, 400]);
    expect(swarm.missed).toBe(0);
  });

  test("bring what changed, who joined and who left", () => {
    const changed = [
      {
        address: A,
        rgb_led: { red: 1, green: 2, blue: 3 },
        waypoints_threshold: 70,
      },
    ];
    const points = encodeBase64url(new Uint8Array(Uint16Array.from([0, 0, 2, 2]).buffer));
    const routes = [[1, 1, 2, 1, points], [99, 1, 2, 1, points], [1], null];
    const swarm = play([frame(1, { changed, routes, joined: [robot("C", { name: "Cy" })], left: [B] })], START);
    expect(of(swarm)).toMatchObject({
      led: { red: 1, green: 2, blue: 3 },
      waypoints: [
        { x: 1, y: 2 },
        { x: 3, y: 4 },
      ],
      threshold: 70,
      mode: 1,
    });
    expect(of(play([frame(2, { routes: [[1, 0, 0, 1, ""]] })], swarm))).toMatchObject({ waypoints: [], mode: 0 });
    expect(swarm.roster.map(({ address }) => address)).toEqual([A, "C"]);
    expect(of(play([frame(2, { changed: [{ address: A, history_cleared: true }] })], swarm)).trail.length).toBe(0);
  });

  test("a gap, a restart of the count or an unknown robot asks for request 0 again, and the first frame does not", () => {
    const one = play([frame(7)], START);
    expect(one.missed).toBe(0);
    expect(play([frame(8)], one).missed).toBe(0);
    expect(play([frame(9)], one).missed).toBe(1);
    expect(play([frame(1)], one).missed).toBe(1);
    expect(play([frame(8, { robots: [[77, 1, 1, 1]] })], one).missed).toBe(1);
    expect(play([{ kind: "reconnected" }, frame(20)], one).missed).toBe(0);
  });

  test("the roster keeps its identity while nobody comes, goes or is renamed", () => {
    const moved = play([frame(1, { robots: [[1, 500, 500, 0]] })], START);
    expect(moved.roster).toBe(START.roster);
    expect(play([frame(2, { changed: [{ address: A, status: 2 }] })], moved).roster).not.toBe(START.roster);
  });

  test("the state that was given is left as it was", () => {
    const before = of(START);
    const grown = play([frame(1, { robots: [[1, 900, 200, 0]] })], START);
    const other = play([frame(1, { robots: [[1, 200, 900, 0]] })], START);
    expect(before.trail.length).toBe(1);
    expect(of(grown).trail.x(1)).toBe(900);
    expect(of(other).trail.x(1)).toBe(200);
  });
});

describe("before the answers", () => {
  test("the area is 2000 by 2000 mm, and a robot without a name has one", () => {
    const swarm = play([told(0, [robot(A, { lh2_position: null, name: undefined })])]);
    expect(swarm.area).toEqual({ width: 2000, height: 2000 });
    expect(label(of(swarm))).toBe("Robot (0001)");
  });

  test("our own clearing of a trail shows without an answer", () => {
    expect(of(play([{ kind: "history_cleared", address: A }], START)).trail.length).toBe(0);
  });
});

describe("hostile peers", () => {
  const address = fc.constantFrom<Json>(A, B, "C", "", "a/b", "__proto__", null, 7);
  const number = fc.oneof(
    fc.double(),
    fc.integer(),
    fc.constantFrom<unknown>(Number.POSITIVE_INFINITY, Number.NaN, 1e308, -1e9, null, "1", {}, [], true),
  );
  const point = fc.record({ x: number, y: number }, { requiredKeys: [] });
  const aRobot = fc.record(
    {
      address,
      name: fc.oneof(fc.string({ unit: "binary" }), number),
      status: number,
      mode: number,
      direction: number,
      lh2_position: point,
      rgb_led: fc.record({ red: number, green: number, blue: number }),
      waypoints: fc.oneof(fc.array(point), number),
      waypoints_threshold: number,
      position_history: fc.oneof(fc.array(point), number),
      battery: number,
    },
    { requiredKeys: ["address"] },
  );
  const records = fc.oneof(
    fc.array(fc.tuple(fc.nat(800), fc.nat(0xffff), fc.nat(0xffff)), { maxLength: 9 }).map((rows) => {
      return encodeBase64url(new Uint8Array(Uint16Array.from(rows.flat()).buffer));
    }),
    fc.string(),
  );
  const corner = fc.oneof({ weight: 9, arbitrary: fc.integer({ min: -5000, max: 5000 }) }, { weight: 1, arbitrary: number });
  const places = fc.array(fc.tuple(fc.nat(3), corner, corner, corner, records), { maxLength: 3 });
  const aFrame = fc.record(
    {
      seq: fc.oneof(fc.nat(5), number),
      places: fc.oneof(places, number),
      routes: fc.oneof(places, number),
      drivers: fc.oneof(fc.array(fc.tuple(number, fc.array(number))), number),
      changed: fc.oneof(fc.array(aRobot), number),
      joined: fc.oneof(fc.array(aRobot), number),
      left: fc.oneof(fc.array(address), number),
      shields: fc.oneof(fc.array(fc.tuple(number, number, fc.array(number))), number),
      walks: fc.oneof(fc.array(fc.tuple(number, number, number, number, number)), number),
      audits: fc.oneof(fc.array(fc.tuple(number, number, number)), number),
    },
    { requiredKeys: ["seq"] },
  );
  const action = fc.oneof(
    fc
      .tuple(fc.nat(2), fc.oneof(fc.array(aRobot), fc.jsonValue()), fc.array(aFrame, { maxLength: 3 }))
      .map(([request, data, frames]) => {
        return { ...told(request, data), said: frames.map((words) => ({ words: words as JsonObject, at_ms: 0 })) };
      }),
    fc
      .tuple(fc.constantFrom(1, 2, 4, 16, 99), fc.oneof(aRobot, aFrame, fc.jsonValue()))
      .map(([cmd, data]) => notified(cmd, data)),
    fc.jsonValue().map((payload) => ({ kind: "notified", payload: payload, at_ms: 0 }) as const),
  );

  test("nothing throws, and every number that can be drawn is finite", () => {
    fc.assert(
      fc.property(fc.array(action, { maxLength: 12 }), (actions) => {
        const swarm = play(actions, START);
        expect(Number.isFinite(swarm.area.width) && swarm.area.width > 0 && swarm.area.height > 0).toBe(true);
        for (const shown of swarm.robots.values()) {
          const { position, direction, led, waypoints, trail, threshold, battery_v, name } = shown;
          const numbers = [
            ...(position ? [position.x, position.y] : []),
            ...(led ? [led.red, led.green, led.blue] : []),
            ...waypoints.flatMap(({ x, y }) => [x, y]),
            ...Array.from({ length: trail.length }, (_, i) => trail.x(i) + trail.y(i)),
            direction ?? 0,
            threshold,
            battery_v ?? 0,
          ];
          expect(numbers.every(Number.isFinite)).toBe(true);
          expect(name.length).toBeGreaterThan(0);
          expect(name).not.toMatch(/[\n\u202e]/);
        }
        expect(swarm.roster.length).toBe(swarm.robots.size);
      }),
      { numRuns: 200 },
    );
  });

  test("memory is bounded: robots, names, waypoints, trails", () => {
    const long = {
      name: "n".repeat(10_000),
      waypoints: Array(500).fill({ x: 1, y: 1 }),
      position_history: Array(5000).fill({ x: 1, y: 1 }),
    };
    const many = Array.from({ length: 3 * MOST_ROBOTS }, (_, i) => robot(`R${i}`, long));
    const swarm = play([
      told(0, many.slice(0, 50)),
      frame(1, { joined: many }),
      frame(2, { joined: many.slice(4000) }),
    ]);
    expect(swarm.robots.size).toBe(MOST_ROBOTS);
    const { name, waypoints, trail } = of(swarm, "R7");
    expect([name.length, waypoints.length, trail.length]).toEqual([32, 65, TRAIL_POINTS]);
  });

  test("robots beyond what is kept do not make it ask for ever", () => {
    const many = Array.from({ length: MOST_ROBOTS }, (_, i) => robot(`R${i}`));
    const full = play([told(0, many), frame(1)]);
    expect(play([frame(2, { robots: [[7777, 1, 1, 0]] })], full).missed).toBe(full.missed);
  });
});

describe("trail", () => {
  test("holds the newest thousand points, whoever else grows from it", () => {
    fc.assert(
      fc.property(fc.integer({ min: 0, max: 4500 }), fc.integer({ min: 0, max: 50 }), (length, branch) => {
        let trail = Trail.EMPTY;
        const all: number[] = [];
        for (let i = 0; i < length; i += 1) {
          if (i % 100 === branch) trail.append({ x: -1, y: -1 });
          trail = trail.append({ x: i, y: 2 * i });
          all.push(i);
        }
        expect(Array.from({ length: trail.length }, (_, i) => trail.x(i))).toEqual(all.slice(-TRAIL_POINTS));
        if (length > 0) expect(trail.y(trail.length - 1)).toBe(2 * (length - 1));
      }),
      { numRuns: 8 },
    );
  });
});
