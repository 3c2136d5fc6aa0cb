"""Bounded-time interaction (docs/spec/rebound.md): logs, checkpoints, audits and tokens, without any I/O."""
