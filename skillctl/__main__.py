"""The program ``skillctl``: what must happen before anything heavy is imported.

An interrupt while the imports up here run is Python's to tell about, so they are few.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import signal
import sys
import threading
import time
import warnings

from skillctl.errors import Terminated

GRACE = 5.0  # [s], for whoever unwinds in order


def main() -> None:
    """Run the command line and exit with the code that `skillctl.cli.errors` gives the outcome."""
    signal.signal(signal.SIGTERM, _terminate)
    sys.unraisablehook = _soon_again
    _fill_descriptors()
    try:
        _run()
    except KeyboardInterrupt as stop:  # while modules were loaded; the command line tells of all others
        from skillctl.cli.output import Output

        sys.exit(Output.for_arguments(sys.argv[1:]).fail(stop))


def _run() -> None:
    if sys.argv[1:] == ["--version"]:
        _print_version()
        return
    from skillctl.workers.threads import one_by_environment  # late: --version needs the version only

    one_by_environment()
    os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # to look for them takes longer than to check a file
    atexit.register(gc.freeze)  # the last collection of what dies anyway took a quarter of a command's time
    if not sys.warnoptions and "--debug" not in sys.argv:
        warnings.simplefilter("ignore")  # they speak to developers; tests turn them into errors
    if isinstance(getattr(sys.stdout, "buffer", None), io.RawIOBase):
        # PYTHONUNBUFFERED: what does not fit on the disk any more would be lost without an error.
        sys.stdout = open(1, "w", encoding=sys.stdout.encoding, closefd=False)  # noqa: SIM115 - it lasts, too
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # ξ on a Latin-1 terminal is no reason to stop
    if sys.argv[1:2] == ["__complete"]:
        from skillctl.cli import candidates

        candidates.main(sys.argv[2:])
        return
    from skillctl.cli.app import app

    _end_in_time()
    app(prog_name="skillctl")


def _fill_descriptors() -> None:
    """Point closed standard streams nowhere: the next file that is opened would have their descriptors.

    Where standard error is missing, Python's ``print`` takes standard output. A closed standard output stays
    missing, for a result that nobody gets is an error.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - it lasts as long as the program


def _end_in_time() -> None:
    """Let SIGTERM and Ctrl-C end the process after a while, even if Python's handlers have to wait.

    They do for as long as one product of large matrices takes. What is half written then is swept later.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing)
    threading.Thread(target=_end_late, args=(reading,), daemon=True).start()


def _end_late(signals: int) -> None:
    from skillctl.cli.output import Output

    stops = {int(signal.SIGTERM): Terminated, int(signal.SIGINT): KeyboardInterrupt}
    while (stop := stops.get(os.read(signals, 1)[0])) is None:
        pass
    time.sleep(GRACE)
    os._exit(Output.for_arguments(sys.argv[1:]).fail(stop()))


def _terminate(*_: object) -> None:
    raise Terminated


def _soon_again(lost: sys.UnraisableHookArgs) -> None:
    """Raise an interrupt once more that came while an object was removed, where Python goes on after it."""
    if lost.exc_type is None or not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    number = signal.SIGTERM if issubclass(lost.exc_type, Terminated) else signal.SIGINT
    signal.signal(signal.SIGALRM, signal.getsignal(number))
    signal.setitimer(signal.ITIMER_REAL, 0.001)  # when this function has ended


def _print_version() -> None:
    from skillctl import __version__
    from skillctl.cli.exit_codes import ExitCode

    try:
        print(f"skillctl {__version__}", flush=True)
    except BrokenPipeError:
        os._exit(ExitCode.CLOSED_PIPE)
    except OSError as error:
        print(f"error: standard output cannot be written: {error.strerror}.", file=sys.stderr)
        os._exit(ExitCode.STORE)


if __name__ == "__main__":
    main()
