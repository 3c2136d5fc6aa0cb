import { createRoot } from "react-dom/client";
import { common, operator, speak } from "../texts";
import { Projector } from "./projector";
import "./styles.css";
import "./invitation.css";
import "../map/map.css";
import "./stage.css";
import "./projector.css";

async function german(): Promise<void> {
  const { common: shared, operator: own } = await import("../texts/de");
  Object.assign(common, shared);
  Object.assign(operator, own);
}

const root = document.getElementById("root");
if (root) void speak(german, () => operator.projectorTitle).then(() => createRoot(root).render(<Projector />));
