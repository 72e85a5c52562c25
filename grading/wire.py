"""The only language between the scorer and a sandbox: framed JSON headers and plain little-endian arrays.

A frame is 4 magic bytes, u32 length of the header, u64 length of the payload, the header (JSON), the arrays' bytes one
after another. Nothing is ever unpickled, and every length is checked before a byte of it is allocated. This file is
also copied into the sandbox, so it imports nothing but the standard library and numpy.
"""

import json
import math
import select
import socket
import struct
import time

import numpy as np

MAGIC = b"DNL1"
PREFIX = struct.Struct("<4sIQ")
DTYPES = {name: np.dtype(name).newbyteorder("<") for name in ("float32", "float64", "int64", "uint8", "bool")}
MOST_HEADER = 16 * 1024
MOST_PAYLOAD = 64 * 1024 * 1024
MOST_ARRAYS = 64
MOST_AXES = 8
MOST_DEPTH = 4  # of the header's JSON
MOST_NAME = 64
KINDS = ("hello", "call", "reply", "error")


class ProtocolError(Exception):
    """The other side does not speak the protocol; its text is made here, never there."""


class DeadlineError(ProtocolError):
    """A frame was not complete in time."""


class ClosedError(ProtocolError):
    """The connection ended in or before a frame."""


def pack(kind: str, number: int, word: str, arrays: dict[str, np.ndarray]) -> bytes:
    """A frame.

    Args:
        kind: one of `KINDS`.
        number: id of the call or of the call that is answered; 0 in a hello.
        word: function that is called; type name of an error; else empty.
        arrays: by name, of one of `DTYPES`.

    Raises:
        ProtocolError: an array of another dtype, or more than a frame may hold.
    """
    told, parts = [], []
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.dtype.name not in DTYPES:
            raise ProtocolError(f"dtype {array.dtype.name[:20]} is not sent")
        told.append([name, array.dtype.name, list(array.shape)])
        parts.append(np.ascontiguousarray(array, DTYPES[array.dtype.name]).tobytes())
    header = json.dumps({"kind": kind, "id": number, "word": word, "arrays": told}).encode("utf-8")
    payload = b"".join(parts)
    if len(header) > MOST_HEADER or len(payload) > MOST_PAYLOAD or len(told) > MOST_ARRAYS:
        raise ProtocolError("too much for one frame")
    return PREFIX.pack(MAGIC, len(header), len(payload)) + header + payload


def lengths(prefix: bytes, most_payload: int = MOST_PAYLOAD) -> tuple[int, int]:
    """Bytes of header and payload that a frame's first 16 bytes announce, within bounds."""
    if len(prefix) != PREFIX.size:
        raise ProtocolError("prefix too short")
    magic, header, payload = PREFIX.unpack(prefix)
    if magic != MAGIC:
        raise ProtocolError("wrong magic")
    if not 2 <= header <= MOST_HEADER:
        raise ProtocolError("header length out of bounds")
    if payload > most_payload:
        raise ProtocolError("payload length out of bounds")
    return header, payload


def _depth_within(text: str) -> bool:
    """Whether brackets nest at most `MOST_DEPTH` deep, strings skipped; checked before the parser recurses."""
    depth, in_string, escaped = 0, False, False
    for character in text:
        if in_string:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                in_string = False
        elif character == '"':
            in_string = True
        elif character in "[{":
            depth += 1
            if depth > MOST_DEPTH:
                return False
        elif character in "]}":
            depth -= 1
    return True


def _no_constant(name: str):
    raise ProtocolError("NaN or infinity in a header")


def _unique(pairs):
    if len({key for key, _ in pairs}) != len(pairs):
        raise ProtocolError("a key stands twice")
    return dict(pairs)


def _json_object(header: bytes) -> dict:
    """The header as a dict; flat, ASCII, without repeated keys, long digits or constants."""
    try:
        text = header.decode("ascii")
    except UnicodeDecodeError:
        raise ProtocolError("header is not ASCII") from None
    if not _depth_within(text):
        raise ProtocolError("header too deep")
    try:
        found = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_unique)
    except (ValueError, RecursionError):
        raise ProtocolError("header is not JSON") from None
    if type(found) is not dict or set(found) != {"kind", "id", "word", "arrays"}:
        raise ProtocolError("header has other keys")
    return found


def _is_word(value) -> bool:
    return (
        type(value) is str and len(value) <= MOST_NAME and all(c.isascii() and (c.isalnum() or c == "_") for c in value)
    )


