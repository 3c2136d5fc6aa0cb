// Numbers and addresses as people read them.

/** "0:42", "12:05", "1:02:05". */
export function clock(seconds: number): string {
  const whole = Math.max(0, Math.ceil(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (n: number) => String(n).padStart(2, "0");
  return h > 0 ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** "now", "7 s", "3 min", "2 h", "4 d": how long ago, to the unit that matters. */
export function ago(seconds: number): string {
  if (seconds < 1) return "now";
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min`;
  if (seconds < 86_400) return `${Math.floor(seconds / 3600)} h`;
  return `${Math.floor(seconds / 86_400)} d`;
}

/** "1 234": narrow no-break spaces between thousands. */
export function grouped(n: number): string {
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/** "0", "0.4", "12": a rate, with a decimal only where it says something. */
export function perSecond(rate: number): string {
  if (rate === 0) return "0";
  if (rate < 0.05) return "<0.1";
  return rate < 9.95 ? rate.toFixed(1) : grouped(rate);
}

/** Host and path of a URL: what may be read aloud. The pin is in what is cut off. */
export function shortUrl(url: string): string {
  const bare = (url.split(/[?#]/, 1)[0] ?? "").replace(/^[a-z]+:\/\//i, "");
  return bare.replace(/\/$/, "");
}
