// Shields: which neighbours vouch for a robot and for how long, and results of audits (docs/spec/vocabulary.md).

import { isObject, type Json } from "./core/json";
import { readNumber, readText } from "./reading";

/** What a robot needs to run: number of tokens from different neighbours, and their validity. */
export interface ShieldTerms {
  readonly needed: number;
  readonly full_ms: number;
}

export interface Voucher {
  /** The auditor's number in updates. */
  readonly auditor: number;
  /** When its token expires, by the reader's clock. */
  readonly until_ms: number;
}

export interface Shield {
  readonly safeMode: boolean;
  /** The longest first. */
  readonly vouchers: readonly Voucher[];
}

/** Result of an audit; refusal is "" if a token was issued. */
export interface Audit {
  readonly auditor: string;
  readonly auditee: string;
  readonly refusal: string;
  readonly at_ms: number;
}

/** Less than this until the robot is stopped is shown as a warning: by then neighbours should have vouched anew. */
export const LOW_MS = 3000;

const MOST_NEEDED = 16;
const MOST_VOUCHERS = 2 * MOST_NEEDED;
const LONGEST_MS = 3_600_000;
const DECISECOND_MS = 100;
const LONGEST_REFUSAL = 48;

/** From the answer to request 1; undefined if robots do not audit each other. */
export function readTerms(words: Json): ShieldTerms | undefined {
  if (!isObject(words)) return undefined;
  const needed = readNumber(words["tokens_needed"], 1, MOST_NEEDED);
  const full_ms = readNumber(words["t_val_ms"], 1, LONGEST_MS);
  return needed === undefined || full_ms === undefined ? undefined : { needed: Math.floor(needed), full_ms };
}

/** `[safe, [[auditor, deciseconds], …]]`, received at `at_ms`. */
export function readShield(words: Json | undefined, at_ms: number): Shield | undefined {
  if (!Array.isArray(words)) return undefined;
  const [safe, rows] = words as readonly Json[];
  if ((safe !== 0 && safe !== 1) || !Array.isArray(rows)) return undefined;
  const vouchers: Voucher[] = [];
  for (const row of (rows as readonly Json[]).slice(0, MOST_VOUCHERS)) {
    const [auditor, left] = Array.isArray(row) ? (row as readonly Json[]) : [];
    const number = readNumber(auditor, 0, Number.MAX_SAFE_INTEGER);
    const deciseconds = readNumber(left, 0, LONGEST_MS / DECISECOND_MS);
    if (number === undefined || deciseconds === undefined) continue;
    vouchers.push({ auditor: number, until_ms: at_ms + deciseconds * DECISECOND_MS });
  }
  return { safeMode: safe === 1, vouchers };
}

/** `[auditor, auditee, refusal]`; undefined if it names unknown robots. */
export function readAudit(words: Json, numbers: ReadonlyMap<number, string>, at_ms: number): Audit | undefined {
  const [auditor, auditee, refusal] = Array.isArray(words) ? (words as readonly Json[]) : [];
  const to = typeof auditee === "number" ? numbers.get(auditee) : undefined;
  return to === undefined ? undefined : readVerdict([auditor ?? null, refusal ?? null], to, numbers, at_ms);
}

/** `[auditor, refusal]`: the last audit of `auditee`; undefined for none, or for an unknown auditor. */
export function readVerdict(
  words: Json | undefined,
  auditee: string,
  numbers: ReadonlyMap<number, string>,
  at_ms: number,
): Audit | undefined {
  const [auditor, refusal] = Array.isArray(words) ? (words as readonly Json[]) : [];
  const from = typeof auditor === "number" ? numbers.get(auditor) : undefined;
  if (from === undefined || typeof refusal !== "string") return undefined;
  // An audit refused for an unreadable reason still counts as refused.
  const reason = refusal === "" ? "" : (readText(refusal, LONGEST_REFUSAL) ?? "refused");
  return { auditor: from, auditee, refusal: reason, at_ms };
}

/** The tokens valid at `now_ms`, at most as many as needed: those valid longest. */
export function counting({ vouchers }: Shield, { needed }: ShieldTerms, now_ms: number): readonly Voucher[] {
  return vouchers.filter(({ until_ms }) => until_ms > now_ms).slice(0, needed);
}
