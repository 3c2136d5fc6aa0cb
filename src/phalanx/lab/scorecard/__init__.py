"""The scorecard: every attack against every defence in every protocol, and what came of it."""
