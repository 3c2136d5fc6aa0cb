// One page a build, chosen by PAGE: the gateway serves each from a folder of its own, under any path, so every asset is
// addressed relative to its page.

import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import react from "@vitejs/plugin-react";
import { type AliasOptions, defineConfig, type Plugin } from "vite";

const PAGES = ["visitor", "operator", "viewer"];

/** Beside each script and stylesheet a packed one, which the gateway sends to whoever takes it: a third, on a slow network. */
const packed: Plugin = {
  name: "packed",
  writeBundle({ dir }, bundle) {
    for (const [name, file] of Object.entries(bundle)) {
      if (!dir || !/\.(js|css)$/.test(name)) continue;
      writeFileSync(join(dir, `${name}.gz`), gzipSync(file.type === "chunk" ? file.code : file.source, { level: 9 }));
    }
  },
};

/**
 * Put the stylesheet behind the first picture, which waits for nothing: it has its looks in attributes, as the content
 * security policy allows no styles of its own. Load the session and the map from the beginning, and not when they are needed.
 */
const inOrder: Plugin = {
  name: "in order",
  transformIndexHtml: {
    order: "post",
    handler(html, { bundle }) {
      const links = html.match(/^\s*<link rel="stylesheet"[^>]*>\n/gm) ?? [];
      const without = links.reduce((rest, link) => rest.replace(link, ""), html);
      const visit = Object.values(bundle ?? {}).find((file) => file.type === "chunk" && file.name === "visit");
      const later = [...links.map((link) => link.trim()), `<link rel="modulepreload" crossorigin href="./${visit?.fileName}">`];
      return without.replace("<noscript>", `${later.join("")}\n    <noscript>`);
    },
  },
};

/** No preloading of what a part needs, which costs 1.3 kB: the parts of a page need only what it has, and its stylesheet. */
const plainImports: Plugin = {
  name: "plain imports",
  enforce: "pre",
  load: (id) => (id.includes("vite/preload-helper") ? "export const __vitePreload = (load) => load();" : undefined),
};

/** A tenth of React's size, for a page that is loaded over a phone's network. */
const PREACT: AliasOptions = [
  { find: /^react$/, replacement: "preact/compat" },
  { find: /^react-dom\/client$/, replacement: "preact/compat/client" },
  { find: /^react\/jsx-runtime$/, replacement: "preact/jsx-runtime" },
];

export default defineConfig(() => {
  const page = process.env["PAGE"] ?? "visitor";
  if (!PAGES.includes(page)) throw new Error(`PAGE is ${page}, and must be one of ${PAGES.join(", ")}`);
  return {
    root: `${import.meta.dirname}/${page}`,
    base: "./",
    plugins: [react(), packed, plainImports, ...(page === "visitor" ? [inOrder] : [])],
    resolve: { alias: page === "visitor" ? PREACT : [] },
    build: {
      outDir: `${import.meta.dirname}/../src/phalanx/gateway/pages/${page}`,
      emptyOutDir: true,
      rolldownOptions: page === "operator" ? { input: ["index", "projector"].map((name) => `${import.meta.dirname}/operator/${name}.html`) } : {},
      // A data: URL would need its own word in the content security policy.
      assetsInlineLimit: 0,
      modulePreload: { polyfill: false },
      // mqtt.js alone is 370 kB.
      chunkSizeWarningLimit: 900,
      target: "es2022",
      reportCompressedSize: false,
    },
  };
});
