// The virtual joystick: thumb, mouse or keyboard. The robot stops when input ends for any reason.

import { type KeyboardEvent, type PointerEvent, useEffect, useLayoutEffect, useRef, useState } from "react";
import { visitor as texts } from "../texts";
import { buzz } from "./buzz";
import { clampStick, Drive, isDriveKey, type Stick, stickOfKeys, type Wheels } from "./drive";

const CENTRE: Stick = { x: 0, y: 0 };
/** How far the knob travels, as a fraction of the pad's half width. */
const TRAVEL = 0.62;

interface Props {
  /** Its identity identifies the robot: with another function, the first robot is stopped. */
  readonly send: (wheels: Wheels) => void;
  readonly disabled: boolean;
  readonly robotName: string | undefined;
}

export function Joystick({ send, disabled, robotName }: Props) {
  const [stick, setStick] = useState<Stick>(CENTRE);
  const drive = useRef<Drive>(undefined);
  const pointer = useRef<number>(undefined);
  const keys = useRef(new Set<string>());

  // Immediately: an effect one frame later would release a key pressed in between.
  useLayoutEffect(() => {
    const driving = new Drive(send);
    drive.current = driving;
    const stop = () => {
      keys.current.clear();
      pointer.current = undefined;
      driving.release();
      setStick(CENTRE);
    };
    const stopIfHidden = () => {
      if (document.visibilityState === "hidden") stop();
    };
    document.addEventListener("visibilitychange", stopIfHidden);
    window.addEventListener("pagehide", stop);
    window.addEventListener("blur", stop);
    return () => {
      document.removeEventListener("visibilitychange", stopIfHidden);
      window.removeEventListener("pagehide", stop);
      window.removeEventListener("blur", stop);
      stop();
    };
  }, [send]);

  useEffect(() => {
    if (!disabled) return;
    if (pointer.current !== undefined) buzz(200);
    release();
  });

  function hold(to: Stick) {
    setStick(to);
    drive.current?.hold(to);
  }

  function release() {
    pointer.current = undefined;
    keys.current.clear();
    drive.current?.release();
    setStick((shown) => (shown === CENTRE ? shown : CENTRE));
  }

  function stickAt(event: PointerEvent<HTMLElement>): Stick {
    const pad = event.currentTarget.getBoundingClientRect();
    const reach = (pad.width / 2) * TRAVEL;
    const x = (event.clientX - pad.left - pad.width / 2) / reach;
    const y = (pad.top + pad.height / 2 - event.clientY) / reach;
    return clampStick({ x, y });
  }

  function onPointerDown(event: PointerEvent<HTMLElement>) {
    // A second finger on the pad is ignored.
    if (disabled || pointer.current !== undefined || event.button !== 0) return;
    pointer.current = event.pointerId;
    event.currentTarget.setPointerCapture(event.pointerId);
    hold(stickAt(event));
  }

  function onPointerMove(event: PointerEvent<HTMLElement>) {
    if (event.pointerId === pointer.current) hold(stickAt(event));
  }

  function onPointerEnd(event: PointerEvent<HTMLElement>) {
    if (event.pointerId === pointer.current) release();
  }

  function onKeyDown(event: KeyboardEvent) {
    if (disabled || !isDriveKey(event.code) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys.current.add(event.code);
    const to = stickOfKeys(keys.current);
    if (to && pointer.current === undefined) hold(to);
  }

  function onKeyUp(event: KeyboardEvent) {
    if (!keys.current.delete(event.code) || pointer.current !== undefined) return;
    const to = stickOfKeys(keys.current);
    if (to) hold(to);
    else release();
  }

  const knob = { transform: `translate(${stick.x * TRAVEL * 100}%, ${-stick.y * TRAVEL * 100}%)` };
  return (
    <button
      type="button"
      className="joystick"
      data-testid="joystick"
      data-held={stick !== CENTRE}
      aria-label={robotName ? texts.joystickOf(robotName) : texts.joystickOfNone}
      aria-roledescription={texts.joystick}
      aria-describedby="joystick-help"
      aria-disabled={disabled}
      onPointerDown={onPointerDown}
      onPointerMove={onPointerMove}
      onPointerUp={onPointerEnd}
      onPointerCancel={onPointerEnd}
      onLostPointerCapture={onPointerEnd}
      onKeyDown={onKeyDown}
      onKeyUp={onKeyUp}
      onBlur={release}
      onContextMenu={(event) => event.preventDefault()}
    >
      <svg className="joystick-arrows" viewBox="0 0 100 100" aria-hidden="true">
        <path d="M50 7l5 7H45zM50 93l5-7H45zM7 50l7-5v10zM93 50l-7-5v10z" />
      </svg>
      <span className="joystick-travel" style={knob}>
        <span className="joystick-knob" />
      </span>
    </button>
  );
}
