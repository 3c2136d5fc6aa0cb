// Why messages were refused, for the person at the exhibition. The reasons are those of docs/spec/link.md.

import { operator as texts } from "../texts";

/** How worried to be: nothing to do, somebody to help, somebody may be trying something, or our own fault. */
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

/** What to say about a reason; one that a newer gateway invented is shown by its bare name. */
export function reason(name: string): Reason {
  if (!isKnown(name)) return { title: name, text: texts.unknownReason, tone: "harmless" };
  const [title, text] = texts.reasons[name];
  return { title, text, tone: TONES[name] };
}

function isKnown(name: string): name is keyof typeof TONES {
  return Object.hasOwn(TONES, name);
}
