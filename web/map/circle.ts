// Add a full circle to the canvas's path.

const TURN = 2 * Math.PI;

export function circle(ctx: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, TURN);
}
