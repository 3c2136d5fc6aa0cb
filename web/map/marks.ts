// Marks that distinguish robots: a colour and a pattern each, independent of the light. The first twelve differ in both.

export interface Mark {
  readonly colour: string;
  /** Colour of the pattern on the disc. */
  readonly ink: string;
  /** An SVG path within a circle of radius 1, filled by the even-odd rule; "" for a plain disc. */
  readonly pattern: string;
}

const DARK = "#10181d";
const LIGHT = "#ffffff";

/** Each colour with a contrasting ink. */
const COLOURS: readonly (readonly [colour: string, ink: string])[] = [
  ["#e63946", LIGHT],
  ["#f48c06", DARK],
  ["#fad23c", DARK],
  ["#52b788", DARK],
  ["#2a9dd9", DARK],
  ["#5e60ce", LIGHT],
  ["#c85ac8", LIGHT],
  ["#a8dadc", DARK],
  ["#8d5a3b", LIGHT],
  ["#b5d33d", DARK],
  ["#ffafcc", DARK],
  ["#1f6f50", LIGHT],
];

const PATTERNS: readonly string[] = [
  "",
  disc(0, 0, 0.72) + disc(0, 0, 0.44), // ring
  "M-.96-.24H.96V.24H-.96Z", // bar
  disc(0, 0, 0.46), // dot
  "M0-1A1 1 0 0 1 0 1Z", // half
  "M-.24-.96H.24V.96H-.24Z", // upright bar
  "M0 0V-1A1 1 0 0 1 1 0ZM0 0V1A1 1 0 0 1-1 0Z", // quarters
  "M0-.78L.7.48H-.7Z", // triangle
  "M-.8-.6H.8V-.2H-.8ZM-.8.2H.8V.6H-.8Z", // two bars
  disc(-0.45, 0, 0.3) + disc(0.45, 0, 0.3), // two dots
  "M-.52-.52H.52V.52H-.52Z", // square
  disc(0, -0.46, 0.27) + disc(-0.43, 0.34, 0.27) + disc(0.43, 0.34, 0.27), // three dots
];

/** Number of robots with unique marks. */
export const MARKED = COLOURS.length * PATTERNS.length;

/** The mark of a robot, by its number in updates: the same on every page. */
export function markOf(number: number): Mark {
  const round = Math.floor(number / COLOURS.length);
  const [colour, ink] = COLOURS[number % COLOURS.length] ?? [LIGHT, DARK];
  return { colour, ink, pattern: PATTERNS[(number + round) % PATTERNS.length] ?? "" };
}

const paths = new Map<string, Path2D>();

/** Draw the pattern on a disc. */
export function drawPattern(ctx: CanvasRenderingContext2D, { ink, pattern }: Mark, x: number, y: number, radius: number): void {
  if (pattern === "") return;
  const path = paths.get(pattern) ?? new Path2D(pattern);
  paths.set(pattern, path);
  ctx.save();
  ctx.translate(x, y);
  ctx.scale(radius, radius);
  ctx.fillStyle = ink;
  ctx.fill(path, "evenodd");
  ctx.restore();
}

function disc(x: number, y: number, r: number): string {
  return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
}
