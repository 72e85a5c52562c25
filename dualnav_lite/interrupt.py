"""Ctrl-C that waits until pymunk's own code is left: an exception in its C callbacks is lost, or ends the process."""

import _thread
import signal
import threading
import time

RETRY_S = 0.005
_PYMUNK = "pymunk"


def hold_in_pymunk() -> None:
    """From now on hold Ctrl-C back while pymunk runs; leaves alone a handler that somebody else has set.

    pymunk frees bodies and walks a space by callbacks from C. There Python prints a `KeyboardInterrupt` and goes on as
    if nobody had pressed a key, or C goes on with half of its work done.
    """
    if threading.current_thread() is threading.main_thread() and (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number, frame) -> None:
    inner = frame
    while inner is not None:
        if inner.f_globals.get("__name__", "").partition(".")[0] == _PYMUNK:
            _thread.start_new_thread(_again, ())  # no lock is taken: this may run in the middle of anything
            return
        inner = inner.f_back
    signal.default_int_handler(number, frame)


def _again() -> None:
    time.sleep(RETRY_S)
    _thread.interrupt_main()
