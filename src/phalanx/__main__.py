"""Entry point of `phalanx` and `python -m phalanx`."""

import _signal as signal  # type: ignore[import-not-found]  # `signal` imports more modules, and Ctrl-C may come meanwhile

# The imports take about a second. Until they are done, Ctrl-C ends the process silently, since a module could
# swallow KeyboardInterrupt. Afterwards `implemented_by` in `cli/options.py` handles it.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
# `release/phalanx` blocks SIGINT while Python and an installer's script start.
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

from phalanx.cli import main  # noqa: E402  # after the signal is set

if __name__ == "__main__":
    main()
