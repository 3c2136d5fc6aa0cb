// eslint, because rules that know the types find errors that other linters cannot (such as unawaited promises). It is pure
// JavaScript, so one lock file serves every platform.

import process from "node:process";
import js from "@eslint/js";
import hooks from "eslint-plugin-react-hooks";
import { defineConfig } from "eslint/config";
import tseslint from "typescript-eslint";

// The React compiler reads each component for the others of its rules: a fourth of the time. `npm run lint:long` has all.
const quick = {
  plugins: { "react-hooks": hooks },
  rules: { "react-hooks/rules-of-hooks": "error", "react-hooks/exhaustive-deps": "warn" },
};

export default defineConfig(
  js.configs.recommended,
  tseslint.configs.strictTypeChecked,
  process.env.LINT === "long" ? hooks.configs.flat.recommended : quick,
  {
    languageOptions: { parserOptions: { projectService: { allowDefaultProject: ["eslint.config.js"] } } },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      eqeqeq: "error",
      "no-console": "error",
      "prefer-const": "error",
      "@typescript-eslint/consistent-type-imports": "error",
      // Numbers in a template are plain; anything else would print as [object Object].
      "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
      // A promise is also what an interface asks for, or what a test waits with.
      "@typescript-eslint/require-await": "off",
      // Both pages follow things outside of React: the link, the address bar, a gateway that is polled.
      "react-hooks/set-state-in-effect": "off",
      // A click or a timer may begin something that takes its time.
      "@typescript-eslint/no-misused-promises": ["error", { checksVoidReturn: false }],
      // The types promise what some browsers lack: requestFullscreen on iPhones.
      "@typescript-eslint/no-unnecessary-condition": "off",
      // A listener may answer with what its only statement gives.
      "@typescript-eslint/no-confusing-void-expression": ["error", { ignoreArrowShorthand: true }],
    },
  },
);
