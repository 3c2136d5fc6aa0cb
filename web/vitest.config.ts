import { defineConfig } from "vitest/config";

export default defineConfig({
  test: {
    include: ["tests/**/*.test.{ts,tsx}", "operator/**/*.test.{ts,tsx}"],
    environment: "node",
    // Two cores, shared. What a file changes it puts back: to load all anew for each takes longer than the tests.
    maxWorkers: 2,
    isolate: false,
    // Ends what hangs, judges nothing: these run on what others leave of the machine.
    testTimeout: 120_000,
    hookTimeout: 60_000,
  },
});
