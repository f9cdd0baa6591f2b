"""What a child does: call functions for its parent, one after the other, and hand back their outcomes."""

from __future__ import annotations

import json
import os
import pickle
import sys
import threading
from queue import SimpleQueue
from typing import IO, Any

from skillctl.workers import messages
from skillctl.workers.limits import Limits


def serve(limits_as_json: str) -> None:
    """Answer requests until there are no more: the main function of a child."""
    fields = json.loads(limits_as_json)
    limits = None if fields is None else Limits(**fields)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is no answer
    if limits is not None:
        limits.restrict()
    inbox: SimpleQueue[bytearray] = SimpleQueue()
    threading.Thread(target=_receive, args=(requests, inbox), daemon=True).start()

    def compute() -> Any:
        request = inbox.get()
        if limits is not None:
            limits.grant_time()
        function, arguments, options = pickle.loads(request)
        del request  # which may be as large as a file
        return function(*arguments, **options)

    while True:
        messages.send_outcome(answers, compute, limits)


def _receive(requests: IO[bytes], inbox: SimpleQueue[bytearray]) -> None:
    """Hand over requests; when there will be no more, end the process, even in the middle of a call."""
    try:
        while True:
            inbox.put(messages.receive(requests)[0])
    finally:
        os._exit(0)
