import { createRoot } from "react-dom/client";
import { common, operator, speak } from "../texts";
import { App } from "./app";
import "./styles.css";
import "./compromise.css";
import "./invitation.css";
import "./tables.css";
import "../map/map.css";
import "./stage.css";
import "./mission/editor.css";

async function german(): Promise<void> {
  const { common: shared, operator: own } = await import("../texts/de");
  Object.assign(common, shared);
  Object.assign(operator, own);
}

const root = document.getElementById("root");
if (root) void speak(german, () => operator.title).then(() => createRoot(root).render(<App />));
