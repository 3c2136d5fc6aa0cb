import { createRoot } from "react-dom/client";
import { common, speak, viewer } from "../texts";
import { App } from "./app";
import { Player } from "./player";
import "../visitor/page.css";
import "../map/map.css";
import "./viewer.css";

async function german(): Promise<void> {
  const { common: shared, viewer: own } = await import("../texts/de");
  Object.assign(common, shared);
  Object.assign(viewer, own);
}

const root = document.getElementById("root");
const player = new Player(matchMedia("(prefers-reduced-motion: reduce)").matches);
if (root) void speak(german, () => viewer.title).then(() => createRoot(root).render(<App player={player} />));
