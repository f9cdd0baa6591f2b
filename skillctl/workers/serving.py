"""The child's side: it calls functions for its parent, one after the other, and sends what they return."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import traceback
from collections.abc import Sequence
from queue import SimpleQueue
from typing import IO

from skillctl.workers import messages
from skillctl.workers.limits import Limits


def serve() -> None:
    """Answer requests until there are no more: the main function of a child."""
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is no answer
    inbox: SimpleQueue[tuple[bytearray, bytearray]] = SimpleQueue()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    try:
        while True:
            messages.send(answers, *_answer(inbox))
    except MemoryError:  # not even for the answer: the parent says so
        os._exit(1)


def _receive(requests: IO[bytes], inbox: SimpleQueue[tuple[bytearray, bytearray]]) -> None:
    """Queue the requests; when there will be no more, end the process, even in the middle of a call."""
    try:
        while True:
            inbox.put(messages.receive(requests))
    finally:
        os._exit(0)


def _answer(inbox: SimpleQueue[tuple[bytearray, bytearray]]) -> tuple[bytes, Sequence[bytes]]:
    pickled_limits, request = inbox.get()
    limits: Limits | None = pickle.loads(pickled_limits)
    try:
        if limits is not None:
            limits.restrict()
        function, arguments, options = pickle.loads(request)
        del request  # which may be as large as a file
        value = function(*arguments, **options)
        return (pickle.dumps((value, None, "")), ()) if limits is None else messages.packed(value, limits)
    except Exception as error:  # the libraries raise a dozen types on damaged files
        return (_pickled(error) if limits is None else messages.described(error)), ()


def _pickled(error: Exception) -> bytes:
    trace = traceback.format_exc()
    try:
        return pickle.dumps((None, error, trace))
    except Exception:  # what an exception holds may raise anything when it is pickled
        return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}"), trace))
