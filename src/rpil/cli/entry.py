"""What the shell starts as ``rpil``: an interruption of the first imports ends in a sentence, as any later one."""

import sys

from rpil.cli import INTERRUPTED, tell_of_interruption


def main() -> None:
    """Import the command, which takes a moment, and call it."""
    try:
        from rpil.cli.main import main as command

        command(prog_name="rpil")  # also as python -m rpil
    except KeyboardInterrupt:
        tell_of_interruption()
        sys.exit(INTERRUPTED)
