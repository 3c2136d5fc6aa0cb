// Format numbers and addresses for people.

import type { Drift } from "../client";
import { common, operator as texts } from "../texts";

/** "0:42", "12:05", "1:02:05". */
export function clock(seconds: number): string {
  const whole = Math.max(0, Math.ceil(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (n: number) => String(n).padStart(2, "0");
  return h > 0 ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** "now", "7 s", "3 min", "2 h", "4 d": time since, in the largest fitting unit. */
export function ago(seconds: number): string {
  if (seconds < 1) return texts.now;
  if (seconds < 60) return common.seconds(Math.floor(seconds));
  if (seconds < 3600) return common.minutes(Math.floor(seconds / 60));
  if (seconds < 86_400) return `${Math.floor(seconds / 3600)} h`;
  return texts.days(Math.floor(seconds / 86_400));
}

/** "1 234": narrow no-break spaces between thousands. */
export function grouped(n: number): string {
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/** "0", "0.4", "12": a rate, with a decimal only below ten. */
export function perSecond(rate: number): string {
  if (rate === 0) return "0";
  if (rate < 0.05) return `<${common.decimal(0.1, 1)}`;
  return rate < 9.95 ? common.decimal(rate, 1) : grouped(rate);
}

/** Host and path of a URL, without its secrets: the fragment has the pin. */
export function shortUrl(url: string): string {
  const bare = (url.split(/[?#]/, 1)[0] ?? "").replace(/^[a-z]+:\/\//i, "");
  return bare.replace(/\/$/, "");
}

/** "odometry scale error +2.9 %, turn error −4.8 %": only non-zero errors, or "". */
export function driftWords([way, turn, curve]: Drift): string {
  const errors = [way && texts.wayError(way), turn && texts.turnError(turn), curve && texts.curveError(curve)];
  return errors.filter(Boolean).join(", ");
}
