import { createRoot } from "react-dom/client";
import { App } from "./app";
import { Player } from "./player";
import "../visitor/page.css";
import "../map/map.css";
import "./viewer.css";

const root = document.getElementById("root");
const player = new Player(matchMedia("(prefers-reduced-motion: reduce)").matches);
if (root) createRoot(root).render(<App player={player} />);
