"""What a child does: call functions for its parent, one after the other, and hand back their outcomes."""

from __future__ import annotations

import json
import os
import pickle
import struct
import sys
import threading
from queue import SimpleQueue
from typing import IO

from skillctl.workers import answers
from skillctl.workers.answers import Outcome
from skillctl.workers.limits import Limits

LENGTH = struct.Struct("<Q")  # of a request, in bytes, before it


def serve(limits_as_json: str) -> None:
    """Answer requests until there are no more: the main function of a child."""
    fields = json.loads(limits_as_json)
    limits = None if fields is None else Limits(**fields)
    requests, replies = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is no answer
    if limits is not None:
        limits.restrict()
    inbox: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()
    while True:
        request = inbox.get()
        if limits is not None:
            limits.grant_time()
        answers.write(replies, _outcome(request), limits)


def _receive(requests: IO[bytes], inbox: SimpleQueue[bytes]) -> None:
    """Hand over requests; when there will be no more, end the process, even in the middle of a call."""
    try:
        while True:
            (size,) = LENGTH.unpack(answers.exactly(requests, LENGTH.size))
            inbox.put(answers.exactly(requests, size))
    finally:
        os._exit(0)


def _outcome(request: bytes) -> Outcome:
    try:
        function, arguments, options = pickle.loads(request)  # our parent sends it
        return Outcome(function(*arguments, **options))
    except Exception as error:  # the libraries raise a dozen types on damaged files
        return Outcome.failed(error)
