import { createRoot } from "react-dom/client";
import { App } from "./app";
import "./page.css";
import "../map/map.css";
import "./cockpit.css";
import "./no_code.css";

const root = document.getElementById("root");
if (root) createRoot(root).render(<App />);
