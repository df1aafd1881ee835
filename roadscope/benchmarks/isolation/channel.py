"""Messages over sockets: eight bytes of length, little endian, and as many bytes.

Long messages to a plug-in, scans and images, go through a file in memory that both processes have
open; only their length, with a mark, goes over the socket. Over the socket they would go in a dozen
pieces, each of which wakes both processes. The worker writes to that file and never reads it.
"""

from __future__ import annotations

import os
import select
import socket
import tempfile
import time

LENGTH_BYTES = 8
IN_BUFFER = 1 << 63
"""Marks the length of a message that lies in the buffer."""
SHORT_BYTES = 1 << 16
"""Bytes that a socket holds in one piece on every system."""
PIECE_BYTES = 1 << 20
"""Most bytes that are received at a time."""
END, CLOSED, LOG = b"E", b"C", b"L"
"""Commands to a guard: end the plug-in; end it because its socket is closed; send the log."""


class ClosedError(EOFError):
    """The other end is closed, or its process has ended."""


class TooLongError(ValueError):
    """A message is longer than allowed; nothing of it was read. The text is its size in bytes."""


def framed(message: bytes) -> bytes:
    """Return a message with its length before it."""
    return len(message).to_bytes(LENGTH_BYTES, "little") + message


def send_all(connection: socket.socket, message: bytes) -> None:
    """Send a message over a blocking socket."""
    for part in _parts(message):
        connection.sendall(part)


def _parts(message: bytes) -> list[bytes]:
    """Return the pieces to send: one piece for a short message, so that its reader wakes once."""
    if len(message) <= SHORT_BYTES:
        return [framed(message)]
    return [len(message).to_bytes(LENGTH_BYTES, "little"), message]


def receive_all(connection: socket.socket, buffer: int) -> bytearray:
    """Receive a message from a blocking socket or from a file; `ClosedError` at the end."""
    length = int.from_bytes(receive_exactly(connection, LENGTH_BYTES), "little")
    if not length & IN_BUFFER:
        return receive_exactly(connection, length)
    data = bytearray(length ^ IN_BUFFER)
    view, done = memoryview(data), 0
    while done < len(data):
        received = os.preadv(buffer, [view[done:]], done)
        if not received:
            raise ClosedError
        done += received
    return data


def receive_exactly(connection: socket.socket, count: int) -> bytearray:
    """Receive `count` bytes from a blocking socket; `ClosedError` if it ends before."""
    data = bytearray(count)
    view, done = memoryview(data), 0
    while done < count:
        received = connection.recv_into(view[done:])
        if not received:
            raise ClosedError
        done += received
    return data


def open_buffer() -> int:
    """Open a file in memory, or a temporary one that is deleted, and return its number."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("roadscope")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


class Channel:
    """The worker's end of a socket: every wait has a deadline, every message a greatest length."""

    def __init__(
        self,
        connection: socket.socket,
        *,
        ended: socket.socket | None = None,
        buffer: int | None = None,
    ) -> None:
        """Take a socket.

        ended: a socket that becomes readable when the other process has ended.
        buffer: number of the file for long messages.
        """
        connection.setblocking(False)
        self._buffer = buffer
        self._connection = connection
        self._poll = select.poll()
        self._ended = -1 if ended is None else ended.fileno()
        if ended is not None:
            self._poll.register(ended, select.POLLIN)

    def send(self, message: bytes, deadline: float) -> None:
        """Send a message; `TimeoutError` at the deadline of `time.monotonic`."""
        parts = _parts(message)
        if self._buffer is not None and len(message) > SHORT_BYTES:
            # Not through a memory map, which crashes if the other process shortens the file.
            done = 0
            while done < len(message):
                done += os.pwrite(self._buffer, memoryview(message)[done:], done)
            parts = [(len(message) | IN_BUFFER).to_bytes(LENGTH_BYTES, "little")]
        for part in parts:
            view = memoryview(part)
            while view:
                try:
                    view = view[self._connection.send(view) :]
                except BlockingIOError:
                    self._wait(select.POLLOUT, deadline)
                except OSError as error:
                    raise ClosedError from error

    def receive(self, most: int, deadline: float) -> bytearray:
        """Receive a message of at most `most` bytes."""
        length = int.from_bytes(self._exactly(LENGTH_BYTES, deadline), "little")
        if length > most:
            raise TooLongError(length)
        return self._exactly(length, deadline)

    def surplus(self) -> bool:
        """Return whether something arrived that was not asked for."""
        try:
            return bool(self._connection.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def _exactly(self, count: int, deadline: float) -> bytearray:
        data = bytearray()
        while len(data) < count:
            try:
                piece = self._connection.recv(min(count - len(data), PIECE_BYTES))
            except BlockingIOError:
                self._wait(select.POLLIN, deadline)
                continue
            except OSError as error:
                raise ClosedError from error
            if not piece:
                raise ClosedError
            data += piece
            if time.monotonic() > deadline:
                raise TimeoutError
        return data

    def _wait(self, event: int, deadline: float) -> None:
        """Wait until the socket is ready; what arrived before the other end closed comes first."""
        remaining_ms = (deadline - time.monotonic()) * 1e3
        if remaining_ms <= 0:
            raise TimeoutError
        self._poll.register(self._connection, event)
        ready = {number for number, _ in self._poll.poll(remaining_ms)}
        if not ready:
            raise TimeoutError
        if self._ended in ready and self._connection.fileno() not in ready:
            raise ClosedError
