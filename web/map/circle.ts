// A whole circle as the canvas's path, to be filled or drawn.

const TURN = 2 * Math.PI;

export function circle(ctx: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, TURN);
}
