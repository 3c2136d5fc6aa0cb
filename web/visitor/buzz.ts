// A phone that buzzes is noticed by whoever looks at the robot.

/** Where phones have it, and browsers allow it: not before the visitor has touched the page. */
export function buzz(...pattern_ms: readonly number[]): void {
  if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.([...pattern_ms]);
}
