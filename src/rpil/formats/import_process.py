"""Work on files of others in a process of its own, under limits of memory and time.

A library believes what a file declares, and some end the process on a damaged one. In a process of its own neither
hurts: whatever ends it is one sentence here. Linux alone has these limits, elsewhere the work is done in this process.
"""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import json
import math
import os
import select
import signal
import sys
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NoReturn

from rpil.data.errors import DataError, MissingExtraError, SentenceWithOptions
from rpil.data.guard import guarded
from rpil.data.held import holding
from rpil.data.json_files import Parsed
from rpil.data.memory import MIB, Size, budget

_LEAST_SECONDS = 15
"""Seconds of computing that a small file may take."""

_BYTES_A_SECOND = 2 * MIB
"""Bytes of a file for which one more second is given."""

_WAITING = 8
"""How many times as long the process may last, as it waits for disks and for other processes."""

_RESERVED = 1024 * MIB
"""Bytes that libraries reserve and hardly use."""

_BEGINNING = 20
"""Seconds until the process says that it has begun, at most: Python 3.11 does not go on after a fork if a thread begins
or ends just then, and another fork helps."""

_PR_SET_PDEATHSIG = 1  # of Linux
_SIGNALS = {signal.SIGINT, signal.SIGTERM}
_REMEDY = "it is damaged or of another form, copy or write it again"


def in_child(work: Callable[[], Parsed], where: str, n_bytes: float, memory: Size | None = None) -> Parsed:
    """The result of `work`, done in a forked process under limits.

    Parameters
    ----------
    work : function
        Its result is a value of JSON. Its warnings are raised here.
    where : str
        The file in messages.
    n_bytes : float
        Its size, by which the process has more time.
    memory : int or str, optional
        Bytes that the process may take; by default half of the free memory.

    Raises
    ------
    DataError, MissingExtraError, OSError
        What `work` raises; a `DataError` for all that is none of them, and where the process takes too much memory or
        time, or is ended.
    """
    if sys.platform != "linux":
        return work()
    seconds = int(_LEAST_SECONDS + n_bytes / _BYTES_A_SECOND)
    reading, writing = os.pipe()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # until each process has its own way with them
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which the child does not have
        child = os.fork()
    if not child:
        os.close(reading)
        _answer(work, where, seconds, memory, writing, mask)
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            first = select.poll()
            first.register(pipe, select.POLLIN)
            if not (has_begun := bool(first.poll(1000 * _BEGINNING))):
                os.kill(child, signal.SIGKILL)
            answer = pipe.read()
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    except BaseException:  # an interruption, of which the child is not told, and may have come to its end
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        raise
    if not has_begun:
        return in_child(work, where, n_bytes, memory)
    if status:
        raise _death(status, where, seconds)
    kind, result = json.loads(answer)
    if kind == "result":
        for message in result[1]:
            warnings.warn(message, stacklevel=2)
        return result[0]
    raise _error(kind, result)


def _answer(
    work: Callable[[], Parsed],
    where: str,
    seconds: int,
    memory: Size | None,
    pipe: int,
    mask: Iterable[signal.Signals | int],
) -> NoReturn:
    """Do the work, write what comes of it to the pipe, and end this process, whose memory is a copy of another's."""
    status = 1
    gc.freeze()  # what the other process holds: to delete it here may wait for its threads, which are not here
    try:
        os.write(pipe, b" ")  # which JSON may begin with
        _limit(seconds, memory)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if (pa := sys.modules.get("pyarrow")) is not None:
            pa.set_memory_pool(pa.system_memory_pool())  # others may not go on after a fork
        try:
            with holding(alone=True), guarded(where), warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                result = work()
                answer = json.dumps(["result", [result, [str(w.message) for w in warned if w.category is UserWarning]]])
        except SentenceWithOptions as error:
            answer = json.dumps([type(error).__name__, [str(error), error.in_shell]])
        except MissingExtraError as error:
            answer = json.dumps([type(error).__name__, error.__reduce__()[1]])
        except OSError as error:
            answer = json.dumps(["OSError", [error.errno, error.strerror, str(error.filename or where)]])
        with os.fdopen(pipe, "wb") as stream:
            stream.write(answer.encode())
        status = 0
    finally:
        os._exit(status)


def _limit(seconds: int, memory: Size | None) -> None:
    """Limit this process; what libraries print when they are about to end it goes nowhere."""
    import resource  # of Unix

    faulthandler.disable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other process ends this one
    for number in (signal.SIGTERM, signal.SIGALRM, signal.SIGXCPU):
        signal.signal(number, signal.SIG_DFL)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    with suppress(AttributeError):  # the end of the other process is the end of this one
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.setitimer(signal.ITIMER_REAL, _WAITING * seconds)
    limits = {resource.RLIMIT_CORE: 0.0, resource.RLIMIT_CPU: seconds}
    with suppress(OSError), open("/proc/self/statm") as sizes:
        limits[resource.RLIMIT_AS] = int(sizes.read().split()[0]) * resource.getpagesize() + budget(memory) + _RESERVED
    for kind, most in limits.items():
        soft, hard = resource.getrlimit(kind)
        if most < (math.inf if soft == resource.RLIM_INFINITY else soft):
            resource.setrlimit(kind, (int(most), hard))


def _death(status: int, where: str, seconds: int) -> DataError:
    """The error that the process was ended by a signal, or without an answer."""
    seconds *= _WAITING if -status == signal.SIGALRM else 1
    if -status in (signal.SIGXCPU, signal.SIGALRM):
        return DataError(f"{where}: to read it took more than {seconds} s; {_REMEDY}, or read less of it.")
    if -status == signal.SIGKILL:
        return DataError(f"{where}: more memory than is free would be needed to read it; read less of it.")
    name = signal.Signals(-status).name if status < 0 else f"code {status}"
    return DataError(f"{where}: the library that reads it was ended by it ({name}); {_REMEDY}.")


def _error(kind: str, content: list[str]) -> Exception:
    """The error of this name, as it was raised in the other process."""
    if kind == "OSError":
        return OSError(*content)
    if kind == MissingExtraError.__name__:
        return MissingExtraError(*content)
    classes = [DataError]
    for one in classes:
        classes += one.__subclasses__()
    error = next((one for one in classes if one.__name__ == kind), DataError)(content[0])
    error.in_shell = content[1]
    return error
