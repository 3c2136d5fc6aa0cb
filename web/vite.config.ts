// One page a build, chosen by PAGE: the gateway serves each from a folder of its own, under any path, so every asset is
// addressed relative to its page.

import react from "@vitejs/plugin-react";
import { defineConfig } from "vite";

const PAGES = ["visitor", "operator", "viewer"];

export default defineConfig(() => {
  const page = process.env["PAGE"] ?? "visitor";
  if (!PAGES.includes(page)) throw new Error(`PAGE is ${page}, and must be one of ${PAGES.join(", ")}`);
  return {
    root: `${import.meta.dirname}/${page}`,
    base: "./",
    plugins: [react()],
    build: {
      outDir: `${import.meta.dirname}/../src/phalanx/gateway/pages/${page}`,
      emptyOutDir: true,
      // A data: URL would need its own word in the content security policy.
      assetsInlineLimit: 0,
      modulePreload: { polyfill: false },
      // mqtt.js alone is 370 kB; it is served once, from the LAN.
      chunkSizeWarningLimit: 900,
      target: "es2022",
      reportCompressedSize: false,
    },
  };
});
