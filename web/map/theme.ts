// The map's colours, read from the stylesheet.

export interface Theme {
  readonly ground: string;
  readonly grid: string;
  readonly edge: string;
  readonly ink: string;
  readonly halo: string;
  readonly accent: string;
  /** A robot whose LED is off or unknown. */
  readonly unlit: string;
  readonly good: string;
  readonly warn: string;
  readonly bad: string;
  readonly muted: string;
  readonly wall: string;
  /** A decoded landmark. */
  readonly lit: string;
}

export function readTheme(element: Element): Theme {
  const style = getComputedStyle(element);
  const colour = (name: string) => style.getPropertyValue(name).trim() || "#888";
  return {
    ground: colour("--ground"),
    grid: colour("--grid"),
    edge: colour("--edge"),
    ink: colour("--ink"),
    halo: colour("--ground"),
    accent: colour("--accent"),
    unlit: colour("--unlit"),
    good: colour("--good"),
    warn: colour("--warn"),
    bad: colour("--bad"),
    muted: colour("--muted"),
    wall: colour("--wall"),
    lit: colour("--lit"),
  };
}