def describe(header: bytes, payload: int) -> tuple[str, int, str, list]:
    """Kind, id, word and the arrays [(name, dtype, shape, bytes)] of a header, once everything adds up.

    Args:
        header: its bytes.
        payload: bytes that follow; the arrays must fill them exactly.
    """
    found = _json_object(header)
    kind, number, word, told = found["kind"], found["id"], found["word"], found["arrays"]
    if type(kind) is not str or kind not in KINDS:
        raise ProtocolError("unknown kind")
    if type(number) is not int or not 0 <= number < 2**53:
        raise ProtocolError("id out of bounds")
    if not _is_word(word):
        raise ProtocolError("word is no identifier")
    if type(told) is not list or len(told) > MOST_ARRAYS:
        raise ProtocolError("arrays are no short list")
    arrays, total, names = [], 0, set()
    for entry in told:
        if type(entry) is not list or len(entry) != 3:
            raise ProtocolError("an array is not [name, dtype, shape]")
        name, dtype, shape = entry
        if not _is_word(name) or not name or name in names:
            raise ProtocolError("an array's name is no identifier or stands twice")
        if type(dtype) is not str or dtype not in DTYPES:
            raise ProtocolError("dtype not allowed")
        if type(shape) is not list or len(shape) > MOST_AXES:
            raise ProtocolError("shape is no short list")
        if any(type(n) is not int or not 0 <= n <= MOST_PAYLOAD for n in shape):
            raise ProtocolError("shape out of bounds")
        size = math.prod(shape) * DTYPES[dtype].itemsize  # Python's integers do not overflow
        total += size
        if total > payload:
            raise ProtocolError("arrays are longer than the payload")
        names.add(name)
        arrays.append((name, DTYPES[dtype], tuple(shape), size))
    if total != payload:
        raise ProtocolError("arrays are shorter than the payload")
    return kind, number, word, arrays


def unpack(header: bytes, payload: bytes | bytearray) -> tuple[str, int, str, dict[str, np.ndarray]]:
    """Kind, id, word and arrays of a frame without its prefix."""
    kind, number, word, told = describe(header, len(payload))
    arrays, start = {}, 0
    for name, dtype, shape, size in told:
        flat = np.frombuffer(payload, np.uint8, size, start)
        if dtype == np.bool_ and (flat > 1).any():
            raise ProtocolError("a bool that is neither 0 nor 1")
        try:
            arrays[name] = flat.view(dtype).reshape(shape)
        except ValueError:  # an axis of 0 beside axes whose product overflows
            raise ProtocolError("shape out of bounds") from None
        start += size
    return kind, number, word, arrays


class Connection:
    """One end of a socket that speaks frames.

    Args:
        sock: connected stream socket.
        most_payload: bytes that a frame from the other side may carry.
    """

    def __init__(self, sock: socket.socket, most_payload: int = MOST_PAYLOAD):
        self._socket = sock
        self._most_payload = most_payload

    def send(self, frame: bytes, deadline: float | None = None) -> None:
        """Write a whole frame before the deadline [s of `time.monotonic`]."""
        view = memoryview(frame)
        while view:
            self._socket.settimeout(_left(deadline))
            try:
                view = view[self._socket.send(view) :]
            except TimeoutError:
                raise DeadlineError("frame not taken in time") from None
            except OSError:
                raise ClosedError("connection ended") from None

    def has_waiting(self) -> bool:
        """Whether something has come that nobody asked for, or the other side has hung up."""
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        return bool(poll.poll(0))

    def _take(self, count: int, deadline: float | None) -> bytearray:
        taken = bytearray(count)
        view = memoryview(taken)
        while view:
            self._socket.settimeout(_left(deadline))
            try:
                got = self._socket.recv_into(view)
            except TimeoutError:
                raise DeadlineError("frame not complete in time") from None
            except OSError:
                raise ClosedError("connection ended") from None
            if got == 0:
                raise ClosedError("connection ended")
            view = view[got:]
        return taken

    def receive(self, deadline: float | None = None):
        """Next frame as (kind, id, word, arrays); one deadline covers all of it."""
        header, payload = lengths(bytes(self._take(PREFIX.size, deadline)), self._most_payload)
        head = bytes(self._take(header, deadline))
        describe(head, payload)  # before the payload is allocated
        return unpack(head, self._take(payload, deadline))

    def close(self) -> None:
        """End it; the other side sees an end of file."""
        self._socket.close()


def _left(deadline: float | None) -> float | None:
    """Seconds until a deadline; None for none."""
    if deadline is None:
        return None
    left = deadline - time.monotonic()
    if left <= 0:
        raise DeadlineError("frame not complete in time")
    return left


class Caller:
    """The scorer's end: asks one question at a time and takes nothing but its answer."""

    def __init__(self, connection: Connection):
        self._connection = connection
        self._number = 0

    def ask(self, function: str, arrays: dict[str, np.ndarray], seconds: float):
        """(error type or "", arrays) of a call.

        Raises:
            ProtocolError: anything but one reply or error with the id of this call, in time.
        """
        if self._connection.has_waiting():
            self._connection.receive(time.monotonic() + seconds)  # an end of file is told apart
            raise ProtocolError("an answer before its call")
        self._number += 1
        deadline = time.monotonic() + seconds
        self._connection.send(pack("call", self._number, function, arrays), deadline)
        kind, number, word, answer = self._connection.receive(deadline)
        if kind not in ("reply", "error") or number != self._number:
            raise ProtocolError("not the answer to this call")
        if kind == "error":
            return word or "Exception", {}
        return "", answer
