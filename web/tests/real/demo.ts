// The built page with a made-up swarm, to look at: `npx tsx tests/real/demo.ts [robots] [old]`, then open the link.

import { Pin, qrFragment } from "../../client";
import { Broker } from "./broker";
import { FakeSwarm } from "./fake_swarm";
import { Site } from "./site";

const robots = Number(process.argv[2] ?? 12);
const old = process.argv[3] === "old";
const pin = "123456789012";
const broker = await Broker.start();
const site = await Site.start();
const swarm = new FakeSwarm({ broker: broker.url, pin, robots, frames: !old });
const invitation = { pin: new Pin(pin), broker: broker.url, root: "/qrkey", mqtt: 5 } as const;
process.stdout.write(`http://127.0.0.1:${site.port}/${qrFragment(invitation)}\n`);
process.once("SIGINT", () => {
  swarm.stop();
  void site.stop().then(() => broker.stop());
});
