// Made by firmware/generate.py from src/phalanx/wire/table.py.

/** position of a robot in a state update; with a w of 181 · 360 or more it is no robot, and skips 181 numbers. */
export const PLACE = { bytes: 6, w: 0, x: 2, y: 4 };
/** point of a route in a state update. */
export const POINT = { bytes: 4, x: 0, y: 2 };
export const TURN_DEG = 360;
export const PASS_BY = 181;
