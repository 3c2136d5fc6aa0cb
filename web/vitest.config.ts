import { configDefaults, defineConfig } from "vitest/config";

// It stands in for a module that others use as it is.
const ALONE = "tests/session_connection.test.ts";
// Ends what hangs, judges nothing: these run on what others leave of the machine.
const PATIENT = { environment: "node", testTimeout: 120_000, hookTimeout: 60_000 } as const;

export default defineConfig({
  test: {
    // Two cores, shared.
    maxWorkers: 2,
    projects: [
      {
        test: {
          ...PATIENT,
          name: "together",
          include: ["tests/**/*.test.{ts,tsx}", "operator/**/*.test.{ts,tsx}"],
          exclude: [...configDefaults.exclude, ALONE],
          // To load all modules anew for each file takes longer than the tests.
          isolate: false,
        },
      },
      { test: { ...PATIENT, name: "alone", include: [ALONE] } },
    ],
  },
});
