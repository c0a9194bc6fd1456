"""Log of faults that are contained: each with its traceback once, then as a line.

A fault that a client can cause at will must not fill the log with tracebacks.
"""

from __future__ import annotations

import logging
import sys
import threading
import traceback

# Of distinct faults; a program with more has other problems, and begins anew.
_MAX_FAULTS = 256

_lock = threading.Lock()
_logged: set[tuple[str, str, int]] = set()


def log_fault(log: logging.Logger, message: str, *args: object) -> None:
    """Log the exception that is being handled, at the first time with its traceback.

    Args:
        log: Logger of the module that contains the fault.
        message: The work that failed and the consequence, as a template of `logging`.
        args: Arguments of the template.
    """
    error = sys.exc_info()[1]
    assert error is not None, "to be called while an exception is handled"
    is_new = _record(error)
    log.error(message + ": %r", *args, error, exc_info=error if is_new else None)


def _record(error: BaseException) -> bool:
    """Record an exception by its type and origin; False if it was recorded before."""
    frames = traceback.extract_tb(error.__traceback__)
    origin = frames[-1] if frames else None
    key = (
        type(error).__qualname__,
        origin.filename if origin else "",
        (origin.lineno or 0) if origin else 0,
    )
    with _lock:
        if key in _logged:
            return False
        if len(_logged) >= _MAX_FAULTS:
            _logged.clear()
        _logged.add(key)
        return True
