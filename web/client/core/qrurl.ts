// The link in a QR code: our fragment form, and the published query form (docs/spec/link.md, "QR code").

import { BadQrUrl } from "./errors";
import { Pin } from "./pin";

/** Everything that is needed to join a swarm. */
export interface Invitation {
  readonly pin: Pin;
  /** WebSocket URL of the broker. */
  readonly broker: string;
  /** Topic root, with its leading slash. */
  readonly root: string;
  /** MQTT protocol level: 5, or 4 for 3.1.1. */
  readonly mqtt: 5 | 4;
  /** What visitors say to a broker that asks for a login. */
  readonly login?: BrokerLogin;
}

export interface BrokerLogin {
  readonly username: string;
  readonly password: string;
}

export const DEFAULT_ROOT = "/qrkey";
const DEFAULT_MQTT = "5";
const VERSION = "1";
const LONGEST = 4096;
const LOGIN_LONGEST = 128;
// Whatever follows must stay one topic: no wildcards, no empty level, no trailing slash.
const ROOT = /^(\/[0-9A-Za-z_-]{1,64}){1,8}$/;
const HOST = /^[0-9A-Za-z.-]{1,253}$|^\[[0-9A-Fa-f:.]{2,64}\]$/;
const PORT = /^[0-9]{1,5}$/;

/** The published form's keys, which a page removes from its address once it has read them. */
export const PUBLISHED_KEYS = [
  "use_qrkey",
  "pin",
  "mqtt_host",
  "mqtt_port",
  "mqtt_version",
  "mqtt_use_ssl",
  "mqtt_username",
  "mqtt_password",
];

/**
 * What a QR code's URL says, in either form.
 *
 * @param root used for the published form, which does not name one.
 * @throws BadQrUrl, BadPin
 */
export function parseQrUrl(text: string, root: string = DEFAULT_ROOT): Invitation {
  if (text.length > LONGEST) throw new BadQrUrl("the link is too long");
  const hash = text.indexOf("#");
  const beforeHash = hash < 0 ? text : text.slice(0, hash);
  const fragment = new URLSearchParams(hash < 0 ? "" : text.slice(hash + 1));
  if (fragment.has("pin") || fragment.has("v")) return parseFragment(fragment);
  const mark = beforeHash.indexOf("?");
  const query = new URLSearchParams(mark < 0 ? "" : beforeHash.slice(mark + 1));
  if (query.has("pin")) return parsePublished(query, root);
  throw new BadQrUrl("no pin in this link");
}

/** An invitation from words that a person typed. @throws BadQrUrl, BadPin */
export function invitation(pin: string, broker: string, root: string, mqtt: string, login?: BrokerLogin): Invitation {
  return {
    pin: new Pin(pin),
    broker: checkedBroker(broker),
    root: checkedRoot(root),
    mqtt: checkedMqtt(mqtt),
    ...(login && { login }),
  };
}

/** The fragment form, to be appended to the address of the visitor page. */
export function qrFragment({ pin, broker, root, mqtt, login }: Invitation): string {
  const named = login && { user: login.username, password: login.password };
  const words = { v: VERSION, pin: pin.reveal(), broker, root, mqtt: String(mqtt), ...named };
  return `#${Object.entries(words)
    .map(([key, value]) => `${key}=${encodeURIComponent(value)}`)
    .join("&")}`;
}

function parseFragment(words: URLSearchParams): Invitation {
  if (one(words, "v") !== VERSION) throw new BadQrUrl("a link of another version");
  return invitation(
    one(words, "pin"),
    one(words, "broker"),
    one(words, "root", DEFAULT_ROOT),
    one(words, "mqtt", DEFAULT_MQTT),
    checkedLogin(one(words, "user", ""), one(words, "password", "")),
  );
}

function parsePublished(words: URLSearchParams, root: string): Invitation {
  const host = one(words, "mqtt_host");
  const port = one(words, "mqtt_port");
  const ssl = one(words, "mqtt_use_ssl", "False").toLowerCase();
  if (!HOST.test(host)) throw new BadQrUrl("the broker's host is not a host name");
  if (!PORT.test(port)) throw new BadQrUrl("the broker's port is not a number");
  if (ssl !== "true" && ssl !== "false") throw new BadQrUrl("mqtt_use_ssl is neither True nor False");
  const broker = `${ssl === "true" ? "wss" : "ws"}://${host}:${port}/mqtt`;
  const login = checkedLogin(one(words, "mqtt_username", ""), one(words, "mqtt_password", ""));
  return invitation(one(words, "pin"), broker, root, one(words, "mqtt_version", DEFAULT_MQTT), login);
}

/** At most one: of two, two readers could each take another. */
function one(words: URLSearchParams, key: string, ifMissing?: string): string {
  const values = words.getAll(key);
  const value = values[0] ?? ifMissing;
  if (value === undefined) throw new BadQrUrl(`no ${key} in this link`);
  if (values.length > 1) throw new BadQrUrl(`more than one ${key} in this link`);
  return value;
}

function checkedBroker(text: string): string {
  let url: URL;
  try {
    url = new URL(text);
  } catch {
    throw new BadQrUrl("the broker's address is not a URL");
  }
  if (url.protocol !== "ws:" && url.protocol !== "wss:")
    throw new BadQrUrl("the broker's address is not ws:// or wss://");
  // Browsers refuse to open a WebSocket with one.
  if (url.hash !== "" || text.includes("#")) throw new BadQrUrl("the broker's address has a fragment");
  // It would be shown, kept and sent in the clear with the rest of the link.
  if (url.username !== "" || url.password !== "") throw new BadQrUrl("the broker's address has a login");
  if (url.port === "0") throw new BadQrUrl("the broker's port is 0");
  return text;
}

/** What visitors say to a broker, if anything. @throws BadQrUrl */
export function checkedLogin(username: string, password: string): BrokerLogin | undefined {
  if (username === "" && password !== "") throw new BadQrUrl("a password without a name");
  const bytes = Math.max(...[username, password].map((text) => new TextEncoder().encode(text).length));
  if (bytes > LOGIN_LONGEST || /\p{C}|(?! )\p{Z}/u.test(username + password))
    throw new BadQrUrl("a login that is none");
  return username === "" ? undefined : { username, password };
}

function checkedRoot(text: string): string {
  if (!ROOT.test(text)) throw new BadQrUrl("the topic root is not a path like /qrkey");
  return text;
}

function checkedMqtt(text: string): 5 | 4 {
  if (text === "5") return 5;
  if (text === "4") return 4;
  throw new BadQrUrl("the MQTT version is neither 5 nor 4");
}
