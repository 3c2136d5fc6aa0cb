import { createRoot } from "react-dom/client";
import { Projector } from "./projector";
import "./styles.css";
import "./invitation.css";
import "../map/map.css";
import "./stage.css";
import "./projector.css";

const root = document.getElementById("root");
if (root) createRoot(root).render(<Projector />);
