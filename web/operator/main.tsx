import { createRoot } from "react-dom/client";
import { App } from "./app";
import "./styles.css";
import "./invitation.css";
import "./tables.css";
import "../map/map.css";
import "./stage.css";
import "./mission/editor.css";

const root = document.getElementById("root");
if (root) createRoot(root).render(<App />);
