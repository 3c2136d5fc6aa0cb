import { createRoot } from "react-dom/client";
import { common, speak, visitor } from "../texts";
import { App } from "./app";
import "./page.css";
import "../map/map.css";
import "./cockpit.css";
import "./no_code.css";

async function german(): Promise<void> {
  const { common: shared, visitor: own } = await import("../texts/de");
  Object.assign(common, shared);
  Object.assign(visitor, own);
}

const root = document.getElementById("root");
if (root) void speak(german, () => visitor.title).then(() => createRoot(root).render(<App />));
