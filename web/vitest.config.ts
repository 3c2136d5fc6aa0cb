import { defineConfig } from "vitest/config";

export default defineConfig({
  test: {
    include: ["tests/**/*.test.{ts,tsx}", "operator/**/*.test.{ts,tsx}"],
    environment: "node",
    // Two cores, shared.
    maxWorkers: 2,
    testTimeout: 20_000,
  },
});
