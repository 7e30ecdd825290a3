"""The shell starts this as ``rpil``."""

import faulthandler
import os
import sys


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
    from rpil.cli.main import main as command

    command(prog_name="rpil")  # also as python -m rpil
