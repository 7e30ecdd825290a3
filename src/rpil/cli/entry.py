"""What the shell starts as ``rpil``: an interruption at any moment, also of an import, ends in one sentence."""

import faulthandler
import os
import signal
import sys
from functools import partial
from threading import Timer
from types import FrameType

from rpil.cli import INTERRUPTED, tell_of_interruption


class WithoutPandas:
    """Hides pandas from pyarrow, which imports it for its first array: that takes longer than to read a small file."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        """Refuse pandas where a function of rpil called pyarrow, whose C has no frames; environments may import it."""
        frame = sys._getframe(1)
        while frame.f_back is not None and "importlib" in frame.f_code.co_filename:
            frame = frame.f_back
        if name == "pandas" and frame.f_globals.get("__name__", "").partition(".")[0] in ("rpil", "pyarrow"):
            raise ModuleNotFoundError(name=name)


def main() -> None:
    """Import the command, which takes a moment, and call it."""
    if sys.stderr is not None:
        faulthandler.enable()  # where a library ends the process on a damaged file, a traceback says at what
    sys.meta_path.insert(0, WithoutPandas)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # it is closed: a file that is opened would take its place
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, interrupt)
            sys.unraisablehook = unraisable
        from rpil.cli.main import main as command

        command(prog_name="rpil")  # also as python -m rpil
    except KeyboardInterrupt:
        tell_of_interruption()
        sys.exit(INTERRUPTED)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``, after the import that runs: modules in C turn it into other errors, or lose it."""
    while frame is not None and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    if frame is None:
        raise KeyboardInterrupt
    interrupt_later()


def unraisable(error: "sys.UnraisableHookArgs") -> None:
    """Interrupt again where a function that C calls was interrupted: Python prints its errors and goes on."""
    if error.exc_type is KeyboardInterrupt:
        interrupt_later()
    else:
        sys.__unraisablehook__(error)


def interrupt_later() -> None:
    """Send the interruption again in a moment: to the process, as the new thread may have begun with it blocked."""
    send = signal.raise_signal if sys.platform == "win32" else partial(os.kill, os.getpid())
    again = Timer(0.02, send, (signal.SIGINT,))
    again.daemon = True
    again.start()
