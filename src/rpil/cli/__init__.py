"""The command `rpil`; nothing is imported here, so that even the first moment can be interrupted in order."""

import sys

INTERRUPTED = 130
"""The exit code after an interruption, as shells have it."""


def tell_of_interruption(kept: str = "") -> None:
    """Say on stderr that the command was interrupted, and what it leaves."""
    print(f"rpil: interrupted; {kept or 'nothing was written'}.", file=sys.stderr, flush=True)
