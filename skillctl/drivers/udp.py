"""Any controller that speaks lines of text over UDP; `docs/robot.md` has the protocol, and a client in C."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from contextlib import suppress

from skillctl.drivers.driver import Driver, Measured, Setup
from skillctl.errors import UsageError

HOST, PORT = "127.0.0.1", 5005
LONGEST = 512  # bytes of a line


class UdpRobot(Driver):
    """Takes the newest line ``state N DONE x y z …`` that came; answers with ``move N vx vy vz …``."""

    grips = True

    def __init__(self, setup: Setup) -> None:
        """Args: setup; its address is ``PORT`` or ``HOST:PORT``, here; by default 127.0.0.1:5005.

        Raises:
            UsageError: Not an address, or one that is in use.
        """
        super().__init__(setup)
        host, _, port = setup.address.rpartition(":")
        self.place = f"{host or HOST}:{port or PORT}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host or HOST, int(port or PORT)))
        except (OSError, ValueError, OverflowError) as error:
            self._socket.close()
            problem = getattr(error, "strerror", None) or "it is PORT or HOST:PORT"
            raise UsageError(
                f"driver: udp cannot use {self.place}: {problem}.",
                hint="Choose another port, as in udp:5006; another run may have this one.",
            ) from None
        self._peer: tuple[str, int] | None = None
        self._newest: Measured | None = None
        self._done, self._asked = 0, 0  # the last event that the robot has done, and the one that is due

    def state(self) -> Measured | None:
        """Return the newest state that came; other lines and other senders are passed over."""
        with suppress(BlockingIOError):
            while True:
                line, peer = self._socket.recvfrom(LONGEST)
                if peer == (self._peer or peer):
                    self._read(line, peer)
        return self._newest

    def _read(self, line: bytes, peer: tuple[str, int]) -> None:
        with suppress(ValueError):
            word, number, done, *numbers = line.split()
            if word == b"state":
                self._newest = Measured(int(number), tuple(map(float, numbers)))
                self._done, self._peer = int(done), peer

    def command(self, velocity: Sequence[float]) -> None:
        """Answer the newest state."""
        if self._newest is not None:
            self._send("move", int(self._newest.stamp), *map(repr, velocity))

    def event(self, text: str) -> bool:
        """Ask for what is due, until the robot says in its states that it has done it."""
        self._asked = self._asked or self._done + 1
        self._send("event", self._asked, text)
        if self._done < self._asked:
            return True
        self._asked = 0
        return False

    def close(self) -> None:
        """Say that nothing more will come."""
        self._send("stop")
        self._socket.close()

    def _send(self, *words: object) -> None:
        if self._peer is not None:
            with suppress(OSError):  # if it is gone, there will be no new state
                self._socket.sendto(f"{' '.join(map(str, words))}\n".encode(), self._peer)
