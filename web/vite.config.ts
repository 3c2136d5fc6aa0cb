// One page per build, chosen by PAGE. The gateway serves each from its own folder, under any path, so assets have
// addresses relative to their page.

import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import react from "@vitejs/plugin-react";
import { type AliasOptions, defineConfig, type Plugin } from "vite";

const PAGES = ["visitor", "operator", "viewer"];

/** Write a compressed copy beside each script and stylesheet, for clients that accept it: a third of the size. */
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
 * Load the stylesheet after the first picture, which needs none: it is styled by attributes, as the content security
 * policy allows no inline styles. Load the session and the map at once, and not only when a visitor joins.
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

/** Replace vite's preload helper, which costs 1.3 kB: parts of a page need no stylesheets or scripts of their own. */
const plainImports: Plugin = {
  name: "plain imports",
  enforce: "pre",
  load: (id) => (id.includes("vite/preload-helper") ? "export const __vitePreload = (load) => load();" : undefined),
};

/** Preact instead of React: a tenth of its size, for pages loaded over a phone's network. */
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
      // A data: URL would need an exception in the content security policy.
      assetsInlineLimit: 0,
      modulePreload: { polyfill: false },
      // mqtt.js alone is 370 kB.
      chunkSizeWarningLimit: 900,
      target: "es2022",
      reportCompressedSize: false,
    },
  };
});
