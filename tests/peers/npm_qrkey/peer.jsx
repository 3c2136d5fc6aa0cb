// The published hook `useQrKey` (npm qrkey 0.12.0), unmodified, in plain Node, as a process that reads and writes
// JSON lines. ../README.md lists them.

import { say, lines, finish } from "./stdio.js";
import "./storage.js";
import { counts, watch } from "./wiretap.js";

import { useEffect, useRef, useState } from "react";
import TestRenderer from "react-test-renderer";
import { useQrKey } from "qrkey";

function options(argv) {
  const given = Object.fromEntries(
    argv.map((word, i) => [word, argv[i + 1]]).filter(([word]) => word.startsWith("--")),
  );
  const need = ["--pin", "--host", "--port"].filter((name) => !given[name]);
  if (need.length > 0) {
    console.error(`usage: peer.cjs --pin DIGITS --host HOST --port WEBSOCKET_PORT [--version 5|4] [--root /qrkey]`);
    process.exit(2);
  }
  return { version: "5", root: "/qrkey", ...Object.fromEntries(Object.entries(given).map(([k, v]) => [k.slice(2), v])) };
}

const option = options(process.argv.slice(2));
const lastDigits = (pin) => String(pin).slice(-4);

// What the newest render knows; commands from stdin act on it, as a page's buttons act on the newest render.
const latest = { clientId: null, pin: null, subscribed: false, announced: null, delivered: 0 };

// The application's half of the hook: it stays the same function in all renders, as a state setter would. (With a new
// function in every render the hook delivers messages more than once.)
function deliver(message) {
  latest.delivered += 1;
  say("message", message);
}

// "ready" once, and "moved" after each rotation: not before the broker has acknowledged the subscriptions.
function announce() {
  if (!latest.subscribed || !latest.clientId || latest.announced === latest.pin) return;
  if (latest.announced === null) say("ready", { client_id: latest.clientId });
  else say("moved", { pin: lastDigits(latest.pin) });
  latest.announced = latest.pin;
}

watch(() => {
  latest.subscribed = true;
  announce();
});

function Page({ handle }) {
  const [searchParams, setSearchParams] = useState(
    () =>
      new URLSearchParams({
        pin: option.pin,
        mqtt_host: option.host,
        mqtt_port: option.port,
        mqtt_version: option.version,
        mqtt_use_ssl: "False",
      }),
  );
  const [, clientId, mqttData, , publish, publishCommand, sendRequest] = useQrKey({
    rootTopic: option.root,
    setQrKeyMessage: deliver,
    searchParams,
    // A router makes a new object of the one that the hook has emptied in place; without it nothing renders again.
    setSearchParams: (params) => setSearchParams(new URLSearchParams(params)),
  });
  handle.current = { publish, publishCommand, sendRequest };

  const pin = mqttData?.pin ?? null;
  const shownPin = useRef(null);
  useEffect(() => {
    if (shownPin.current !== null && shownPin.current !== pin) latest.subscribed = false;
    shownPin.current = pin;
    latest.pin = pin;
    latest.clientId = clientId;
    announce();
  }, [pin, clientId]);
  return null;
}

const handle = { current: null };
// Without the flag this renderer is React 17's: every state is rendered at once, and nothing is ever batched away.
TestRenderer.create(<Page handle={handle} />, { unstable_isConcurrent: true });

function act(line) {
  const order = JSON.parse(line);
  const { publish, publishCommand, sendRequest } = handle.current;
  switch (order.do) {
    case "command":
      publishCommand(order.address, order.application ?? "0", order.name, order.payload);
      break;
    case "request": {
      const { do: _, ...words } = order;
      sendRequest({ reply: latest.clientId, ...words });
      break;
    }
    case "publish":
      publish(order.topic, order.payload);
      break;
    case "counts":
      say("counts", { ...counts, delivered: latest.delivered });
      break;
    case "quit":
      finish();
      break;
    default:
      say("error", { reason: `unknown order ${order.do}` });
  }
}

lines()
  .on("line", act)
  .on("close", finish);
