"""What `phalanx` and `python -m phalanx` start."""

import _signal as signal  # type: ignore[import-not-found]  # `signal` imports more, and Ctrl-C may come meanwhile

# While a second's worth of modules is imported, Ctrl-C ends us without a word: a module may swallow what
# Python makes of it. Then `runs`, in `cli/options.py`, has it answered.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
# `release/phalanx` has had it wait until here, while Python and an installer's script began.
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

from phalanx.cli import main  # noqa: E402  # only now

if __name__ == "__main__":
    main()
