"""A WebSocket client of the standard library alone: text messages, one question and one answer at a time.

Source: RFC 6455.
"""

import base64
import hashlib
import os
import socket
import struct
import time

__all__ = ["Connection", "LostError"]

_GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
_TEXT, _CONTINUED, _CLOSE, _PING = 0x1, 0x0, 0x8, 0x9
_MOST_HEADER, _MOST_BYTES = 65536, 16000000


class LostError(Exception):
    """The connection is of no use any more; its text says why."""


class Connection(object):
    """A connection to an oracle.

    Args:
        host, port: Of the oracle.
        name: By which it keeps the state.
        token: Empty: none.
        timeout_s: For connecting and for each answer, s.

    Raises:
        LostError: There is no oracle, or it refuses.
    """

    def __init__(self, host, port, name, token="", timeout_s=2.0):
        self._timeout_s, self._unread = timeout_s, b""
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except OSError as cause:
            raise LostError("it cannot be reached: {}".format(cause))
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._greet(host, port, name, token)
        except OSError as cause:
            self.close()
            raise LostError("no handshake: {}".format(cause))
        except LostError:
            self.close()
            raise

    def ask(self, text):
        """The answer to a message.

        Raises:
            LostError: There was none in time. Whoever asked again would take a late answer for the next one.
        """
        try:
            self._until_s = time.monotonic() + self._timeout_s
            self._send(_TEXT, text.encode("utf-8"))
            return self._message().decode("utf-8")
        except socket.timeout:
            self.close()
            raise LostError("no answer within {} s".format(self._timeout_s))
        except (OSError, ValueError) as cause:
            self.close()
            raise LostError(str(cause) or "closed")
        except LostError:
            self.close()
            raise

    def close(self):
        """End it; the oracle sees that it ended."""
        try:
            self._send(_CLOSE, struct.pack(">H", 1000))
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._socket.close()

    def _greet(self, host, port, name, token):
        key = base64.b64encode(os.urandom(16)).decode("ascii")
        shown = "[{}]".format(host) if ":" in host else host
        lines = [
            "GET /{} HTTP/1.1".format(name),
            "Host: {}:{}".format(shown, port),
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: " + key,
        ] + (["Authorization: Bearer " + token] if token else [])
        self._until_s = time.monotonic() + self._timeout_s
        self._socket.sendall("\r\n".join([*lines, "", ""]).encode("ascii"))
        while b"\r\n\r\n" not in self._unread:
            if len(self._unread) > _MOST_HEADER:
                raise LostError("no handshake: its header has no end")
            self._receive()
        head, _, self._unread = self._unread.partition(b"\r\n\r\n")
        status, _, rest = head.decode("latin-1").partition("\r\n")
        if status.split(" ")[1:2] != ["101"]:
            raise LostError("it refuses: {}".format(status))
        lines = [line.partition(":") for line in rest.split("\r\n")]
        fields = {name.strip().lower(): value.strip() for name, _, value in lines}
        digest = hashlib.sha1((key + _GUID).encode("ascii")).digest()  # noqa: S324  # as the protocol has it
        wanted = base64.b64encode(digest).decode("ascii")
        if fields.get("sec-websocket-accept") != wanted:
            raise LostError("no handshake: something else answers there")

    def _receive(self):
        left_s = self._until_s - time.monotonic()
        if left_s <= 0:
            raise socket.timeout()
        self._socket.settimeout(left_s)
        received = self._socket.recv(65536)
        if not received:
            raise LostError("it closed the connection")
        self._unread += received

    def _take(self, count):
        while len(self._unread) < count:
            self._receive()
        taken, self._unread = self._unread[:count], self._unread[count:]
        return taken

    def _message(self):
        whole = b""
        while True:
            first, second = bytearray(self._take(2))
            length = second & 0x7F
            if length == 126:
                (length,) = struct.unpack(">H", self._take(2))
            elif length == 127:
                (length,) = struct.unpack(">Q", self._take(8))
            if second & 0x80 or first & 0x70 or len(whole) + length > _MOST_BYTES:
                raise LostError("it sends what is no frame")
            body, opcode = self._take(length), first & 0x0F
            if opcode == _CLOSE:
                raise LostError("it closed the connection")
            if opcode == _PING:
                self._send(0xA, body)
            elif opcode in (_TEXT, _CONTINUED):
                whole += body
                if first & 0x80:
                    return whole

    def _send(self, opcode, body):
        mask = os.urandom(4)
        length = len(body)
        if length < 126:
            head = struct.pack(">BB", 0x80 | opcode, 0x80 | length)
        elif length < 65536:
            head = struct.pack(">BBH", 0x80 | opcode, 0x80 | 126, length)
        else:
            head = struct.pack(">BBQ", 0x80 | opcode, 0x80 | 127, length)
        key = (mask * (length // 4 + 1))[:length]
        masked = int.from_bytes(body, "big") ^ int.from_bytes(key, "big")
        self._socket.settimeout(self._timeout_s)
        self._socket.sendall(head + mask + masked.to_bytes(length, "big"))
