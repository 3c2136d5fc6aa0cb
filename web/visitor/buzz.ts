// Vibrate, to get the attention of a visitor who looks at the robot.

/** Works where phones and browsers allow it: not before the visitor has touched the page. */
export function buzz(...pattern_ms: readonly number[]): void {
  if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.([...pattern_ms]);
}
