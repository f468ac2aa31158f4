"""The command `schuler`, which the package installs."""

import sys

from schuler._schuler import command


def main() -> int:
    """Runs the command with the arguments of this process; gives its exit status."""
    return command(sys.argv)
