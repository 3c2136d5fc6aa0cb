"""What `phalanx` and `python -m phalanx` start."""

import signal

# While a second's worth of modules is imported, Ctrl-C ends us without a word; then `run_command` answers it.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from phalanx.cli import main

if __name__ == "__main__":
    main()
