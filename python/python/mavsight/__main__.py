"""The command `mavsight`, from the compiled part of the package."""

import signal
import sys

from ._mavsight import command


def main() -> int:
    """Does what the command line says."""
    # Python would note Ctrl-C only after the command has ended.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return command(["mavsight", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
