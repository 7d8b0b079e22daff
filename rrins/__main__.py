"""``python -m rrins`` is the command ``rrins``."""

from rrins.host_tools.cli.main import main

if __name__ == "__main__":
    main()
