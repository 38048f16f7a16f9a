"""`python -m paddlectl` is the command `paddlectl`."""

import sys


def main() -> int:
    """Runs the command line and gives its exit code; ^C while that is still loaded is no traceback either."""
    try:
        from paddlectl.cli.app import main as run

        return run()
    except KeyboardInterrupt:
        import signal

        signal.signal(signal.SIGINT, signal.SIG_IGN)  # at the exit, too
        return 130


if __name__ == "__main__":
    sys.exit(main())
