"""What the shell starts as ``rpil``: an interruption at any moment, also of an import, ends in one sentence."""

import signal
import sys
from threading import Timer
from types import FrameType

from rpil.cli import INTERRUPTED, tell_of_interruption

IMPORTS = "<frozen importlib._bootstrap>"
RETRY_SECONDS = 0.02


class WithoutPandas:
    """Finds no pandas, which pyarrow imports for its first array: that takes longer than to read a small file."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name == "pandas":
            raise ModuleNotFoundError(name=name)


def main() -> None:
    """Import the command, which takes a moment, and call it."""
    sys.meta_path.insert(0, WithoutPandas)
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, interrupt)
        from rpil.cli.main import main as command

        command(prog_name="rpil")  # also as python -m rpil
    except KeyboardInterrupt:
        tell_of_interruption()
        sys.exit(INTERRUPTED)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``, after the import that runs: modules in C turn it into other errors, or lose it."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORTS:
            again = Timer(RETRY_SECONDS, signal.raise_signal, (number,))
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt
