// Topics: made from checked words, and taken apart again (Qrkey Table I).
//
// Only this file joins or splits a topic, so that no peer's words ever reach one unchecked.

import { WrongTopic } from "./errors";

const SWARM = "0000";
const ADDRESS = /^[0-9A-Za-z_-]{1,64}$/;
const APPLICATION = /^[0-9]{1,3}$/;
const NAME = /^[0-9A-Za-z_-]{1,64}$/;
const CLIENT_ID = /^[0-9A-Za-z_.:-]{1,128}$/;

export type SubTopic =
  | { readonly kind: "request" }
  | { readonly kind: "notify" }
  | { readonly kind: "reply"; readonly client_id: string }
  | { readonly kind: "command"; readonly address: string; readonly application: string; readonly name: string };

/** Whether a robot's address can be put into a topic. */
export function isAddress(word: unknown): word is string {
  return typeof word === "string" && ADDRESS.test(word);
}

/** Whether a client id can be put into a topic. */
export function isClientId(word: unknown): word is string {
  return typeof word === "string" && CLIENT_ID.test(word);
}

/** The topic on the broker. @throws WrongTopic: a word outside its grammar. */
export function fullTopic(root: string, epochTopic: string, sub: SubTopic): string {
  return `${root}/${epochTopic}/${belowEpoch(sub)}`;
}

/** The part of a topic that says what it is about. @throws WrongTopic: a word outside its grammar. */
export function belowEpoch(sub: SubTopic): string {
  switch (sub.kind) {
    case "command":
      checkCommand(sub.address, sub.application, sub.name);
      return `command/${SWARM}/${sub.address}/${sub.application}/${sub.name}`;
    case "reply":
      if (!isClientId(sub.client_id)) throw new WrongTopic("not a client id");
      return `reply/${sub.client_id}`;
    default:
      return sub.kind;
  }
}

/** What `topic` is about, under this root and epoch. @throws WrongTopic */
export function splitTopic(root: string, epochTopic: string, topic: string): SubTopic {
  const base = `${root}/${epochTopic}/`;
  if (!topic.startsWith(base)) throw new WrongTopic("not under this root and epoch");
  const words = topic.slice(base.length).split("/");
  const [kind, ...rest] = words;
  if ((kind === "request" || kind === "notify") && rest.length === 0) return { kind };
  if (kind === "reply" && rest.length === 1) {
    const client_id = rest[0] ?? "";
    if (!isClientId(client_id)) throw new WrongTopic("not a client id");
    return { kind, client_id };
  }
  if (kind === "command" && rest.length === 4 && rest[0] === SWARM) {
    const [, address = "", application = "", name = ""] = rest;
    checkCommand(address, application, name);
    return { kind, address, application, name };
  }
  throw new WrongTopic("no such sub-topic");
}

function checkCommand(address: string, application: string, name: string): void {
  if (!ADDRESS.test(address) || !APPLICATION.test(application) || !NAME.test(name)) {
    throw new WrongTopic("not a command topic");
  }
}
