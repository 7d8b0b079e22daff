"""The command ``rrins``, which is ``python -m rrins``, too."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C while it is still imported is one line, as it is later."""
    try:
        from rrins.host_tools.cli.main import main as run
    except KeyboardInterrupt:
        print("rrins: stopped by the user", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
