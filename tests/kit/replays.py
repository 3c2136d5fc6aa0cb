"""A bundled controller led through readings and frames, and what each of its checkpoints must keep to."""

from __future__ import annotations

from phalanx.errors import PeerError


def play(this, entries, t=0, step=0):
    """Outputs and state after each entry."""
    seen = []
    for is_input, gap, frame, read in entries:
        t += gap
        outputs = this.on_input(step, t, read) if is_input else this.on_recv(t, frame)
        step += is_input
        seen.append((outputs, this.encode(), t, step))
    return seen


def is_taken_whole_or_refused(this, encoding):
    """Whether a foreign checkpoint is now the controller's own, or has changed nothing."""
    before = this.encode()
    try:
        this.decode(encoding)
    except PeerError:
        return this.encode() == before
    return this.encode() == encoding
