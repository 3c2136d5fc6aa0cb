// Explanations of refused messages for operators. The reasons are those of docs/spec/link.md.

import { operator as texts } from "../texts";

/** Severity: harmless, a visitor needs help, suspicious, or an error of ours. */
export type Tone = "harmless" | "help" | "suspicious" | "fault";

export interface Reason {
  readonly title: string;
  readonly text: string;
  readonly tone: Tone;
}

const TONES: Readonly<Record<keyof typeof texts.reasons, Tone>> = {
  overrun: "suspicious",
  too_large: "suspicious",
  malformed_jwe: "suspicious",
  not_authentic: "suspicious",
  malformed_envelope: "harmless",
  stale: "help",
  replayed: "suspicious",
  cache_full: "suspicious",
  wrong_topic: "harmless",
  bad_payload: "harmless",
  late: "suspicious",
  held: "harmless",
  unknown_secret: "help",
  tries_used_up: "suspicious",
  not_allowed: "harmless",
  busy: "harmless",
  too_many: "suspicious",
  malformed_record: "suspicious",
  unexpected: "suspicious",
  unknown: "harmless",
  handler_failed: "fault",
  defect: "fault",
};

/** The explanation of a reason; unknown ones of newer gateways are shown by name. */
export function reason(name: string): Reason {
  if (!isKnown(name)) return { title: name, text: texts.unknownReason, tone: "harmless" };
  const [title, text] = texts.reasons[name];
  return { title, text, tone: TONES[name] };
}

function isKnown(name: string): name is keyof typeof TONES {
  return Object.hasOwn(TONES, name);
}
