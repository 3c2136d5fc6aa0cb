// @vitest-environment jsdom
// The joystick as a person meets it: whatever takes the hand away stops the robot.

import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { Wheels } from "../visitor/drive";
import { Joystick } from "../visitor/joystick";

const ZERO: Wheels = { left: 0, right: 0 };

let root: Root;
let pad: HTMLElement;
let sent: Wheels[];
let send: (wheels: Wheels) => void;

async function show(props: Partial<Parameters<typeof Joystick>[0]> = {}) {
  await act(async () => root.render(<Joystick send={send} disabled={false} robotName="Ada" {...props} />));
  const found = document.querySelector<HTMLElement>("[data-testid=joystick]");
  if (!found) throw new Error("no joystick");
  pad = found;
  pad.setPointerCapture = () => {};
  pad.getBoundingClientRect = () => new DOMRect(0, 0, 200, 200);
}

async function point(type: string, x: number, y: number, pointerId = 1, button = 0) {
  const event = new MouseEvent(type, { bubbles: true, cancelable: true, clientX: x, clientY: y, button });
  Object.defineProperty(event, "pointerId", { value: pointerId });
  await act(async () => void pad.dispatchEvent(event));
}

async function key(type: "keydown" | "keyup", code: string, more: KeyboardEventInit = {}) {
  const event = new KeyboardEvent(type, { bubbles: true, cancelable: true, code, ...more });
  await act(async () => void pad.dispatchEvent(event));
  return event;
}

beforeEach(() => {
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.useFakeTimers();
  sent = [];
  send = (wheels) => void sent.push(wheels);
  const place = document.createElement("div");
  document.body.replaceChildren(place);
  root = createRoot(place);
});

afterEach(async () => {
  await act(async () => root.unmount());
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("by touch", () => {
  test("drives while held, follows the thumb, and stops when it is lifted", async () => {
    await show();
    await point("pointerdown", 100, 20);
    expect(sent).toEqual([{ left: 100, right: 100 }]);
    await point("pointermove", 180, 100);
    await act(async () => vi.advanceTimersByTime(200));
    expect(sent.slice(1)).toEqual(Array(3).fill({ left: 100, right: -100 }));
    await point("pointerup", 180, 100);
    expect(sent.slice(4)).toEqual([ZERO]);
    await act(async () => vi.advanceTimersByTime(1000));
    expect(sent).toHaveLength(5);
  });

  test("a second finger neither steers nor stops", async () => {
    await show();
    await point("pointerdown", 100, 20, 1);
    await point("pointerdown", 20, 100, 2);
    await point("pointermove", 100, 180, 2);
    await point("pointerup", 100, 180, 2);
    await act(async () => vi.advanceTimersByTime(100));
    expect(sent).toEqual([
      { left: 100, right: 100 },
      { left: 100, right: 100 },
    ]);
  });

  test("the right mouse button does not drive", async () => {
    await show();
    await point("pointerdown", 100, 20, 1, 2);
    expect(sent).toEqual([]);
  });

  const endings: [string, () => Promise<void>][] = [
    ["the browser takes the pointer", () => point("pointercancel", 0, 0)],
    ["the capture is lost", () => point("lostpointercapture", 0, 0)],
    ["the window loses the focus", () => act(async () => void window.dispatchEvent(new Event("blur")))],
    ["the page is left", () => act(async () => void window.dispatchEvent(new Event("pagehide")))],
    [
      "the page is hidden",
      async () => {
        vi.spyOn(document, "visibilityState", "get").mockReturnValue("hidden");
        await act(async () => void document.dispatchEvent(new Event("visibilitychange")));
      },
    ],
    ["the joystick is taken away", () => act(async () => root.render(null))],
    ["there is no robot any more", () => show({ disabled: true })],
  ];
  test.each(endings)("stops when %s", async (_name, end) => {
    await show();
    await point("pointerdown", 100, 20);
    await end();
    expect(sent.at(-1)).toEqual(ZERO);
    const length = sent.length;
    await act(async () => vi.advanceTimersByTime(1000));
    expect(sent).toHaveLength(length);
    expect(length).toBe(2);
  });

  test("choosing another robot stops the first one, and does not drive the second", async () => {
    await show();
    await point("pointerdown", 100, 20);
    const other: Wheels[] = [];
    const sendOther = (wheels: Wheels) => void other.push(wheels);
    await show({ send: sendOther });
    await act(async () => vi.advanceTimersByTime(500));
    expect(sent).toEqual([{ left: 100, right: 100 }, ZERO]);
    expect(other).toEqual([]);
  });
});

describe("by keyboard", () => {
  test("drives while a key is held, with several at once, and stops at the last one", async () => {
    await show();
    expect((await key("keydown", "ArrowUp")).defaultPrevented).toBe(true);
    await key("keydown", "ArrowUp", { repeat: true });
    await key("keydown", "KeyD");
    await act(async () => vi.advanceTimersByTime(100));
    await key("keyup", "ArrowUp");
    await act(async () => vi.advanceTimersByTime(100));
    await key("keyup", "KeyD");
    const changes = sent.filter(({ left }, i) => left !== sent[i - 1]?.left);
    expect(changes).toEqual([{ left: 80, right: 80 }, { left: 100, right: 33 }, { left: 40, right: -40 }, ZERO]);
  });

  test("stops when the focus goes elsewhere", async () => {
    await show();
    await key("keydown", "KeyW");
    await act(async () => void pad.dispatchEvent(new FocusEvent("focusout", { bubbles: true })));
    expect(sent).toEqual([{ left: 80, right: 80 }, ZERO]);
  });

  test("leaves other keys, and shortcuts, to the browser", async () => {
    await show();
    expect((await key("keydown", "Tab")).defaultPrevented).toBe(false);
    expect((await key("keydown", "KeyD", { ctrlKey: true })).defaultPrevented).toBe(false);
    expect(sent).toEqual([]);
  });

  test("does nothing without a robot", async () => {
    await show({ disabled: true, robotName: undefined });
    await key("keydown", "ArrowUp");
    await point("pointerdown", 100, 20);
    expect(sent).toEqual([]);
    expect(pad.getAttribute("aria-label")).toContain("choose a robot");
  });
});
