// Why messages were refused, for the person at the exhibition. The reasons are those of docs/spec/link.md.

/** How worried to be: nothing to do, somebody to help, somebody may be trying something, or our own fault. */
export type Tone = "harmless" | "help" | "suspicious" | "fault";

export interface Reason {
  readonly title: string;
  readonly text: string;
  readonly tone: Tone;
}

export const TONES: Readonly<Record<Tone, string>> = {
  harmless: "harmless",
  help: "someone needs help",
  suspicious: "keep an eye on it",
  fault: "our fault",
};

const REASONS: Readonly<Record<string, Reason>> = {
  overrun: {
    title: "A flood",
    text: "More came at once than can be read, so the rest was thrown away unread. Orders of visitors may be among it.",
    tone: "suspicious",
  },
  too_large: {
    title: "Too large",
    text: "Longer than any message of our page. It was not even decrypted.",
    tone: "suspicious",
  },
  malformed_jwe: {
    title: "Not our encryption",
    text: "Not a message of ours at all: another program on the broker, or somebody probing.",
    tone: "suspicious",
  },
  not_authentic: {
    title: "Wrong key",
    text: "Sealed without the current code, or altered on the way. Whoever runs or watches the broker can send these; they open nothing.",
    tone: "suspicious",
  },
  malformed_envelope: {
    title: "Unreadable inside",
    text: "Sealed with the right code but not in the agreed form: somebody’s own program, with a mistake in it.",
    tone: "harmless",
  },
  stale: {
    title: "Too old, or from the future",
    text: "More than 30 s off our clock. Nearly always a phone whose clock is wrong: have its time set to automatic.",
    tone: "help",
  },
  replayed: {
    title: "Sent twice",
    text: "A copy of a message that was already carried out. Somebody recorded it and played it back; it did nothing.",
    tone: "suspicious",
  },
  cache_full: {
    title: "Too many at once",
    text: "More messages in 30 s than we can tell from copies, so new ones are refused until it calms down.",
    tone: "suspicious",
  },
  wrong_topic: {
    title: "Wrong address",
    text: "Sent to a place that does not exist, or under a code that has ended.",
    tone: "harmless",
  },
  bad_payload: {
    title: "Impossible order",
    text: "A number is missing or out of range, such as a speed of 900. Not carried out.",
    tone: "harmless",
  },
  late: {
    title: "Came too late",
    text: "A joystick's order that had to wait for more than 300 ms: whoever gave it may have let go. Not carried out.",
    tone: "suspicious",
  },
  held: {
    title: "All stopped",
    text: "A visitor wanted to drive while you had stopped all robots. Not carried out.",
    tone: "harmless",
  },
  unknown_secret: {
    title: "Invalid code",
    text: "A code that has changed, a ticket that is used up, or somebody who was removed. They have to scan the code again.",
    tone: "help",
  },
  tries_used_up: {
    title: "Room codes tried too often",
    text: "More than ten tries from one address, or 120 in all, within an hour. QR codes still work.",
    tone: "suspicious",
  },
  not_allowed: {
    title: "Not theirs to do",
    text: "A visitor wanted to drive a robot that its role, ticket or turn does not allow. Not carried out.",
    tone: "harmless",
  },
  busy: {
    title: "Somebody else drives it",
    text: "A visitor wanted to drive a robot that another one drives. Not carried out.",
    tone: "harmless",
  },
  too_many: {
    title: "Too many at once",
    text: "More commands, requests or connections than one visitor may send. The rest was not carried out.",
    tone: "suspicious",
  },
  malformed_record: {
    title: "Not of our protocol",
    text: "Bytes that are no message of a session: another program, or somebody probing.",
    tone: "suspicious",
  },
  unexpected: {
    title: "Out of turn",
    text: "A message that its sender may not send at that moment: another program, or somebody probing.",
    tone: "suspicious",
  },
  unknown: {
    title: "No such robot or order",
    text: "Meant for a robot that is not here (any more), or a kind of order that we do not have.",
    tone: "harmless",
  },
  handler_failed: {
    title: "We failed",
    text: "The message was fine; the gateway broke while carrying it out. Its log says where. Please report it.",
    tone: "fault",
  },
  defect: {
    title: "A check of ours failed",
    text: "Our own code made a mistake while reading the message, and rejected it. The log says where. Please report it.",
    tone: "fault",
  },
};

/** What to say about a reason; one that a newer gateway invented is shown by its bare name. */
export function reason(name: string): Reason {
  return REASONS[name] ?? { title: name, text: "This page does not know this reason.", tone: "harmless" };
}
